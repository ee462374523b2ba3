//! Where the experience of a run comes from.

use super::actors::{self, Listener};
use super::collector::{Collector, CollectorState, CollectorStats};
use super::config::TrainConfig;
use super::error::TrainError;
use super::inflow::{Collected, Inflow, InflowState};
use super::replay::{Replay, Step};
use super::worlds::{self, Connect};
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::sync::atomic::AtomicBool;
use surefoot_policy::Policy;

/// What a run needs of the world outside.
pub(super) struct Ties {
    /// Connects to worlds.
    pub connect: Connect,
    /// Where actors connect.
    pub listener: Option<Listener>,
}

/// A source of experience. Its steps come from one or several environments, each with a replay buffer of its own.
#[derive(Debug)]
pub(super) enum Source {
    /// Worlds of this process, step by step: a pure function of the configuration.
    Here(Box<Collector>),
    /// Worlds or actors elsewhere, as they come.
    Elsewhere(Box<Inflow>),
}

/// A source as plain data.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum SourceState {
    Here(Box<CollectorState>),
    Elsewhere(InflowState),
}

impl Source {
    /// The source that `config` asks for; `policy` is that of the run at its beginning.
    ///
    /// # Errors
    /// If actors are to feed the run, but cannot connect.
    pub fn new(config: &TrainConfig, rng: ChaCha8Rng, policy: Policy, ties: Ties) -> Result<Self, TrainError> {
        if config.is_here() {
            let collector = Collector::new(config.collector.clone(), &config.sac.network, rng);
            return Ok(Self::Here(Box::new(collector)));
        }
        Self::elsewhere(config, policy, ties, InflowState::default())
    }

    fn elsewhere(config: &TrainConfig, policy: Policy, ties: Ties, state: InflowState) -> Result<Self, TrainError> {
        let inflow = match ties.listener {
            _ if config.actors == 0 => worlds::start(config, policy, &ties.connect, state),
            Some(listener) => actors::listen(config, policy, listener, state),
            None => {
                let problem = "is above 0, but there is no address at which actors connect: give --listen";
                return Err(TrainError::Config { field: "actors", problem });
            }
        };
        Ok(Self::Elsewhere(Box::new(inflow)))
    }

    /// Restores a source; `None` if this cannot be the state of one with this configuration.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn restore(
        config: &TrainConfig,
        state: SourceState,
        policy: Policy,
        ties: Ties,
    ) -> Result<Option<Self>, TrainError> {
        Ok(match state {
            SourceState::Here(state) if config.is_here() => {
                let collector = Collector::restore(config.collector.clone(), &config.sac.network, *state);
                collector.map(|collector| Self::Here(Box::new(collector)))
            }
            SourceState::Elsewhere(state) if !config.is_here() => Some(Self::elsewhere(config, policy, ties, state)?),
            _ => None,
        })
    }

    /// The whole state; of worlds elsewhere, what remains of it.
    pub fn save(&self) -> SourceState {
        match self {
            Self::Here(collector) => SourceState::Here(Box::new(collector.save())),
            Self::Elsewhere(inflow) => SourceState::Elsewhere(inflow.save()),
        }
    }

    /// Number of environments or actors whose NPCs decide together.
    pub fn buffer_count(&self) -> usize {
        match self {
            Self::Here(_) => 1,
            Self::Elsewhere(inflow) => inflow.source_count(),
        }
    }

    /// Number of NPCs.
    pub fn lane_count(&self) -> usize {
        match self {
            Self::Here(collector) => collector.lane_count(),
            Self::Elsewhere(inflow) => inflow.lane_count(),
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
            Self::Elsewhere(inflow) => inflow.total_decisions(),
        }
    }

    /// Returns and resets the statistics since the last call.
    pub fn take_stats(&mut self) -> CollectorStats {
        match self {
            Self::Here(collector) => collector.take_stats(),
            Self::Elsewhere(inflow) => inflow.take_stats(),
        }
    }

    /// Collects `step_count` decisions of as many NPCs as there are; fewer if `stop` is set meanwhile. `version` is the number of updates
    /// behind `policy`.
    ///
    /// # Errors
    /// If worlds or actors elsewhere send nothing for too long.
    pub fn collect(
        &mut self,
        (policy, version): (Policy, u64),
        step_count: usize,
        stop: &AtomicBool,
    ) -> Result<Vec<(usize, Collected)>, TrainError> {
        let only = |step: Step| (0, Collected::Step(step));
        match self {
            Self::Here(collector) => {
                Ok(collector.collect(&policy, version, step_count).into_iter().map(only).collect())
            }
            Self::Elsewhere(inflow) => inflow.collect((policy, version), step_count, stop),
        }
    }
}
