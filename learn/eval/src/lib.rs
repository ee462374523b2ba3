//! The paper's evaluation protocol: random goals on whole maps, success by difficulty, failures by outcome.
//!
//! An evaluation is a list of [units](mod@unit), one for each map and seed, which can be saved and resumed. A
//! [`report`] summarises them. [`suite`] runs the rows of the paper's table, [`living`] scenes in which things move,
//! [`variants`] many graphs on one split, [`ablation`] what each of our choices adds, [`conditions`] success while one
//! thing is varied. [`intervals`] states how certain the figures is, and a [`record`] keeps the attempts for those who
//! check it.

pub mod ablation;
pub mod challenge;
pub mod conditions;
mod config;
pub mod intervals;
pub mod living;
mod maps;
mod reachable;
pub mod record;
pub mod report;
mod run;
mod site;
pub mod suite;
pub mod unit;
pub mod variants;

pub use config::{EvalConfig, EvalError, Method, Price, Shard};
pub use intervals::Interval;
pub use maps::{EvalMap, GoalArea, MapName};
pub(crate) use reachable::{Terrain, is_on_foot, reachable};
pub use report::{Calibration, MapReport, Rate, Report, Success};
pub use run::{evaluate, missing, run_units};
pub(crate) use site::draw_goals;
pub use site::keep;
