//! Inference: turns rows of observations (`surefoot_world::sense`) into actions.
//!
//! Start at [`Policy`]. It holds an [`Actor`]; the one that [`Policy::from_bytes`] makes is [`CpuActor`], which
//! allocates nothing and whose results do not depend on the batch. burn's network, from whose records [`Weights`] are
//! read, is in `surefoot-train`, with a test that compares the two. This crate knows nothing of training, sockets or
//! graphs.

pub mod activation;
mod actor;
pub mod checkpoint;
pub mod config;
mod cpu_actor;
mod hidden;
mod manifest;
mod matrix;
pub mod noise;
mod policy;
mod weights;

pub use actor::{Actor, Batch, Scratch};
pub use config::ActorConfig;
pub use cpu_actor::CpuActor;
pub use hidden::HiddenStates;
pub use manifest::{CheckpointError, Manifest};
pub use policy::Policy;
pub use weights::{Parameter, Weights};
