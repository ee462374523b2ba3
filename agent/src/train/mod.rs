//! Soft actor-critic training of reactive and recurrent agents.
//!
//! Read [`sac`] against the paper (losses with their equation numbers), [`replay`] for what is remembered,
//! [`collector`] for where it comes from, and [`run`] for how a run goes on: rounds in which collecting and
//! learning happen side by side, on one thread each, and meet at a barrier. That makes a run a pure function
//! of its configuration, so that a checkpoint taken at a barrier continues exactly.

mod adam;
pub mod collector;
pub mod critic;
pub mod replay;
pub mod run;
pub mod sac;
mod tensorboard;

pub use run::{TrainConfig, TrainError, run};
