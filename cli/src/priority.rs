//! Priority of threads. A tick must end within 16.7 ms, but a decision has ten times as long. So workers and
//! planners give way to world servers where they share cores.

use tokio::runtime::{Builder, Runtime};

/// Added to the nice value: beside a tick, a thread with it gets a tenth of a core.
#[cfg(target_os = "linux")]
const NICE: i32 = 10;

/// Lowers the priority of the calling thread, and of the threads that it starts from now on. Other systems than Linux
/// have no priority for single threads that their threads inherit, so there it stays as it is.
pub fn lower() {
    // If the system refuses, more ticks are late on busy cores, and nothing else changes.
    #[cfg(target_os = "linux")]
    let _ = rustix::process::nice(NICE);
}

/// Starts a runtime whose threads have the lower priority.
pub fn background() -> std::io::Result<Runtime> {
    let start = || {
        lower();
        Builder::new_multi_thread().enable_all().build()
    };
    std::thread::scope(|scope| scope.spawn(start).join().expect("starting a runtime does not panic"))
}
