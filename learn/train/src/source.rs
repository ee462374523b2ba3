//! The source of a run's experience: worlds in this process, or sources in other processes.

use super::actors::{self, Listener};
use super::collector::{Collector, CollectorState, CollectorStats};
use super::config::TrainConfig;
use super::error::TrainError;
use super::experience::{Collected, ExperienceReceiver, ExperienceState};
use super::replay::{Replay, Step};
use super::worlds::{self, Connect};
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::sync::atomic::AtomicBool;
use surefoot_policy::Policy;

/// Connections of a run to other processes.
pub(super) struct RunIo {
    /// Connects to worlds.
    pub connect: Connect,
    /// The endpoint for actors.
    pub listener: Option<Listener>,
}

/// A source of experience. Each of its environments or actors has a replay buffer.
#[derive(Debug)]
pub(super) enum Source {
    /// Worlds in this process: a pure function of the configuration.
    Here(Box<Collector>),
    /// Worlds or actors in other processes, at their own pace.
    Elsewhere(Box<ExperienceReceiver>),
}

/// A source as plain data.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum SourceState {
    Here(Box<CollectorState>),
    Elsewhere(ExperienceState),
}

impl Source {
    /// Creates the source that `config` describes; `policy` is the run's initial policy.
    ///
    /// # Errors
    /// If the run needs actors but has no endpoint for them.
    pub fn new(config: &TrainConfig, rng: ChaCha8Rng, policy: Policy, io: RunIo) -> Result<Self, TrainError> {
        if config.is_here() {
            let collector = Collector::new(config.collector.clone(), &config.sac.network, rng);
            return Ok(Self::Here(Box::new(collector)));
        }
        Self::elsewhere(config, policy, io, ExperienceState::default())
    }

    fn elsewhere(config: &TrainConfig, policy: Policy, io: RunIo, state: ExperienceState) -> Result<Self, TrainError> {
        let receiver = match io.listener {
            _ if config.actors == 0 => worlds::start(config, policy, &io.connect, state),
            Some(listener) => actors::listen(config, policy, listener, state),
            None => {
                let problem = "is above 0, but actors have no address to connect to: give --listen";
                return Err(TrainError::Config { field: "actors", problem });
            }
        };
        Ok(Self::Elsewhere(Box::new(receiver)))
    }

    /// Restores a source; `None` if the state does not fit the configuration.
    pub fn restore(
        config: &TrainConfig,
        state: SourceState,
        policy: Policy,
        io: RunIo,
    ) -> Result<Option<Self>, TrainError> {
        Ok(match state {
            SourceState::Here(state) if config.is_here() => {
                let collector = Collector::restore(config.collector.clone(), &config.sac.network, *state);
                collector.map(|collector| Self::Here(Box::new(collector)))
            }
            SourceState::Elsewhere(state) if !config.is_here() => Some(Self::elsewhere(config, policy, io, state)?),
            _ => None,
        })
    }

    /// Returns the state to save. Running attempts in other processes are not part of it.
    pub fn save(&self) -> SourceState {
        match self {
            Self::Here(collector) => SourceState::Here(Box::new(collector.save())),
            Self::Elsewhere(receiver) => SourceState::Elsewhere(receiver.save()),
        }
    }

    /// Number of replay buffers: one for each environment or actor.
    pub fn buffer_count(&self) -> usize {
        match self {
            Self::Here(_) => 1,
            Self::Elsewhere(receiver) => receiver.source_count(),
        }
    }

    /// Number of NPCs.
    pub fn lane_count(&self) -> usize {
        match self {
            Self::Here(collector) => collector.lane_count(),
            Self::Elsewhere(receiver) => receiver.lane_count(),
        }
    }

    /// Empty replay buffers for about `capacity` rows.
    pub fn buffers(&self, capacity: usize) -> Vec<Replay> {
        let count = self.buffer_count();
        (0..count).map(|_| Replay::new(self.lane_count() / count, capacity / count)).collect()
    }

    /// Number of decisions since the start of the run.
    pub fn total_decisions(&self) -> u64 {
        match self {
            Self::Here(collector) => collector.total_decisions(),
            Self::Elsewhere(receiver) => receiver.total_decisions(),
        }
    }

    /// Returns and resets the statistics since the last call.
    pub fn take_stats(&mut self) -> CollectorStats {
        match self {
            Self::Here(collector) => collector.take_stats(),
            Self::Elsewhere(receiver) => receiver.take_stats(),
        }
    }

    /// Collects `step_count` decisions per NPC, fewer if `stop` is set. `version` is the policy's number of updates.
    ///
    /// # Errors
    /// If other processes send nothing for too long.
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
            Self::Elsewhere(receiver) => receiver.collect((policy, version), step_count, stop),
        }
    }
}
