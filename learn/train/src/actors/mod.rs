//! Experience from actors: processes that decide on their own, with weights that the learner sends them now and then, and that send back
//! what their NPCs did (`surefoot train --listen`, `surefoot act`).
//!
//! `service` is the learner's side, with a place for each actor in `slots`; [`actor`] is the other one; `wire` has the messages.

pub mod actor;
mod service;
pub(super) mod slots;
mod wire;

pub use service::Listener;

use super::config::TrainConfig;
use super::inflow::{Inflow, InflowState};
use surefoot_policy::Policy;

/// Takes in the steps of `config.actors` actors, which connect to `listener`.
pub(super) fn listen(config: &TrainConfig, policy: Policy, listener: Listener, state: InflowState) -> Inflow {
    let npc_count = npc_count(config);
    let (inflow, inlet) = Inflow::open(config, (config.actors, npc_count), policy, state);
    service::start(config, listener, inflow.slots.clone(), inlet);
    inflow
}

/// Number of NPCs of each actor.
fn npc_count(config: &TrainConfig) -> usize {
    config.collector.world_count * config.collector.npcs_per_world
}
