//! Rayon's threads. Its parallel iterators keep the order of their items, so results do not depend on the number of
//! threads.

use rayon::ThreadPoolBuilder;

/// Runs `work` with `thread_count` threads for rayon.
pub fn with_threads<R: Send>(thread_count: usize, work: impl FnOnce() -> R + Send) -> R {
    let pool = ThreadPoolBuilder::new().num_threads(thread_count.max(1)).build();
    pool.expect("the system starts threads").install(work)
}
