//! Inference for all environments in one place.

use crate::config::TrainConfig;
use crate::inflow::{Inlet, Meters};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Instant;
use surefoot_policy::{Batch, Scratch, noise};
use surefoot_world::Action;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::sense::OBSERVATION_LEN;

/// Most NPCs for which it decides at once.
const MAX_ROWS: usize = 4096;

/// NPCs that wait for their actions.
struct Ask {
    observations: Vec<f32>,
    memory: Vec<f32>,
    answer: Sender<Answer>,
}

/// What NPCs do, what they remember then, and the version of the weights that decided.
pub(super) struct Answer {
    pub actions: Vec<Action>,
    pub memory: Vec<f32>,
    pub version: u64,
}

/// The way to the thread that decides; clones share it.
#[derive(Clone)]
pub(super) struct Brain {
    asks: Sender<Ask>,
}

impl Brain {
    /// Starts the thread, which ends when all that can ask are gone.
    pub fn start(config: &TrainConfig, inlet: Inlet, decisions_before: u64) -> Self {
        let (asks, waiting) = channel();
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed ^ decisions_before);
        rng.set_stream(12);
        let random_decisions = config.collector.random_decisions;
        let mut thinker = Thinker { waiting, inlet, random_decisions, rng, scratch: Scratch::default() };
        std::thread::spawn(move || while thinker.decide().is_some() {});
        Self { asks }
    }

    /// Waits for the actions of these NPCs, with a row of memory for each; `None` when the run is over.
    pub fn decide(&self, observations: Vec<f32>, memory: Vec<f32>) -> Option<Answer> {
        let (answer, answered) = channel();
        self.asks.send(Ask { observations, memory, answer }).ok()?;
        answered.recv().ok()
    }
}

struct Thinker {
    waiting: Receiver<Ask>,
    inlet: Inlet,
    random_decisions: u64,
    rng: ChaCha8Rng,
    scratch: Scratch,
}

impl Thinker {
    /// Answers everybody who waits, or waits for the first; `None` when nobody will.
    fn decide(&mut self) -> Option<()> {
        let mut asks = vec![self.waiting.recv().ok()?];
        let mut row_count = asks[0].observations.len() / OBSERVATION_LEN;
        while row_count < MAX_ROWS {
            let Ok(ask) = self.waiting.try_recv() else { break };
            row_count += ask.observations.len() / OBSERVATION_LEN;
            asks.push(ask);
        }
        let started = Instant::now();
        let (policy, version) = self.inlet.policies.borrow().clone();
        let gather = |field: fn(&Ask) -> &Vec<f32>| asks.iter().flat_map(field).copied().collect::<Vec<f32>>();
        let (observations, mut memory) = (gather(|ask| &ask.observations), gather(|ask| &ask.memory));
        let mut actions = Vec::new();
        let before = self.inlet.meters.decisions.fetch_add(row_count as u64, Ordering::Relaxed);
        if before < self.random_decisions {
            let rng = &mut self.rng;
            let mut draw = || [(); ACTION_LEN].map(|()| rng.random_range(-1.0..1.0));
            actions.extend((0..row_count).map(|_| Action::from_array(draw()).expect("drawn actions are finite")));
        } else {
            let noise = noise::for_rows(&mut self.rng, 1.0, row_count);
            let batch = Batch { observations: &observations, memory: &mut memory, noise: &noise };
            policy.act(batch, &mut self.scratch, &mut actions);
        }
        let (mut actions, mut memory) = (actions.into_iter(), memory.as_slice());
        for ask in asks {
            let (own, rest) = memory.split_at(ask.memory.len());
            memory = rest;
            let own_actions = actions.by_ref().take(ask.observations.len() / OBSERVATION_LEN).collect();
            // Whoever is gone needs no answer.
            let _ = ask.answer.send(Answer { actions: own_actions, memory: own.to_vec(), version });
        }
        Meters::add(&self.inlet.meters.act_us, started.elapsed());
        Some(())
    }
}
