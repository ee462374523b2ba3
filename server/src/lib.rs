//! The world server: many worlds, each stepped on its own thread, their NPCs and workers, and the gRPC services in front of them.
//!
//! [`hosted`] is one world with the decisions of its NPCs, [`sim`] the thread that steps a world on an absolute 60 Hz schedule,
//! [`figures`] what is known of a world without a call to its thread, [`worlds`] all worlds and their lifecycle,
//! [`store`] where they outlive the process, `lease` a server's time in a fleet. [`registry`] has the connected
//! workers, [`messages`] the messages to and from them, [`envs`] the environments that remote trainers step themselves,
//! [`observer`] what others beside the server see of it. [`grpc`] decodes, calls
//! and encodes, [`wire`] converts. Simulation never runs on tokio's async threads, and only [`grpc`] and [`wire`] know
//! wire types.

mod config;
pub mod envs;
pub mod figures;
pub mod geometry;
pub mod grpc;
pub mod hosted;
pub mod ids;
mod inbox;
mod lease;
pub mod messages;
pub mod metrics;
pub mod observer;
pub mod quota;
pub mod registry;
mod serve;
pub mod sim;
pub mod store;
pub mod times;
mod turns;
pub mod view;
pub mod wire;
pub mod worlds;

pub use config::ServerConfig;
pub use ids::{NpcId, WorldId};
pub use serve::{ServerError, serve, serve_game, serve_observed};
