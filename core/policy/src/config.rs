//! Sizes of the networks.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::num::NonZeroUsize;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::sense::{RAY_CHANNELS, RAY_COUNT, observation_len};

/// Number of values of an observation that come from rays; they are the first.
pub const RAY_LEN: usize = RAY_COUNT * RAY_CHANNELS;
/// Number of an LSTM's gates. Their columns are ordered input, forget, output, candidate.
pub(crate) const GATES: usize = 4;

/// Sizes of an actor's layers, each at most 4096.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActorConfig {
    /// Number of outputs of the ray encoder.
    pub ray_features: usize,
    /// Width of both hidden layers.
    pub hidden: usize,
    /// Number of units of the LSTM; `None` for a reactive agent, written as 0 in files.
    #[serde(default, with = "zero_is_none")]
    pub memory: Option<NonZeroUsize>,
    /// Whether the agent sees other NPCs and players, which makes its observations longer.
    #[serde(default)]
    pub sees_others: bool,
}

impl Default for ActorConfig {
    fn default() -> Self {
        Self { ray_features: 128, hidden: 256, memory: None, sees_others: false }
    }
}

/// Largest allowed width of a layer.
const MAX_WIDTH: usize = 4096;

impl ActorConfig {
    /// Number of units of the LSTM; 0 for a reactive agent.
    pub fn memory_len(&self) -> usize {
        self.memory.map_or(0, NonZeroUsize::get)
    }

    /// Number of values of an observation.
    pub fn observation_len(&self) -> usize {
        observation_len(self.sees_others)
    }

    /// Number of values that the LSTM and the first hidden layer get of an observation.
    pub(crate) fn sensed_len(&self) -> usize {
        self.ray_features + self.observation_len() - RAY_LEN
    }

    /// Number of values of an NPC's hidden and cell state; 0 for a reactive agent.
    pub fn hidden_len(&self) -> usize {
        2 * self.memory_len()
    }

    /// Whether the widths are 1 to 4096 and the memory is 0 to 4096.
    pub fn is_sound(&self) -> bool {
        let widths = 1..=MAX_WIDTH;
        widths.contains(&self.ray_features) && widths.contains(&self.hidden) && self.memory_len() <= MAX_WIDTH
    }

    /// Number of parameters of an actor with these sizes, which must be [sound](Self::is_sound). Checked against the length of a
    /// weights file before memory is allocated.
    pub fn parameter_count(&self) -> usize {
        let &Self { ray_features, hidden, .. } = self;
        let sensed = self.sensed_len();
        let memory = self.memory_len();
        let dense = |inputs: usize, outputs: usize| (inputs + 1) * outputs;
        let lstm = if memory > 0 { dense(sensed, GATES * memory) + memory * GATES * memory } else { 0 };
        dense(RAY_LEN, ray_features)
            + lstm
            + dense(sensed + memory, hidden)
            + dense(hidden, hidden)
            + dense(hidden, 2 * ACTION_LEN)
    }
}

/// Serializes `None` as 0.
mod zero_is_none {
    use super::{Deserialize, Deserializer, NonZeroUsize, Serialize, Serializer};

    pub fn serialize<S: Serializer>(size: &Option<NonZeroUsize>, serializer: S) -> Result<S::Ok, S::Error> {
        size.map_or(0, NonZeroUsize::get).serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<NonZeroUsize>, D::Error> {
        Ok(NonZeroUsize::new(usize::deserialize(deserializer)?))
    }
}
