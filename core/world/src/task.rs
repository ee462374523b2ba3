//! The point-goal task: reward, patience and the ends of an episode.

use crate::{Arrival, Vec3};
use serde::{Deserialize, Serialize};
use strum::{IntoStaticStr, VariantArray};

/// Constants of the task. Defaults are those of the paper where it has them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TaskConfig {
    /// Distance from the feet within which a goal is reached, m (paper: 1 m).
    pub goal_radius: f32,
    /// Decisions without a new best distance after which the episode is truncated (paper: 300).
    pub patience: u32,
    /// Progress that is worth a reward of 1, m (lambda in the paper).
    pub lambda: f32,
    /// Reward for every decision (paper: -0.0005).
    pub decision_penalty: f32,
    /// Time in water after which a character drowns, in ticks (released environment: 5 s).
    pub drown_ticks: u32,
}

impl Default for TaskConfig {
    fn default() -> Self {
        Self { goal_radius: 1.0, patience: 300, lambda: 20.0, decision_penalty: -0.0005, drown_ticks: 300 }
    }
}

impl TaskConfig {
    /// Whether all numbers are finite and all divisors are above 0.
    pub(crate) fn is_sound(&self) -> bool {
        // These comparisons are false for NaN.
        (0.0..=f32::MAX).contains(&self.goal_radius)
            && self.patience > 0
            && (f32::MIN_POSITIVE..=f32::MAX).contains(&self.lambda)
            && self.decision_penalty.is_finite()
            && self.drown_ticks > 0
    }
}

/// How an episode ended.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, VariantArray, IntoStaticStr,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum End {
    /// The feet came within the goal radius.
    Reached,
    /// The NPC left the map.
    Fell,
    /// The NPC touched lava.
    Burnt,
    /// The NPC was in water for too long.
    Drowned,
    /// Patience ran out without a new best distance: a truncation, not part of the task's dynamics.
    NoProgress,
    /// No path leads to the goal: the NPC went to the nearest place that it can reach and stopped there.
    Unreachable,
    /// Other NPCs stand at the goal: the NPC stopped as near as they let it.
    ReachedNear,
}

impl End {
    /// All ends, in a fixed order.
    pub const ALL: &[End] = Self::VARIANTS;

    /// Whether the episode was truncated, so that the value of the next state still counts.
    pub fn is_truncation(self) -> bool {
        matches!(self, End::NoProgress | End::Unreachable | End::ReachedNear)
    }

    /// Whether the NPC was harmed.
    pub fn is_harm(self) -> bool {
        matches!(self, End::Fell | End::Burnt | End::Drowned)
    }

    /// Lower-case name as used in reports.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The sparse reward: +1 for the goal, -1 for harm, 0 for truncations. Learners bootstrap from the last state of a
    /// truncated episode, so a reward for the truncation would count twice.
    pub fn reward(self) -> f32 {
        match self {
            End::Reached => 1.0,
            End::Fell | End::Burnt | End::Drowned => -1.0,
            End::NoProgress | End::Unreachable | End::ReachedNear => 0.0,
        }
    }
}

/// One attempt at one goal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// Position that the feet must reach, m.
    pub goal: Vec3,
    /// What counts as having reached it.
    pub arrival: Arrival,
    /// Smallest distance to the goal so far, m.
    pub best_distance: f32,
    /// Decisions since `best_distance` last shrank.
    pub stalled_decisions: u32,
    /// Decisions so far.
    pub decisions: u32,
    /// How the episode ended; `None` while it runs.
    pub end: Option<End>,
    /// Decrease of the best distance since the last decision, m.
    progress: f32,
}

impl Episode {
    /// Starts an attempt to touch `goal` from `feet`.
    pub fn new(goal: Vec3, feet: Vec3) -> Self {
        let best_distance = feet.distance(goal);
        let arrival = Arrival::Touch;
        Self { goal, arrival, best_distance, stalled_decisions: 0, decisions: 0, end: None, progress: 0.0 }
    }

    /// The same attempt with another rule of arrival.
    #[must_use]
    pub fn arriving(self, arrival: Arrival) -> Self {
        Self { arrival, ..self }
    }

    /// Records the position of the feet after a tick, and ends the episode if touching the goal is enough and they do.
    pub fn note_tick(&mut self, feet: Vec3, config: &TaskConfig) {
        let distance = feet.distance(self.goal);
        if distance < self.best_distance {
            self.progress += self.best_distance - distance;
            self.best_distance = distance;
        }
        if self.arrival == Arrival::Touch && distance <= config.goal_radius {
            self.end = Some(End::Reached);
        }
    }

    /// Closes a decision: ends the episode if patience has run out, and returns the reward.
    ///
    /// The reward is the paper's: progress / lambda, a constant penalty, and [`End::reward`].
    pub fn close_decision(&mut self, config: &TaskConfig) -> f32 {
        self.decisions += 1;
        if self.progress > 0.0 {
            self.stalled_decisions = 0;
        } else {
            self.stalled_decisions += 1;
        }
        if self.end.is_none() && self.stalled_decisions >= config.patience {
            self.end = Some(End::NoProgress);
        }
        let dense = std::mem::take(&mut self.progress) / config.lambda;
        dense + config.decision_penalty + self.end.map_or(0.0, End::reward)
    }

    /// Share of the patience used, in [0, 1].
    pub fn patience_used(&self, config: &TaskConfig) -> f32 {
        self.stalled_decisions as f32 / config.patience as f32
    }
}
