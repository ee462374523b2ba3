//! The planner: a directed graph per map, each edge proved by running the policy along it, and plans on it.
//!
//! A build is a row of stages, each its own module: [`placement`] places vertices, [`candidates`] pairs them, [`prove`]
//! tries pairs with the help of a [`predictor`] and a [`probe`] executor, [`graph`] keeps what was proved with its
//! evidence. [`build`] strings them together, [`search`] answers queries, [`cache`] remembers the result, [`service`]
//! speaks gRPC. Nothing below [`service`] knows a wire type or an async runtime.

pub mod build;
pub mod cache;
pub mod candidates;
pub mod edits;
pub mod export;
pub mod graph;
mod grid;
pub mod legs;
pub mod live;
pub mod placement;
mod predictor;
pub mod probe;
pub mod prove;
pub mod reachability;
mod regression;
pub mod search;
pub mod service;
mod table;
pub mod update;

pub use build::{BuildError, BuildSettings, BuildStats, Built, build};
pub use graph::{Ability, Edge, NavGraph};
pub use placement::Placement;
pub use prove::Probing;
pub use search::{NoPath, Plan, Query, Router};
