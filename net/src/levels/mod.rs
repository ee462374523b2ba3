//! Maps that services use: imported levels that are kept, generated maps that are shared, and `MapService` in front of the former.
//!
//! `store` knows levels, names and limits, `pool` generates and shares, `uploads` holds files that arrive in parts; `grpc` decodes, calls and encodes. Server and planner both
//! have a store.

pub mod grpc;
pub mod pool;
mod store;
pub mod uploads;

pub use pool::{MapError, MapPool, SharedMap};
pub use store::{DEFAULT_MAX_MAPS, Level, LevelError, LevelStore, Made, MapSource};
