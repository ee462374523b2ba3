//! How far a build has come, for those who wait for it, cancel it, or plan on what it has proved so far.

use crate::build::interim::Interim;
use crate::build::probe::{Outcome, ProbeWatch};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Progress of a build, shared with those who watch or cancel it.
#[derive(Debug, Default)]
pub struct Progress {
    /// Number of probes that have finished.
    pub done: AtomicU64,
    /// Number of probes that are known to be needed; 0 while vertices are placed, and grows as the build finds more to probe.
    pub total: AtomicU64,
    /// Set to cancel the build.
    pub cancel: AtomicBool,
    /// What has been found out so far.
    pub interim: Interim,
}

impl ProbeWatch for Progress {
    fn finished(&self, _: usize, _: &Outcome) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }

    fn is_cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }
}
