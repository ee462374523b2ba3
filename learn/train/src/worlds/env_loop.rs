//! One environment: observe, decide, step the world, send the rows to the learner.

use super::inference::{Decided, SharedInference};
use super::npc_tasks::{NpcTasks, Settled};
use crate::arena::Arena;
use crate::config::CollectorConfig;
use crate::experience::{Delivery, ExperienceSender, Meters};
use crate::replay::Step;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Duration;
use surefoot_game_client::{Game, GameError, Level};

/// First and longest wait before a world that went away is tried again.
const RETRY: (Duration, Duration) = (Duration::from_millis(250), Duration::from_secs(10));
/// Interval at which a waiting loop checks whether the run is over.
const LOOK: Duration = Duration::from_millis(50);

/// Connects to the world at an address.
pub type Connect = Arc<dyn Fn(&str) -> Result<Game, GameError> + Send + Sync>;

/// Where an environment runs.
#[derive(Debug, Clone)]
pub(super) struct EnvAddress {
    /// Address of the world.
    pub uri: String,
    /// Index of the world's saved level; `None` if its maps are generated.
    pub level: Option<u64>,
}

/// The loop of one environment.
pub(super) struct EnvLoop {
    pub idx: usize,
    pub address: EnvAddress,
    pub config: CollectorConfig,
    /// Number of values in an NPC's memory row.
    pub memory_len: usize,
    /// Steps until the next map, where maps are generated.
    pub steps_per_map: u64,
    pub seed: u64,
    pub connect: Connect,
    pub inference: SharedInference,
    pub experience: ExperienceSender,
}

/// What ends the steps of an environment.
enum Over {
    /// The next map is due.
    Map,
    /// The run is over.
    Run,
    /// The world has failed.
    World(GameError),
}

impl From<GameError> for Over {
    fn from(error: GameError) -> Self {
        Self::World(error)
    }
}

impl EnvLoop {
    /// Runs environments until the run is over.
    pub fn run(self) {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(1000 + self.idx as u64);
        let mut wait = RETRY.0;
        loop {
            let mut step_count = 0;
            let over = self.run_env(&mut rng, &mut step_count).expect_err("steps end for a reason");
            if step_count > 0 {
                wait = RETRY.0;
            }
            let is_lost = match over {
                Over::Run => return,
                Over::Map => false,
                Over::World(error) => {
                    tracing::warn!(environment = self.idx, "{error}; retrying in {:.2} s", wait.as_secs_f32());
                    true
                }
            };
            if self.experience.send(self.idx, Delivery::Closed { is_lost }).is_break()
                || is_lost && self.pause(wait).is_break()
            {
                return;
            }
            wait = if is_lost { (2 * wait).min(RETRY.1) } else { RETRY.0 };
        }
    }

    /// Runs an environment on one map.
    fn run_env(&self, rng: &mut ChaCha8Rng, step_count: &mut u64) -> Result<std::convert::Infallible, Over> {
        let drawn = self.config.map_seeds[rng.random_range(0..self.config.map_seeds.len())];
        let (arena, map, body) = Arena::on_some_map(self.address.level.unwrap_or(drawn), &self.config);
        let game = (self.connect)(&self.address.uri)?;
        let (mut tasks, goals) = NpcTasks::new(arena, &self.config, ChaCha8Rng::seed_from_u64(rng.random()));
        let mut env = game.open(&Level { map, body, solid_npcs: false }, &goals)?;
        let _live = self.experience.meters.live();
        let mut is_fresh = vec![true; goals.len()];
        let mut memory = vec![0.0; goals.len() * self.memory_len];
        let does_rotate = self.address.level.is_none() && self.config.map_seeds.len() > 1;
        while !does_rotate || *step_count < self.steps_per_map {
            let observations = env.state().observations.clone();
            let Decided { actions, memory: after, version } =
                self.inference.decide(observations.clone(), memory.clone()).ok_or(Over::Run)?;
            let state = env.step(&actions, &tasks.routes())?;
            let Settled { kinds, rewards, fresh, stats } = tasks.settle(state);
            let step = Step {
                observations,
                memory: std::mem::replace(&mut memory, after),
                is_fresh: std::mem::replace(&mut is_fresh, vec![false; goals.len()]),
                actions: actions.iter().map(|action| action.to_array()).collect(),
                rewards,
                kinds,
                version,
            };
            for npc_idx in fresh {
                is_fresh[npc_idx] = true;
                memory[npc_idx * self.memory_len..][..self.memory_len].fill(0.0);
            }
            Meters::add(&self.experience.meters.encode_us, env.take_encode_time());
            *step_count += 1;
            if self.experience.send(self.idx, Delivery::Step(step, stats)).is_break() {
                return Err(Over::Run);
            }
        }
        Err(Over::Map)
    }

    /// Waits; `Break` when the run is over.
    fn pause(&self, time: Duration) -> ControlFlow<()> {
        let mut left = time;
        while !left.is_zero() {
            if self.experience.is_over() {
                return ControlFlow::Break(());
            }
            let part = left.min(LOOK);
            std::thread::sleep(part);
            left -= part;
        }
        ControlFlow::Continue(())
    }
}
