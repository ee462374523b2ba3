//! Runs many attempts at once in this process, straight or by plan, for validation, evaluation and pictures.

mod chase;
mod guide;
mod run;
mod walker;

pub use chase::{Chase, Chased, Errand};
pub use guide::GuideTimes;
pub use run::{Figures, Rollout};
pub use walker::{AttemptResult, Measured, Played, Track};
