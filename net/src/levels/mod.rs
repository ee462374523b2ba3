//! Maps that services use: imported levels that are kept, generated maps that are shared, and `MapService` in front of the former.
//!
//! `store` knows levels, names and limits, `archive` is where several services share them, `pool` generates and shares, `uploads` holds files that arrive in parts, `file` has those that are read; `grpc` decodes, calls and encodes. Server and planner both
//! have a store.

mod archive;
mod file;
pub mod grpc;
pub mod pool;
mod store;
pub mod uploads;

pub use archive::{LevelArchive, SavedLevel};
pub use pool::{MapError, MapPool, SharedMap};
pub use store::{DEFAULT_MAX_MAPS, Level, LevelError, LevelStore, Made, MapSource};
