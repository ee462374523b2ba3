//! Inference for all worlds of a worker: one thread evaluates the policy for all rows that have arrived, so that
//! batches grow with the load. Decisions do not depend on the batch, so lockstep worlds repeat themselves.

use std::sync::mpsc;
use surefoot_policy::{Batch, Policy, Scratch};
use surefoot_world::Action;
use tokio::sync::oneshot;

/// Most observations that are evaluated together, unless one batch has more.
const MAX_ROWS: usize = 512;

/// Observations of one world's NPCs: rows of observations, hidden states and noise, as [`Policy::act`] takes them.
#[derive(Debug, Default)]
pub(super) struct Rows {
    pub observations: Vec<f32>,
    pub memory: Vec<f32>,
    pub noise: Vec<f32>,
}

impl Rows {
    /// Evaluates the policy: actions and the next hidden states.
    pub fn decide(self, policy: &Policy, scratch: &mut Scratch) -> Decided {
        let Self { observations, mut memory, noise } = self;
        let mut actions = Vec::new();
        let batch = Batch { observations: &observations, memory: &mut memory, noise: &noise };
        policy.act(batch, scratch, &mut actions);
        Decided { actions, memory }
    }

    fn append(&mut self, other: &mut Self) {
        self.observations.append(&mut other.observations);
        self.memory.append(&mut other.memory);
        self.noise.append(&mut other.noise);
    }
}

/// What the policy decided.
#[derive(Debug, Default)]
pub(super) struct Decided {
    /// One action for each row.
    pub actions: Vec<Action>,
    /// Hidden states for the next decision.
    pub memory: Vec<f32>,
}

struct Request {
    /// Number of rows, which are joined with those of others.
    count: usize,
    rows: Rows,
    answer: oneshot::Sender<Decided>,
}

/// The thread that evaluates the policy; it ends with its last clone.
#[derive(Debug, Clone)]
pub(super) struct Inference {
    /// Number of values of an observation.
    observation_len: usize,
    requests: mpsc::Sender<Request>,
}

impl Inference {
    /// Starts the thread.
    pub fn start(policy: Policy) -> std::io::Result<Self> {
        let (requests, waiting) = mpsc::channel();
        let observation_len = policy.observation_len();
        std::thread::Builder::new().name("inference".to_owned()).spawn(move || evaluate(&policy, &waiting))?;
        Ok(Self { observation_len, requests })
    }

    /// Decides for all rows; `None` if evaluating the policy panicked.
    pub async fn decide(&self, rows: Rows) -> Option<Decided> {
        let (answer, decided) = oneshot::channel();
        self.requests.send(Request { count: rows.observations.len() / self.observation_len, rows, answer }).ok()?;
        decided.await.ok()
    }
}

fn evaluate(policy: &Policy, waiting: &mpsc::Receiver<Request>) {
    let mut scratch = Scratch::default();
    while let Ok(first) = waiting.recv() {
        let mut batch = vec![first];
        let mut row_count = batch[0].count;
        while row_count < MAX_ROWS
            && let Ok(next) = waiting.try_recv()
        {
            row_count += next.count;
            batch.push(next);
        }
        let mut rows = Rows::default();
        batch.iter_mut().for_each(|request| rows.append(&mut request.rows));
        let Decided { actions, memory } = rows.decide(policy, &mut scratch);
        let (mut actions, mut memory) = (actions.into_iter(), memory.chunks_exact(policy.memory_len().max(1)));
        for Request { count, answer, .. } in batch {
            let decided = Decided {
                actions: actions.by_ref().take(count).collect(),
                memory: memory.by_ref().take(count).flatten().copied().collect(),
            };
            // The world may have ended.
            let _ = answer.send(decided);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surefoot_world::OBSERVATION_LEN;
    use surefoot_world::character::ACTION_LEN;

    fn rows(count: usize, seed: usize, memory_len: usize) -> Rows {
        let value = |idx: usize| ((idx * 7 + seed * 13) % 11) as f32 / 11.0;
        Rows {
            observations: (0..count * OBSERVATION_LEN).map(value).collect(),
            memory: vec![0.0; count * memory_len],
            noise: (0..count * ACTION_LEN).map(value).collect(),
        }
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn each_caller_gets_the_decisions_for_its_own_rows() {
        let policy = Policy::shipped().expect("the shipped weights are valid");
        let inference = Inference::start(policy.clone()).expect("a thread");
        let asked = (0..40_usize).map(|seed| {
            let (inference, policy) = (inference.clone(), policy.clone());
            tokio::spawn(async move {
                let count = seed % 5;
                let shared = inference.decide(rows(count, seed, policy.memory_len())).await.expect("an answer");
                let alone = rows(count, seed, policy.memory_len()).decide(&policy, &mut Scratch::default());
                assert_eq!(shared.actions.len(), count);
                assert_eq!((shared.actions, shared.memory), (alone.actions, alone.memory));
            })
        });
        for task in asked.collect::<Vec<_>>() {
            task.await.expect("equal decisions");
        }
    }
}
