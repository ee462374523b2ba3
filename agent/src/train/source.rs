//! Where the experience of a run comes from.

use super::collector::{Collector, CollectorState, CollectorStats};
use super::config::TrainConfig;
use super::replay::{Replay, Step};
use super::worlds::{Collected, Connect, Worlds, WorldsState};
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use surefoot_policy::Policy;

/// A source of experience. Its steps come from one or several environments, each with a replay buffer of its own.
#[derive(Debug)]
pub(super) enum Source {
    /// Worlds of this process, step by step: a pure function of the configuration.
    Here(Box<Collector>),
    /// Worlds elsewhere, as they come.
    Elsewhere(Worlds),
}

/// A source as plain data.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum SourceState {
    Here(Box<CollectorState>),
    Elsewhere(WorldsState),
}

impl Source {
    /// The source that `config` asks for; `policy` is that of the run at its beginning.
    pub fn new(config: &TrainConfig, rng: ChaCha8Rng, policy: Policy, connect: &Connect) -> Self {
        if config.worlds.is_empty() {
            Self::Here(Box::new(Collector::new(config.collector.clone(), &config.sac.network, rng)))
        } else {
            Self::Elsewhere(Worlds::start(config, Arc::new(policy), connect, None))
        }
    }

    /// Restores a source; `None` if this cannot be the state of one with this configuration.
    pub fn restore(config: &TrainConfig, state: SourceState, policy: Policy, connect: &Connect) -> Option<Self> {
        match state {
            SourceState::Here(state) if config.worlds.is_empty() => {
                let collector = Collector::restore(config.collector.clone(), &config.sac.network, *state)?;
                Some(Self::Here(Box::new(collector)))
            }
            SourceState::Elsewhere(state) if !config.worlds.is_empty() => {
                Some(Self::Elsewhere(Worlds::start(config, Arc::new(policy), connect, Some(state))))
            }
            _ => None,
        }
    }

    /// The whole state; of worlds elsewhere, what remains of it.
    pub fn save(&self) -> SourceState {
        match self {
            Self::Here(collector) => SourceState::Here(Box::new(collector.save())),
            Self::Elsewhere(worlds) => SourceState::Elsewhere(worlds.save()),
        }
    }

    /// Number of environments whose NPCs decide together.
    pub fn buffer_count(&self) -> usize {
        match self {
            Self::Here(_) => 1,
            Self::Elsewhere(worlds) => worlds.stream_count(),
        }
    }

    /// Number of NPCs.
    pub fn lane_count(&self) -> usize {
        match self {
            Self::Here(collector) => collector.lane_count(),
            Self::Elsewhere(worlds) => worlds.lane_count(),
        }
    }

    /// Empty replay buffers for about `capacity` rows.
    pub fn buffers(&self, capacity: usize) -> Vec<Replay> {
        let count = self.buffer_count();
        (0..count).map(|_| Replay::new(self.lane_count() / count, capacity / count)).collect()
    }

    /// Number of decisions since the beginning of the run.
    pub fn total_decisions(&self) -> u64 {
        match self {
            Self::Here(collector) => collector.total_decisions(),
            Self::Elsewhere(worlds) => worlds.total_decisions(),
        }
    }

    /// Returns and resets the statistics since the last call.
    pub fn take_stats(&mut self) -> CollectorStats {
        match self {
            Self::Here(collector) => collector.take_stats(),
            Self::Elsewhere(worlds) => worlds.take_stats(),
        }
    }

    /// Collects `step_count` decisions of as many NPCs as there are; fewer if `stop` is set meanwhile. `version` is the number of updates
    /// behind `policy`.
    pub fn collect(
        &mut self,
        (policy, version): (Policy, u64),
        step_count: usize,
        stop: &AtomicBool,
    ) -> Vec<(usize, Collected)> {
        let only = |step: Step| (0, Collected::Step(step));
        match self {
            Self::Here(collector) => collector.collect(&policy, version, step_count).into_iter().map(only).collect(),
            Self::Elsewhere(worlds) => worlds.collect(policy, version, step_count, stop),
        }
    }
}
