//! Progress of a build, which callers watch, cancel, or plan on.

use crate::build::interim::Interim;
use crate::build::probe::{Outcome, ProbeWatch};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Progress of a build, shared with its callers.
#[derive(Debug, Default)]
pub struct Progress {
    /// Number of probes that have finished.
    pub done: AtomicU64,
    /// Number of probes that the build needs, as far as it knows: 0 while it places vertices, and growing afterwards.
    pub total: AtomicU64,
    /// Set to cancel the build.
    pub cancel: AtomicBool,
    /// The findings so far.
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
