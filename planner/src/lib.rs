//! The planner's pure library: a directed graph per map, each edge proved by running a policy along it, and plans on it.
//!
//! A build is a row of stages, each its own module: [`placement`] places vertices, [`candidates`] pairs them, [`prove`]
//! tries pairs with the help of a predictor and whoever implements [`probe::ProbeExecutor`], [`graph`] keeps what was proved
//! with its [`evidence`]. [`build`] strings them together, [`update`] repeats only what a changed map calls for, [`search`]
//! answers queries with a [`plan`]. [`edits`] and [`live`] are what people and NPCs add; [`store`] is what a place to keep it
//! all must offer.
//!
//! No file, socket, clock, async runtime, neural network or wire format is known here.

mod adjacency;
pub mod build;
pub mod candidates;
pub mod edits;
pub mod evidence;
pub mod export;
pub mod graph;
mod grid;
pub mod ids;
pub mod legs;
pub mod links;
pub mod live;
pub mod placement;
pub mod plan;
mod predictor;
pub mod probe;
pub mod prove;
pub mod reachability;
mod regression;
pub mod search;
pub mod settings;
pub mod site;
pub mod store;
mod table;
pub mod update;

pub use build::{BuildStats, Builder, Built, Progress};
pub use graph::{Edge, NavGraph};
pub use ids::{EdgeKey, LegKey, Stop, VertexId};
pub use plan::{Leg, NoPath, Plan, Query};
pub use search::Router;
pub use settings::{BuildError, BuildSettings, GraphId, Placement, Probing, RawBuildSettings, SettingError};
pub use site::{PolicyHash, Site};
