//! The threads of rayon, whose parallel iterators keep the order of their items.

use rayon::ThreadPoolBuilder;

/// Runs `work`, in which rayon has `thread_count` threads.
pub(crate) fn with_threads<R: Send>(thread_count: usize, work: impl FnOnce() -> R + Send) -> R {
    let pool = ThreadPoolBuilder::new().num_threads(thread_count.max(1)).build();
    pool.expect("the system starts threads").install(work)
}
