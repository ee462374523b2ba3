//! Experience from worlds in other processes: servers of ours, or games that serve environments
//! (docs/guides/game-as-world.md).
//!
//! Each environment has an `EnvLoop` on a thread of its own, with the attempts that `npc_tasks` draws. All loops
//! share one `SharedInference`, which decides for all waiting NPCs at once (Espeholt et al. 2020, "SEED RL":
//! inference where the learner is). While one environment of a world moves, another one decides. When a world goes
//! away, its running attempts are lost, and its loops retry until it is back.

mod env_loop;
mod inference;
mod npc_tasks;

pub use env_loop::Connect;

use super::config::TrainConfig;
use super::experience::{ExperienceReceiver, ExperienceState};
use env_loop::{EnvAddress, EnvLoop};
use inference::SharedInference;
use surefoot_policy::Policy;

/// Starts the loops of `config.worlds`. They connect by themselves, and again when a connection is lost.
pub(super) fn start(
    config: &TrainConfig,
    policy: Policy,
    connect: &Connect,
    state: ExperienceState,
) -> ExperienceReceiver {
    let addresses = addresses(config);
    let sizes = (addresses.len(), config.collector.npcs_per_world);
    let (receiver, experience) = ExperienceReceiver::open(config, sizes, policy, state);
    let decisions_before = receiver.total_decisions();
    let inference = SharedInference::start(config, experience.clone(), decisions_before);
    for (idx, address) in addresses.into_iter().enumerate() {
        let env_loop = EnvLoop {
            idx,
            address,
            config: config.collector.clone(),
            memory_len: config.sac.network.hidden_len(),
            steps_per_map: (config.steps_per_round as u64).saturating_mul(config.collector.rounds_per_map),
            // A resumed run draws other goals than before.
            seed: config.seed ^ decisions_before.wrapping_mul(0x9E37_79B9_7F4A_7C15),
            connect: connect.clone(),
            inference: inference.clone(),
            experience: experience.clone(),
        };
        std::thread::spawn(move || env_loop.run());
    }
    receiver
}

/// Addresses of a run's environments, world by world.
fn addresses(config: &TrainConfig) -> Vec<EnvAddress> {
    let level_count = config.collector.levels.len();
    let address = |(idx, uri): (usize, &String)| {
        let level = (level_count > 0).then(|| (idx % level_count) as u64);
        std::iter::repeat_n(EnvAddress { uri: uri.clone(), level }, config.envs_per_world)
    };
    config.worlds.iter().enumerate().flat_map(address).collect()
}
