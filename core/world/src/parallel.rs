//! Splits work over threads by position, so that results do not depend on the number of threads.

/// Calls `fill` with the index and the values of each slab of `slab_len` values, on `thread_count` threads.
pub(crate) fn for_each_slab<T: Send>(
    values: &mut [T],
    slab_len: usize,
    thread_count: usize,
    fill: impl Fn(usize, &mut [T]) + Sync,
) {
    let slab_count = values.len() / slab_len;
    let slabs_per_thread = slab_count.div_ceil(thread_count.max(1)).max(1);
    if slabs_per_thread >= slab_count {
        values.chunks_mut(slab_len).enumerate().for_each(|(slab_idx, slab)| fill(slab_idx, slab));
        return;
    }
    std::thread::scope(|scope| {
        for (thread_idx, chunk) in values.chunks_mut(slabs_per_thread * slab_len).enumerate() {
            let fill = &fill;
            scope.spawn(move || {
                for (slab_idx, slab) in chunk.chunks_mut(slab_len).enumerate() {
                    fill(thread_idx * slabs_per_thread + slab_idx, slab);
                }
            });
        }
    });
}

/// Applies `map` to ranges that cover the indices below `count`, on `thread_count` threads, and joins the results in order.
pub(crate) fn map_indices<T: Send>(
    count: usize,
    thread_count: usize,
    map: impl Fn(std::ops::Range<usize>) -> Vec<T> + Sync,
) -> Vec<T> {
    let per_thread = count.div_ceil(thread_count.max(1)).max(1);
    let parts: Vec<Vec<T>> = std::thread::scope(|scope| {
        let handles: Vec<_> = (0..count)
            .step_by(per_thread)
            .map(|start| {
                let map = &map;
                scope.spawn(move || map(start..(start + per_thread).min(count)))
            })
            .collect();
        handles.into_iter().map(|handle| handle.join().expect("no worker panics")).collect()
    });
    parts.into_iter().flatten().collect()
}

/// Number of available cores; 1 if it is unknown.
pub(crate) fn core_count() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
