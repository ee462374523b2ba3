//! Inference: actor networks, checkpoints and batched policy evaluation.
//!
//! This crate turns observation rows (`surefoot_world::sense`) into actions. It knows nothing of training, sockets or
//! graphs. Start at [`Policy`], which is built from [`actor`], [`network`], and the layers [`dense`] and [`lstm`] with their fast
//! paths in [`cpu`]. [`FlatActor`] is the same network for callers who must not allocate.

pub mod actor;
pub mod checkpoint;
pub mod config;
pub mod cpu;
pub mod dense;
pub mod exchange;
mod flat;
pub mod lstm;
mod manifest;
pub mod memories;
pub mod network;
mod policy;
pub mod state;

pub use actor::Actor;
pub use config::ActorConfig;
pub use flat::{FlatActor, FlatScratch};
pub use manifest::{CheckpointError, Manifest};
pub use memories::HiddenStates;
pub use policy::Policy;
