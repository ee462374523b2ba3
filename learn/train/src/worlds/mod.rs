//! Experience from worlds that run elsewhere: servers of ours, or games that serve environments (docs/games.md).
//!
//! Every environment is stepped by a `stream` of its own, with the goals and attempts that `lanes` draws, and all of them ask one
//! `brain` for their actions: it decides for as many NPCs at once as happen to wait (Espeholt et al. 2020, "SEED RL": inference where the
//! learner is). While one environment of a world moves, others of it decide. A world that goes away costs its running attempts; its
//! streams wait until it is back.

mod brain;
mod lanes;
mod place;
mod stream;

pub use place::Connect;

use super::config::TrainConfig;
use super::inflow::{Inflow, InflowState};
use brain::Brain;
use place::Place;
use stream::Stream;
use surefoot_policy::Policy;

/// Starts the streams of `config.worlds`, which connect on their own, and again when a connection is lost.
pub(super) fn start(config: &TrainConfig, policy: Policy, connect: &Connect, state: InflowState) -> Inflow {
    let places = places(config);
    let (inflow, inlet) = Inflow::open(config, (places.len(), config.collector.npcs_per_world), policy, state);
    let decisions_before = inflow.total_decisions();
    let brain = Brain::start(config, inlet.clone(), decisions_before);
    for (idx, place) in places.into_iter().enumerate() {
        let stream = Stream {
            idx,
            place,
            config: config.collector.clone(),
            memory_len: config.sac.network.hidden_len(),
            steps_per_map: (config.steps_per_round as u64).saturating_mul(config.collector.rounds_per_map),
            // A run that is continued draws other goals than before.
            seed: config.seed ^ decisions_before.wrapping_mul(0x9E37_79B9_7F4A_7C15),
            connect: connect.clone(),
            brain: brain.clone(),
            inlet: inlet.clone(),
        };
        std::thread::spawn(move || stream.run());
    }
    inflow
}

/// The environments of a run: those of the first world, of the second one, and so on.
fn places(config: &TrainConfig) -> Vec<Place> {
    let level_count = config.collector.levels.len();
    let place = |(idx, uri): (usize, &String)| {
        let level = (level_count > 0).then(|| (idx % level_count) as u64);
        std::iter::repeat_n(Place { uri: uri.clone(), level }, config.envs_per_world)
    };
    config.worlds.iter().enumerate().flat_map(place).collect()
}
