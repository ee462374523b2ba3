//! Inference for all environments, on one thread.

use crate::config::TrainConfig;
use crate::experience::{ExperienceSender, Meters};
use crate::rng::random_action;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Instant;
use surefoot_policy::{Batch, Scratch, noise};
use surefoot_world::Action;
use surefoot_world::sense::OBSERVATION_LEN;

/// Most NPCs of a batch, unless one environment has more.
const MAX_ROWS: usize = 4096;

/// The NPCs of one environment, which wait for their actions.
struct InferenceRequest {
    observations: Vec<f32>,
    memory: Vec<f32>,
    answer: Sender<Decided>,
}

/// Actions, memory rows after them, and the version of the weights.
pub(super) struct Decided {
    pub actions: Vec<Action>,
    pub memory: Vec<f32>,
    pub version: u64,
}

/// Sends requests to the inference thread; clones share it.
#[derive(Clone)]
pub(super) struct SharedInference {
    requests: Sender<InferenceRequest>,
}

impl SharedInference {
    /// Starts the thread. It ends when all clones are dropped.
    pub fn start(config: &TrainConfig, experience: ExperienceSender, decisions_before: u64) -> Self {
        let (requests, waiting) = channel();
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed ^ decisions_before);
        rng.set_stream(12);
        let random_decisions = config.collector.random_decisions;
        let mut thread = InferenceThread { waiting, experience, random_decisions, rng, scratch: Scratch::default() };
        std::thread::spawn(move || while thread.decide().is_some() {});
        Self { requests }
    }

    /// Waits for the actions of NPCs with these rows; `None` when the run is over.
    pub fn decide(&self, observations: Vec<f32>, memory: Vec<f32>) -> Option<Decided> {
        let (answer, answered) = channel();
        self.requests.send(InferenceRequest { observations, memory, answer }).ok()?;
        answered.recv().ok()
    }
}

struct InferenceThread {
    waiting: Receiver<InferenceRequest>,
    experience: ExperienceSender,
    random_decisions: u64,
    rng: ChaCha8Rng,
    scratch: Scratch,
}

impl InferenceThread {
    /// Answers all waiting requests, or waits for the first one; `None` when all senders are dropped.
    fn decide(&mut self) -> Option<()> {
        let mut requests = vec![self.waiting.recv().ok()?];
        let mut row_count = requests[0].observations.len() / OBSERVATION_LEN;
        while row_count < MAX_ROWS {
            let Ok(request) = self.waiting.try_recv() else { break };
            row_count += request.observations.len() / OBSERVATION_LEN;
            requests.push(request);
        }
        let started = Instant::now();
        let (policy, version) = self.experience.policies.borrow().clone();
        let gather = |field: fn(&InferenceRequest) -> &Vec<f32>| requests.iter().flat_map(field).copied().collect();
        let observations: Vec<f32> = gather(|request| &request.observations);
        let mut memory: Vec<f32> = gather(|request| &request.memory);
        let mut actions = Vec::new();
        let before = self.experience.meters.decisions.fetch_add(row_count as u64, Ordering::Relaxed);
        if before < self.random_decisions {
            actions.extend((0..row_count).map(|_| random_action(&mut self.rng)));
        } else {
            let noise = noise::for_rows(&mut self.rng, 1.0, row_count);
            let batch = Batch { observations: &observations, memory: &mut memory, noise: &noise };
            policy.act(batch, &mut self.scratch, &mut actions);
        }
        let (mut actions, mut memory) = (actions.into_iter(), memory.as_slice());
        for request in requests {
            let (own, rest) = memory.split_at(request.memory.len());
            memory = rest;
            let own_actions = actions.by_ref().take(request.observations.len() / OBSERVATION_LEN).collect();
            // The environment may have stopped waiting.
            let _ = request.answer.send(Decided { actions: own_actions, memory: own.to_vec(), version });
        }
        Meters::add(&self.experience.meters.act_us, started.elapsed());
        Some(())
    }
}
