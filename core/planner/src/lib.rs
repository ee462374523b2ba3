//! The planner's pure library: one directed graph per map, whose edges are proved by running a policy along them, and
//! path search on that graph.
//!
//! - [`build`] makes a graph: place vertices, select candidate edges, probe them, keep those that are proved.
//! - [`graph`] is the result; each edge has its [`evidence`].
//! - [`search`] answers a query with a [`plan`], around traffic if there is any. [`places`] finds places to ask about.
//! - [`zones`] have prices or bar the way: plans respect them without a build.
//! - [`change`] follows changes: designers' edits, a changed map, and evidence that NPCs report.
//! - [`export`] writes graphs and links for engines; [`store`] is the trait for persistence.
//!
//! This crate uses no files, sockets, clocks, async runtime, neural networks or wire formats.

pub mod build;
pub mod change;
pub mod evidence;
pub mod export;
pub mod graph;
mod grid;
pub mod ids;
pub mod legs;
pub mod needs;
pub mod places;
pub mod plan;
pub mod price;
#[cfg(test)]
mod properties;
pub mod reachability;
mod regression;
pub mod ride_stops;
pub mod search;
pub mod settings;
pub mod store;
pub mod threads;
pub mod zones;

pub use build::{BuildStats, Builder, Built, Progress, Rehearsed, candidates, interim, is_perilous, placement, probe};
pub use change::{edits, live, update};
pub use export::{assets, links};
pub use graph::{Edge, NavGraph};
pub use ids::{EdgeKey, LegKey, Stop, VertexId};
pub use needs::{Need, Needs, Ride};
pub use plan::{Attach, Leg, NoPath, Plan, Query};
pub use price::{ABILITY_PRICES, AbilityPrices, Caution, EdgeCost, EdgeCosts};
pub use ride_stops::RideStops;
pub use search::{Router, Traffic};
pub use settings::{
    BuildError, BuildSettings, GraphId, Placement, PolicyHash, Probing, RawBuildSettings, SettingError, Site,
};
pub use surefoot_world::{Aabb, AbilitySet, MoverAt};
pub use zones::{Rule, Shape, Tags, Zone, Zones};
