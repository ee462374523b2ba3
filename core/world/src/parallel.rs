//! Rayon's threads. Its parallel iterators keep the order of their items, so results do not depend on the number of
//! threads.

use rayon::ThreadPoolBuilder;
use rayon::prelude::*;

/// Runs `work` with `thread_count` threads for rayon.
pub fn with_threads<R: Send>(thread_count: usize, work: impl FnOnce() -> R + Send) -> R {
    let pool = ThreadPoolBuilder::new().num_threads(thread_count.max(1)).build();
    pool.expect("the system starts threads").install(work)
}

/// Calls `fill` with the index and the values of each slab of `slab_len` values.
pub(crate) fn for_each_slab<T: Send>(
    values: &mut [T],
    slab_len: usize,
    thread_count: usize,
    fill: impl Fn(usize, &mut [T]) + Sync + Send,
) {
    let slabs = values.par_chunks_mut(slab_len).enumerate();
    with_threads(thread_count, || slabs.for_each(|(slab_idx, slab)| fill(slab_idx, slab)));
}

/// Number of available cores; 1 if it is unknown.
pub(crate) fn core_count() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
