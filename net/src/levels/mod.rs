//! Maps that services use: imported levels that are kept, generated maps that are shared, and `MapService` in front of the former.
//!
//! `store` knows levels, names and limits, `archive` is where several services share them, `pool` generates and shares, `uploads` holds files that arrive in parts, `file` has those that are read; `grpc` decodes, calls and encodes. Server and planner both
//! have a store.

mod file;
pub mod grpc;
pub mod pool;
mod store;
pub mod uploads;

pub use pool::{MapError, MapPool, SharedMap};
pub use store::{BaseMap, DEFAULT_MAX_MAPS, Level, LevelArchive, LevelError, LevelStore, MapSource, SavedLevel};
