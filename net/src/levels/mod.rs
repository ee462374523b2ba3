//! Levels that services were given: the store that keeps them, and `MapService` in front of it.
//!
//! `store` knows maps, names and a limit; `grpc` decodes, calls and encodes. Server and planner both have one.

pub mod grpc;
mod store;

pub use store::{DEFAULT_MAX_MAPS, Level, LevelError, LevelStore, MapSource};
