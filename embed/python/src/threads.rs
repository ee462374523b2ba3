//! Threads for one call. None outlives it, because a forked process has none of its parent's.

use std::sync::{Mutex, PoisonError};
use surefoot_world::parallel::with_threads;

/// Number of cores that this process may use.
pub fn core_count() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Runs `work`, whose parallel iterators get threads of their own instead of those that rayon keeps.
pub fn with_own_threads<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    with_threads(core_count(), work)
}

/// Runs jobs on up to `thread_count` threads, of which this is one, and returns their results in order.
pub fn on_threads<J: Send, T: Send>(jobs: Vec<J>, thread_count: usize, run: impl Fn(J) -> T + Sync) -> Vec<T> {
    let more = thread_count.min(jobs.len()).saturating_sub(1);
    if more == 0 {
        return jobs.into_iter().map(run).collect();
    }
    let queue = Mutex::new(jobs.into_iter().enumerate());
    let next = || queue.lock().unwrap_or_else(PoisonError::into_inner).next();
    let work = || std::iter::from_fn(next).map(|(idx, job)| (idx, run(job))).collect::<Vec<_>>();
    let mut results = std::thread::scope(|scope| {
        let others: Vec<_> = (0..more).map(|_| scope.spawn(work)).collect();
        let mut results = work();
        others.into_iter().for_each(|other| results.extend(other.join().expect("a job does not panic")));
        results
    });
    results.sort_by_key(|(idx, _)| *idx);
    results.into_iter().map(|(_, result)| result).collect()
}
