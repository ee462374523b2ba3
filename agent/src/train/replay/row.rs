//! Packed rows: about 420 bytes instead of the 1.5 kB of an observation.

use super::RowKind;
use serde::{Deserialize, Serialize};
use surefoot_world::character::ACTION_LEN;
use surefoot_world::mesh::Surface;
use surefoot_world::sense::{self, RAY_CHANNELS, RAY_COUNT, STATE_LEN};

/// One observation with the action taken and its result.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Row {
    #[serde(with = "long_array")]
    pub proximity: [u16; RAY_COUNT],
    #[serde(with = "long_array")]
    pub surface: [u8; RAY_COUNT],
    #[serde(with = "long_array")]
    pub state: [f32; STATE_LEN],
    pub action: [f32; ACTION_LEN],
    pub reward: f32,
    pub kind: RowKind,
    /// Whether the NPC's hidden state was the initial one before this row.
    pub is_fresh: bool,
}

/// Serializes arrays longer than 32 values, for which serde has no implementation.
mod long_array {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<T: Serialize, S: Serializer, const N: usize>(
        array: &[T; N],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        array.as_slice().serialize(serializer)
    }

    pub fn deserialize<'de, T: Deserialize<'de>, D: Deserializer<'de>, const N: usize>(
        deserializer: D,
    ) -> Result<[T; N], D::Error> {
        let values = Vec::<T>::deserialize(deserializer)?;
        let count = values.len();
        values.try_into().map_err(|_| D::Error::custom(format!("{count} values, expected {N}")))
    }
}

impl Row {
    /// Packs an observation without others; action, reward and kind are placeholders.
    pub fn pack(observation: &[f32]) -> Self {
        let mut row = Row {
            proximity: [0; RAY_COUNT],
            surface: [0; RAY_COUNT],
            state: [0.0; STATE_LEN],
            action: [0.0; ACTION_LEN],
            reward: 0.0,
            kind: RowKind::Boundary,
            is_fresh: false,
        };
        for ray in 0..RAY_COUNT {
            row.proximity[ray] = (observation[ray] * f32::from(u16::MAX)).round() as u16;
            row.surface[ray] = sense::ray_surface(observation, ray) as u8;
        }
        row.state.copy_from_slice(&observation[RAY_COUNT * RAY_CHANNELS..]);
        row
    }

    /// Unpacks the observation without others into `into`, which must contain zeros.
    pub fn unpack(&self, into: &mut [f32]) {
        for ray in 0..RAY_COUNT {
            into[ray] = f32::from(self.proximity[ray]) / f32::from(u16::MAX);
            if let Some((channel, value)) = sense::surface_channel(Surface::ALL[usize::from(self.surface[ray])]) {
                into[channel * RAY_COUNT + ray] = value;
            }
        }
        into[RAY_COUNT * RAY_CHANNELS..].copy_from_slice(&self.state);
    }
}
