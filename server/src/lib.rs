//! The world server: worlds, each stepped on its own thread, their NPCs and workers, and the gRPC services for them.
//!
//! [`hosted`] is one world with the decisions of its NPCs. `sim` is the thread that steps a world on an absolute 60
//! Hz schedule, `figures` its figures for other threads. `worlds` has all worlds and their lifecycle, [`store`] the
//! interface of stores that outlive the process, `lease` the lease of a server of a fleet. [`registry`] has the
//! connected workers, [`messages`] the messages to and from them. `envs` has the environments of remote trainers.
//! [`observer`] shows the state of a server to the rest of the process. `grpc` decodes, calls and encodes, `wire`
//! converts. Simulation never runs on tokio's async threads, and only `grpc` and `wire` know wire types.

mod config;
mod envs;
mod figures;
mod geometry;
mod grpc;
pub mod hosted;
pub mod ids;
mod inbox;
mod lease;
pub mod messages;
mod metrics;
pub mod observer;
pub mod quota;
pub mod registry;
mod segments;
mod serve;
mod sim;
pub mod store;
pub mod times;
mod turns;
mod view;
mod wire;
mod worlds;

pub use config::ServerConfig;
pub use envs::Host;
pub use ids::{NpcId, WorldId};
pub use serve::{ServerError, serve, serve_game, serve_observed};
pub use wire::worker;
pub use worlds::{WorldSettings, Worlds};
