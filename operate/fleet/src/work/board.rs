//! The board: which jobs of a dispatch are open.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// The open jobs of a dispatch, for all threads that do them.
#[derive(Debug)]
pub(super) struct Board {
    settled: Vec<AtomicBool>,
    taken: Vec<AtomicBool>,
    is_over: AtomicBool,
    /// Whether a prover refused a job, so that this process must do it.
    is_forsaken: AtomicBool,
    /// Answers that have arrived and are not read yet.
    heard: AtomicUsize,
}

impl Board {
    /// Creates a board of open jobs.
    pub fn new(count: usize) -> Self {
        let none = || (0..count).map(|_| AtomicBool::new(false)).collect();
        let (is_over, is_forsaken) = (AtomicBool::default(), AtomicBool::default());
        Self { settled: none(), taken: none(), is_over, is_forsaken, heard: AtomicUsize::default() }
    }

    /// Whether the job is done, or no longer needed.
    pub fn is_settled(&self, idx: usize) -> bool {
        self.is_over() || self.settled[idx].load(Ordering::Acquire)
    }

    /// Whether a thread of this process has started it.
    pub fn is_taken(&self, idx: usize) -> bool {
        self.taken[idx].load(Ordering::Acquire)
    }

    /// Whether the dispatch has ended.
    pub fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Acquire)
    }

    /// Ends the dispatch.
    pub fn end(&self) {
        self.is_over.store(true, Ordering::Release);
    }

    /// Whether a prover refused a job.
    pub fn is_forsaken(&self) -> bool {
        self.is_forsaken.load(Ordering::Acquire)
    }

    /// Notes that a prover refused a job.
    pub fn forsake(&self) {
        self.is_forsaken.store(true, Ordering::Release);
    }

    /// Notes that a job is done. Returns whether it was open.
    pub fn settle(&self, idx: usize) -> bool {
        !self.settled[idx].swap(true, Ordering::AcqRel)
    }

    /// Reserves room for an answer to be read; there is room for two to each job. A flooded queue loses answers: their
    /// jobs are sent again, or done here.
    pub fn admit(&self, idx: usize) -> bool {
        let limit = 2 * self.settled.len();
        !self.is_settled(idx)
            && self
                .heard
                .try_update(Ordering::AcqRel, Ordering::Acquire, |heard| (heard < limit).then_some(heard + 1))
                .is_ok()
    }

    /// Notes that an answer was read.
    pub fn release(&self) {
        self.heard.fetch_sub(1, Ordering::AcqRel);
    }

    /// Takes the last job that is neither done nor started here.
    pub fn take(&self) -> Option<usize> {
        let is_free = |&idx: &usize| !self.is_settled(idx) && !self.taken[idx].swap(true, Ordering::AcqRel);
        (0..self.taken.len()).rev().find(is_free)
    }
}
