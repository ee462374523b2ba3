//! The world server: many worlds, each stepped on a thread of its own, NPCs, workers, and the gRPC face of it all.
//!
//! [`hosted`] is one world with its NPCs' decisions, [`sim`] the thread that steps it on an absolute 60 Hz schedule, [`worlds`] all
//! of them with their lifecycle, [`registry`] the workers and [`messages`] what they are sent, [`envs`] worlds that remote trainers
//! step themselves. [`grpc`] decodes, calls and encodes, [`wire`] converts. Simulation never runs on tokio's threads, and nothing
//! but [`grpc`] and [`wire`] knows a wire type.

mod config;
pub mod envs;
pub mod errors;
pub mod geometry;
pub mod grpc;
pub mod hosted;
pub mod ids;
mod inbox;
pub mod messages;
pub mod metrics;
pub mod quota;
pub mod registry;
mod serve;
pub mod sim;
pub mod times;
pub mod view;
pub mod wire;
pub mod worlds;

pub use config::ServerConfig;
pub use ids::{NpcId, WorldId};
pub use serve::{ServerError, serve};
