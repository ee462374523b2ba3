//! What it takes to try a candidate edge, and what came of it. Who runs the policy stands behind [`ProbeExecutor`].

use std::sync::atomic::{AtomicBool, AtomicU64};
use surefoot_world::{Ability, Vec3};

/// One episode to run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trial {
    /// Where the feet start, m.
    pub start: Vec3,
    /// Where they should be, m.
    pub goal: Vec3,
    /// Names the episode's random stream.
    pub stream: u64,
    /// Whether to keep the way taken.
    pub keep_track: bool,
}

/// How it went.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Whether the goal was reached.
    pub reached: bool,
    /// Decisions taken.
    pub decisions: u32,
    /// The most demanding ability used.
    pub ability: Ability,
    /// Corners of the box around the way taken, m.
    pub bounds: [Vec3; 2],
    /// Where the feet stood after each decision, first the start, m, and nothing where they were in the air; empty
    /// unless it was to be kept.
    pub track: Vec<Option<Vec3>>,
}

/// Runs probes somewhere: here on all cores, or later on workers.
pub trait ProbeExecutor {
    /// Runs each trial and returns its outcome, in the order of the trials; equal seeds give equal outcomes.
    ///
    /// `progress` counts finished trials. `None` if `cancel` was set before the last one finished.
    fn run(&self, trials: &[Trial], seed: u64, progress: &AtomicU64, cancel: &AtomicBool) -> Option<Vec<Outcome>>;
}
