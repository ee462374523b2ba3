//! The planner's pure library: one directed graph per map, whose edges are proved by running a policy along them, and
//! path search on that graph.
//!
//! A build is a sequence of stages, one module each: [`placement`] places vertices, [`candidates`] selects candidate
//! edges, [`prove`] probes them through a [`probe::ProbeExecutor`], guided by a predictor, and [`graph`] keeps the proved
//! edges with their [`evidence`]. [`build`] runs the stages, of which an [`interim`] graph shows the result so far, [`update`] repeats only what a changed map requires, and
//! [`search`] answers queries with a [`plan`], around [`traffic`] if there is any. Designers contribute [`edits`], NPCs contribute [`live`] evidence;
//! [`assets`] turns proved links into files for engines, and [`store`] defines the trait for persistence.
//!
//! This crate uses no files, sockets, clocks, async runtime, neural networks or wire formats.

mod adjacency;
pub mod assets;
mod attach;
pub mod build;
pub mod candidates;
mod closure;
mod editable;
pub mod edits;
pub mod evidence;
pub mod export;
pub mod graph;
mod grid;
mod hierarchy;
pub mod ids;
pub mod interim;
mod join;
mod joined;
pub mod legs;
pub mod links;
pub mod live;
pub mod needs;
pub mod placement;
pub mod plan;
mod predictor;
pub mod probe;
pub mod progress;
pub mod prove;
pub mod reachability;
mod regression;
pub mod search;
pub mod settings;
pub mod site;
mod stitch;
pub mod store;
mod table;
pub mod traffic;
pub mod update;
mod ways;

pub use build::{BuildStats, Builder, Built};
pub use evidence::Caution;
pub use graph::{Edge, NavGraph};
pub use ids::{EdgeKey, LegKey, Stop, VertexId};
pub use needs::{Berths, Need, Needs, Ride};
pub use plan::{Attach, Leg, NoPath, Plan, Query};
pub use predictor::is_perilous;
pub use progress::Progress;
pub use search::Router;
pub use settings::{BuildError, BuildSettings, GraphId, Placement, Probing, RawBuildSettings, SettingError};
pub use site::{PolicyHash, Site};
pub use surefoot_world::AbilitySet;
pub use traffic::Traffic;
