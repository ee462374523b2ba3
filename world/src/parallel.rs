//! Work split over threads by position, so that results do not depend on how many there are.

/// Runs `fill` on each slab of `slab_len` values, on `thread_count` threads.
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

/// `map` of every index below `count`, in order, computed on `thread_count` threads.
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

/// One thread per core.
pub(crate) fn core_count() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
