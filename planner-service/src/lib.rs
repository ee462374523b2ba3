//! The planner: a directed graph per map, each edge proved by running the policy along it, and plans on it.
//!
//! A build is a row of pure stages, each its own module: [`vertices`] places, [`candidates`] pairs, [`probe`]
//! tries, [`graph`] keeps what was proved with its evidence, [`search`] answers queries. [`build`] strings them
//! together, [`cache`] remembers the result, [`service`] speaks gRPC. Nothing below [`service`] knows a wire
//! type or an async runtime.

pub mod build;
pub mod cache;
pub mod candidates;
pub mod graph;
pub mod probe;
pub mod search;
pub mod service;
pub mod vertices;

pub use build::{BuildError, BuildSettings, Built, Placement, build};
pub use graph::{Ability, Edge, NavGraph};
pub use search::{NoPath, Plan, Query};
