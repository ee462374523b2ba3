//! Packed rows: about 420 bytes instead of the 1.5 kB of an observation; 410 in messages.

use super::step::{RowKind, Step};
use serde::{Deserialize, Serialize};
use surefoot_world::OBSERVATION_LEN;
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
    const EMPTY: Self = Self {
        proximity: [0; RAY_COUNT],
        surface: [0; RAY_COUNT],
        state: [0.0; STATE_LEN],
        action: [0.0; ACTION_LEN],
        reward: 0.0,
        kind: RowKind::Boundary,
        is_fresh: false,
    };

    /// Packs an observation without others; action, reward and kind are placeholders.
    pub fn pack(observation: &[f32]) -> Self {
        let mut row = Self::EMPTY;
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

/// Bytes of a row in messages.
const ROW_BYTES: usize = 2 * RAY_COUNT + RAY_COUNT + 4 * (STATE_LEN + ACTION_LEN + 1) + 2;

/// Why bytes cannot be decoded as rows.
#[derive(Debug, thiserror::Error)]
pub enum RowError {
    /// The number of bytes is wrong.
    #[error("{found} bytes, expected {ROW_BYTES} for each of {expected} NPCs")]
    Length {
        /// Number of bytes.
        found: usize,
        /// Number of NPCs.
        expected: usize,
    },
    /// A value is out of range.
    #[error("the row of npc {npc_idx} has {problem}")]
    Value {
        /// Index of the NPC.
        npc_idx: usize,
        /// The problem.
        problem: &'static str,
    },
}

/// Packs the rows of a step for a message, in the layout that `learn.proto` describes. Observations of others are left
/// out.
pub fn rows_to_bytes(step: &Step) -> Vec<u8> {
    let len = step.observations.len() / step.kinds.len().max(1);
    let mut bytes = Vec::with_capacity(step.kinds.len() * ROW_BYTES);
    for (lane, observation) in step.observations.chunks_exact(len.max(1)).enumerate() {
        let row = Row::pack(&observation[..OBSERVATION_LEN]);
        bytes.extend(row.proximity.iter().flat_map(|value| value.to_le_bytes()));
        bytes.extend(row.surface);
        let values = row.state.iter().chain(&step.actions[lane]).chain([&step.rewards[lane]]);
        bytes.extend(values.flat_map(|value| value.to_le_bytes()));
        bytes.push(step.kinds[lane] as u8);
        bytes.push(step.is_fresh[lane].into());
    }
    bytes
}

/// Decodes the rows of `npc_count` NPCs, without memory and version.
///
/// # Errors
/// If the number of bytes is wrong, or a value is out of range.
pub fn rows_from_bytes(bytes: &[u8], npc_count: usize) -> Result<Step, RowError> {
    if bytes.len() != npc_count * ROW_BYTES {
        return Err(RowError::Length { found: bytes.len(), expected: npc_count });
    }
    let mut step = Step { observations: vec![0.0; npc_count * OBSERVATION_LEN], ..Step::default() };
    let rows = step.observations.chunks_exact_mut(OBSERVATION_LEN).zip(bytes.chunks_exact(ROW_BYTES));
    for (npc_idx, (observation, bytes)) in rows.enumerate() {
        let refuse = |problem| RowError::Value { npc_idx, problem };
        let (proximity, rest) = bytes.split_at(2 * RAY_COUNT);
        let (surface, rest) = rest.split_at(RAY_COUNT);
        let (values, flags) = rest.split_at(4 * (STATE_LEN + ACTION_LEN + 1));
        if surface.iter().any(|surface| usize::from(*surface) >= Surface::ALL.len()) {
            return Err(refuse("an unknown surface"));
        }
        let values: Vec<f32> = values.as_chunks::<4>().0.iter().map(|value| f32::from_le_bytes(*value)).collect();
        if !values.iter().all(|value| value.is_finite()) {
            return Err(refuse("a number that is not finite"));
        }
        let (state, rest) = values.split_at(STATE_LEN);
        let (action, reward) = rest.split_at(ACTION_LEN);
        if action.iter().any(|value| value.abs() > 1.0) {
            return Err(refuse("an action outside -1 to 1"));
        }
        let kind = match flags[0] {
            0 => RowKind::Continues,
            1 => RowKind::Terminated,
            2 => RowKind::Boundary,
            _ => return Err(refuse("an unknown kind")),
        };
        let mut row = Row { reward: reward[0], kind, is_fresh: flags[1] != 0, ..Row::EMPTY };
        let pairs = proximity.as_chunks::<2>().0.iter();
        row.proximity.iter_mut().zip(pairs).for_each(|(value, pair)| *value = u16::from_le_bytes(*pair));
        row.surface.copy_from_slice(surface);
        row.state.copy_from_slice(state);
        row.action.copy_from_slice(action);
        row.unpack(observation);
        step.actions.push(row.action);
        step.rewards.push(row.reward);
        step.kinds.push(kind);
        step.is_fresh.push(row.is_fresh);
    }
    Ok(step)
}
