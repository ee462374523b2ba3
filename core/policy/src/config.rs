//! Sizes of the networks.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::sense::{RAY_CHANNELS, RAY_COUNT, observation_len};

/// Number of values of an observation that come from rays; they are the first.
pub const RAY_LEN: usize = RAY_COUNT * RAY_CHANNELS;
/// Number of an LSTM's gates. Their columns are ordered input, forget, output, candidate.
pub const GATES: usize = 4;

/// Bounds of the logarithm of an action's standard deviation.
pub const LOG_STD_RANGE: (f32, f32) = (-5.0, 2.0);

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

    /// Number of values that an encoded observation passes to the LSTM and the first hidden layer.
    pub fn sensed_len(&self) -> usize {
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

    /// Shapes of all parameters of an actor with these sizes, by name.
    pub fn parameter_shapes(&self) -> BTreeMap<String, Vec<usize>> {
        let &Self { ray_features, hidden, .. } = self;
        let (sensed, memory) = (self.sensed_len(), self.memory_len());
        let mut layers = vec![
            ("trunk.rays", RAY_LEN, ray_features),
            ("trunk.first", sensed + memory, hidden),
            ("trunk.second", hidden, hidden),
            ("head", hidden, 2 * ACTION_LEN),
        ];
        let mut shapes = BTreeMap::new();
        if memory > 0 {
            layers.push(("trunk.memory.input", sensed, GATES * memory));
            shapes.insert("trunk.memory.recurrent".to_owned(), vec![memory, GATES * memory]);
        }
        for (name, inputs, outputs) in layers {
            shapes.insert(format!("{name}.weight"), vec![inputs, outputs]);
            shapes.insert(format!("{name}.bias"), vec![outputs]);
        }
        shapes
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
