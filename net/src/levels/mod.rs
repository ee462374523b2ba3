//! Imported levels: the store that keeps them, and `MapService` in front of it.
//!
//! `store` knows maps, names and a limit; `grpc` decodes, calls and encodes. The world server and the planner each have a store.

pub mod grpc;
mod store;

pub use store::{DEFAULT_MAX_MAPS, Level, LevelError, LevelStore, MapSource};
