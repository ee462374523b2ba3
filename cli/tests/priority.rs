//! Decisions and proofs give way to ticks on cores that they share.
#![cfg(target_os = "linux")]

use std::time::{Duration, Instant};
use surefoot_processes::Surefoot;

/// Longest time until a process has started its threads.
const LIMIT: Duration = Duration::from_secs(60);
/// The lowest priority that there is.
const MOST: i32 = 19;

/// Starts `surefoot ARGS`, and waits until its threads have nice values that are so much higher than this thread's.
#[track_caller]
fn check(args: &[&str], expected: &[(&str, i32)]) {
    let folder = tempfile::tempdir().unwrap();
    let service = Surefoot::start(args, &[], &folder.path().join("log"));
    let own = rustix::process::getpriority_process(None).unwrap();
    let deadline = Instant::now() + LIMIT;
    for &(thread, lowered_by) in expected {
        let expected = Some((own + lowered_by).min(MOST));
        // The first thread lowers its priority a moment after its start.
        while service.process.nice_of(thread) != expected {
            let nice = service.process.nice_of(thread);
            assert!(Instant::now() < deadline, "{thread} of {args:?} has the nice value {nice:?}, not {expected:?}");
            std::thread::yield_now();
        }
    }
}

#[test]
fn worlds_come_before_planners_and_workers() {
    check(&["serve"], &[("surefoot", 0), ("tokio", 0)]);
    let folder = tempfile::tempdir().unwrap();
    let plan = ["plan", "--cache", folder.path().to_str().unwrap()];
    check(&plan, &[("surefoot", 10), ("tokio", 10)]);
}

#[test]
fn worlds_come_before_the_workers_of_the_same_process() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().to_str().unwrap();
    let up = ["up", "--npcs", "1", "--cache", cache, "--planner-listen", "127.0.0.1:0"];
    check(&up, &[("surefoot", 0), ("world-", 0), ("inference", 10)]);
}
