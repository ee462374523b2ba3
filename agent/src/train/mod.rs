//! Soft actor-critic training of reactive and recurrent agents.
//!
//! Read [`run`](mod@run) for how a run goes on: rounds in which collecting ([`collector`]) and learning ([`learner`]) happen side
//! by side, on one thread each, and meet at a barrier where what was collected goes into the [`replay`] buffer. That makes a run
//! a pure function of its configuration ([`config`]), so that a checkpoint taken at a barrier (`state`) continues exactly.
//! [`losses`] can be read against the paper; docs/training-and-models.md lists where we differ from it, and why.

mod adam;
mod arena;
mod batch;
pub mod collector;
pub mod config;
pub mod critic;
mod error;
pub mod learner;
mod log;
pub mod losses;
pub mod replay;
mod rng;
pub mod run;
mod squash;
mod state;
mod tensorboard;
mod validation;

pub use config::{CollectorConfig, Processor, SacConfig, TrainConfig};
pub use error::TrainError;
pub use learner::Learner;
pub use run::{Run, run};
pub use squash::sample_squashed;
