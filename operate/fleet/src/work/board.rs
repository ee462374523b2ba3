//! The board: which jobs of a dispatch are open, for all who do them.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Which jobs are open, for all who do them.
#[derive(Debug)]
pub(super) struct Board {
    settled: Vec<AtomicBool>,
    taken: Vec<AtomicBool>,
    is_over: AtomicBool,
    /// Whether a prover cannot do a job, so that somebody here must.
    is_forsaken: AtomicBool,
    /// Answers that were heard and not read yet.
    heard: AtomicUsize,
}

impl Board {
    /// All jobs are open.
    pub fn new(count: usize) -> Self {
        let none = || (0..count).map(|_| AtomicBool::new(false)).collect();
        let (is_over, is_forsaken) = (AtomicBool::default(), AtomicBool::default());
        Self { settled: none(), taken: none(), is_over, is_forsaken, heard: AtomicUsize::default() }
    }

    /// Whether the job needs no prover any more.
    pub fn is_settled(&self, idx: usize) -> bool {
        self.is_over() || self.settled[idx].load(Ordering::Acquire)
    }

    /// Whether a thread of this process has begun it.
    pub fn is_taken(&self, idx: usize) -> bool {
        self.taken[idx].load(Ordering::Acquire)
    }

    /// Whether nobody waits for any of them any more.
    pub fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Acquire)
    }

    /// Nobody waits any more.
    pub fn end(&self) {
        self.is_over.store(true, Ordering::Release);
    }

    /// Whether a prover could not do a job.
    pub fn is_forsaken(&self) -> bool {
        self.is_forsaken.load(Ordering::Acquire)
    }

    /// Notes that a prover could not do a job.
    pub fn forsake(&self) {
        self.is_forsaken.store(true, Ordering::Release);
    }

    /// Notes that a job is done. Returns whether it was open.
    pub fn settle(&self, idx: usize) -> bool {
        !self.settled[idx].swap(true, Ordering::AcqRel)
    }

    /// Whether there is room for an answer to be read: for two to each job. Whoever floods the queue with more loses them; a job whose
    /// answer is lost is sent again, or done here.
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

    /// The last job that nobody has done or begun here.
    pub fn take(&self) -> Option<usize> {
        let is_free = |&idx: &usize| !self.is_settled(idx) && !self.taken[idx].swap(true, Ordering::AcqRel);
        (0..self.taken.len()).rev().find(is_free)
    }
}
