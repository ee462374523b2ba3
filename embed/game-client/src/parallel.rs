//! Work that is spread over threads.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Calls `map` with every index below `count`, on so many threads, each of which takes the next one when it is done. Returns the results in
/// order.
pub fn map_indices<T: Send>(count: usize, thread_count: usize, map: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Vec::from_iter((0..count).map(|_| None)));
    std::thread::scope(|scope| {
        for _ in 0..thread_count.max(1) {
            scope.spawn(|| {
                loop {
                    let idx = next.fetch_add(1, Ordering::Relaxed);
                    if idx >= count {
                        return;
                    }
                    let result = map(idx);
                    results.lock().expect("nobody panics with it")[idx] = Some(result);
                }
            });
        }
    });
    results.into_inner().expect("nobody panics with it").into_iter().flatten().collect()
}
