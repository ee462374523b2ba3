//! Maps that services use: imported levels, generated maps, and `MapService` for the imported ones. Server and planner
//! both have a store of levels.
//!
//! `store` has the levels with their names and limits, and the interface of an archive that several services share.
//! `pool` generates maps and shares equal ones, `uploads` holds files that arrive in parts, `file` files that clients
//! read. `grpc` decodes, calls and encodes. `folder` reads levels from files, for programs that are no services.

mod file;
pub mod folder;
pub mod grpc;
pub mod pool;
mod report;
mod store;
pub mod uploads;

pub use pool::{MapError, MapPool, SharedMap};
pub use store::{BaseMap, DEFAULT_MAX_MAPS, Level, LevelArchive, LevelError, LevelStore, MapSource, SavedLevel};
