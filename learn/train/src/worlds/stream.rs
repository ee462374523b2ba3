//! One environment: observe, ask the brain, step the world, hand the rows to the learner.

use super::brain::{Answer, Brain};
use super::lanes::{Lanes, Settled};
use super::place::{Connect, Place};
use crate::arena::Arena;
use crate::config::CollectorConfig;
use crate::inflow::{Arrival, Inlet, Meters};
use crate::replay::Step;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::ops::ControlFlow;
use std::time::Duration;
use surefoot_game_client::{GameError, Level};

/// First and longest wait before a world that went away is tried again.
const RETRY: (Duration, Duration) = (Duration::from_millis(250), Duration::from_secs(10));
/// Interval at which a stream that waits looks whether it should stop.
const LOOK: Duration = Duration::from_millis(50);

/// One environment, which a thread steps.
pub(super) struct Stream {
    pub idx: usize,
    pub place: Place,
    pub config: CollectorConfig,
    /// Values that each NPC remembers.
    pub memory_len: usize,
    /// Steps after which it goes on on another map, where maps are generated.
    pub steps_per_map: u64,
    pub seed: u64,
    pub connect: Connect,
    pub brain: Brain,
    pub inlet: Inlet,
}

/// What ends the steps of an environment.
enum Over {
    /// It is time for another map.
    Map,
    /// The run is over.
    Run,
    /// The world is of no use.
    World(GameError),
}

impl From<GameError> for Over {
    fn from(error: GameError) -> Self {
        Self::World(error)
    }
}

impl Stream {
    /// Runs environments until the run is over.
    pub fn run(self) {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(1000 + self.idx as u64);
        let mut wait = RETRY.0;
        loop {
            let mut step_count = 0;
            let over = self.run_env(&mut rng, &mut step_count).expect_err("steps go on until something ends them");
            if step_count > 0 {
                wait = RETRY.0;
            }
            let is_lost = match over {
                Over::Run => return,
                Over::Map => false,
                Over::World(error) => {
                    tracing::warn!(stream = self.idx, "{error}; trying again in {:.2} s", wait.as_secs_f32());
                    true
                }
            };
            if self.inlet.send(self.idx, Arrival::Closed { is_lost }).is_break()
                || is_lost && self.pause(wait).is_break()
            {
                return;
            }
            wait = if is_lost { (2 * wait).min(RETRY.1) } else { RETRY.0 };
        }
    }

    /// Runs one environment.
    fn run_env(&self, rng: &mut ChaCha8Rng, step_count: &mut u64) -> Result<std::convert::Infallible, Over> {
        let drawn = self.config.map_seeds[rng.random_range(0..self.config.map_seeds.len())];
        let (arena, map, body) = Arena::on_some_map(self.place.level.unwrap_or(drawn), &self.config);
        let game = (self.connect)(&self.place.uri)?;
        let (mut lanes, goals) = Lanes::new(arena, &self.config, ChaCha8Rng::seed_from_u64(rng.random()));
        let mut env = game.open(&Level { map, body, solid_npcs: false }, &goals)?;
        let _live = self.inlet.meters.live();
        let mut is_fresh = vec![true; goals.len()];
        let mut memory = vec![0.0; goals.len() * self.memory_len];
        let does_rotate = self.place.level.is_none() && self.config.map_seeds.len() > 1;
        while !does_rotate || *step_count < self.steps_per_map {
            let observations = env.state().observations.clone();
            let Answer { actions, memory: after, version } =
                self.brain.decide(observations.clone(), memory.clone()).ok_or(Over::Run)?;
            let state = env.step(&actions, &lanes.routes())?;
            let Settled { kinds, rewards, fresh, stats } = lanes.settle(state);
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
            Meters::add(&self.inlet.meters.encode_us, env.take_encode_time());
            *step_count += 1;
            if self.inlet.send(self.idx, Arrival::Step(step, stats)).is_break() {
                return Err(Over::Run);
            }
        }
        Err(Over::Map)
    }

    /// Waits; `Break` when the run is over.
    fn pause(&self, time: Duration) -> ControlFlow<()> {
        let mut left = time;
        while !left.is_zero() {
            if self.inlet.is_over() {
                return ControlFlow::Break(());
            }
            let part = left.min(LOOK);
            std::thread::sleep(part);
            left -= part;
        }
        ControlFlow::Continue(())
    }
}
