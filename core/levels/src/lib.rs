//! Maps as bytes: saved maps, levels imported from other tools, and maps exported to them.
//!
//! Owns the saved-map format ([`encode`], [`decode`]), the import of glTF and OBJ levels ([`import_gltf`],
//! [`import_obj`]) and the export as glTF ([`export_glb`]). Knows no file names: callers read and write files. All
//! input is untrusted; whatever it holds, the result is a map or an error that says what to change.
//!
//! Start reading at `import`: its pipeline calls `gltf_in` or `obj_in` (bytes to a scene of named nodes), `named` and
//! `sidecar` (their pools, devices and movers) and `inspect` (oddities of the geometry). `belongs` finds what is no
//! part of a level, and `units` suggests a scale. `faults` has the errors and warnings.

mod accessors;
mod animated;
mod belongs;
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
mod meshopt;
mod moving;
mod named;
mod obj_in;
mod pairs;
mod scene;
mod sidecar;
mod sides;
mod units;

pub use export::export_glb;
pub use faults::{ImportError, Warning};
pub use file::{FileError, decode, encode};
pub use import::{Imported, LevelError, import_gltf, import_obj, read_level};
pub use load::Overload;
pub use scene::{ImportOptions, UpAxis};
