//! Soft actor-critic training of reactive and recurrent agents.
//!
//! Start at [`run`](mod@run). A run is a sequence of rounds. In each, the [`collector`] and the [`learner`] work
//! concurrently, on one thread each, and meet at a barrier, where the collected steps go into the [`replay`] buffer. So
//! a run is a pure function of its configuration ([`config`]), and a checkpoint taken at a barrier (`state`) resumes
//! exactly. Experience may also come from [`worlds`] or [`actors`] in other processes, at their own pace; such a run
//! resumes without its running attempts. [`losses`] follows the paper's equations; docs/guides/training.md lists
//! the differences, with reasons. [`networks`] has the networks.

pub mod actors;
mod adam;
mod arena;
mod batch;
pub mod collector;
pub mod config;
pub mod critic;
mod error;
pub mod experience;
pub mod learner;
mod log;
pub mod losses;
mod mlflow;
pub mod networks;
pub mod replay;
mod rng;
pub mod run;
mod source;
pub mod stages;
mod state;
mod tensorboard;
mod validation;
pub mod worlds;

pub use config::{CollectorConfig, Processor, SacConfig, TrainConfig};
pub use error::TrainError;
pub use learner::Learner;
pub use run::{Run, RunArgs, run};
pub use state::census_of;
