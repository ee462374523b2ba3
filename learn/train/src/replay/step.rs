//! A step of all lanes, which is appended to a buffer.

use serde::{Deserialize, Serialize};
use surefoot_world::character::ACTION_LEN;

/// How a row continues.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum RowKind {
    /// The next row of the lane is its successor.
    Continues,
    /// The episode ended in a terminal state after this row's action: no successor.
    Terminated,
    /// No action: the last observation of a truncated episode.
    Boundary,
}

/// One collecting step over all lanes.
#[derive(Debug, Clone, Default)]
pub struct Step {
    /// Observations, `[lanes, observation_len]`.
    pub observations: Vec<f32>,
    /// The actor's hidden and cell states before the step, `[lanes, memory]`.
    pub memory: Vec<f32>,
    /// Whether each lane's hidden state is the initial one.
    pub is_fresh: Vec<bool>,
    /// One action per lane.
    pub actions: Vec<[f32; ACTION_LEN]>,
    /// One reward per lane.
    pub rewards: Vec<f32>,
    /// One kind per lane.
    pub kinds: Vec<RowKind>,
    /// Version of the weights that chose the actions: the number of updates behind them.
    pub version: u64,
}
