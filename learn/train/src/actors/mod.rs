//! Experience from actors: processes that run the policy themselves and send their steps to the learner (`surefoot
//! train --listen`, `surefoot act`). The learner sends them new weights at intervals.
//!
//! `service` is the learner's side, with a slot for each actor in `slots`; [`actor`] is the actor's side; `wire` has
//! the messages.

pub mod actor;
mod service;
pub(super) mod slots;
mod wire;

pub use service::Listener;

use super::config::TrainConfig;
use super::experience::{ExperienceReceiver, ExperienceState};
use surefoot_policy::Policy;

/// Receives the steps of `config.actors` actors, which connect to `listener`.
pub(super) fn listen(
    config: &TrainConfig,
    policy: Policy,
    listener: Listener,
    state: ExperienceState,
) -> ExperienceReceiver {
    let npc_count = npc_count(config);
    let (receiver, experience) = ExperienceReceiver::open(config, (config.actors, npc_count), policy, state);
    service::start(config, listener, receiver.slots.clone(), experience);
    receiver
}

/// Number of NPCs of each actor.
fn npc_count(config: &TrainConfig) -> usize {
    config.collector.world_count * config.collector.npcs_per_world
}
