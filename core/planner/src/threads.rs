//! Parallel work on rayon's threads.

use rayon::iter::{ParallelBridge, ParallelIterator};
use surefoot_world::parallel::with_threads;

/// Calls `map` with every index below `count` on `thread_count` threads, which take the next index when they are free.
/// Returns the results in order.
pub fn map_indices<T: Send>(count: usize, thread_count: usize, map: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let mut results: Vec<(usize, T)> = with_threads(thread_count.min(count), || {
        // Splitting the range would not keep the ascending order in which work begins.
        (0..count).par_bridge().map(|idx| (idx, map(idx))).collect()
    });
    results.sort_unstable_by_key(|(idx, _)| *idx);
    results.into_iter().map(|(_, result)| result).collect()
}
