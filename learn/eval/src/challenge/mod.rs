//! The challenge: sets of goals, runs of entrants, and a scorer that measures every attempt itself.
//!
//! A [set](GoalSet) has goals on maps. A [run](Run) holds, for each goal, either a path, which a
//! plain controller drives, or the actions of an agent, which are done again. In both cases [`score`] moves the body in
//! our physics and sees for itself where it gets. [`motion`] measures how bodies move, also those of other programs,
//! whose runs hold tracks. `docs/guides/challenge.md` is the protocol.

pub mod host;
pub mod motion;
pub mod record;
mod run;
mod score;
mod set;
mod trial;

pub use run::{Approach, MapRun, Run, RunError};
pub use score::{MapScore, Score, ScoreError, score, score_hosted};
pub use set::{GoalSet, SETS, SetError, SetGoal, SetMap};
pub use surefoot_rollout::drive::PathPoint;

/// Version of sets, protocol and scorer. Scores of different versions are not compared.
pub const VERSION: u32 = 2;
