//! Maps as bytes: saved maps, levels imported from other tools, and maps exported to them.
//!
//! Owns the saved-map format ([`encode`], [`decode`]), the import of glTF and OBJ levels ([`import_gltf`],
//! [`import_obj`], [`read_level`]) and the export as glTF ([`export_glb`]). Knows no file names: callers read and write
//! files. All input is untrusted; whatever it holds, the result is a map or an error that says what to change.
//!
//! Start reading at `import`: its pipeline calls `gltf_in` or `obj_in` (bytes to a scene of named nodes), `named` and
//! `sidecar` (what the nodes stand for), `belongs` (what is no part of the level), `found` (pools, devices and movers)
//! and `sides` (fronts and backs); `units` asks about another scale. `faults` has the errors and warnings, `report`
//! what became of the nodes.

mod accessors;
mod animated;
mod belongs;
mod container;
mod document;
mod draco;
mod export;
mod extras;
mod faults;
mod file;
mod found;
mod gltf_in;
mod import;
mod inspect;
mod joined;
mod load;
mod meaning;
mod meshopt;
mod moving;
mod named;
mod obj_in;
mod pairs;
mod place;
mod polygon;
mod report;
mod scene;
mod shape;
mod sidecar;
mod sides;
mod units;
mod upright;
mod zip;

pub use container::{Files, NoFiles};
pub use export::export_glb;
pub use faults::{ImportError, Warning};
pub use file::{FileError, decode, encode};
pub use import::{Imported, LevelError, import_gltf, import_obj, import_zip, read_level};
pub use load::Overload;
pub use report::{GeometryCounts, NodeReport, Role, role_counts};
pub use scene::ImportOptions;
pub use surefoot_world::map::UpAxis;
pub use zip::{is_zip, unpacked_bytes};
