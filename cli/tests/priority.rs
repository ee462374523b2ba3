//! Decisions and proofs give way to ticks on cores that they share.
#![cfg(target_os = "linux")]

use std::time::{Duration, Instant};
use surefoot_processes::Surefoot;

/// Longest time until a process has started its threads.
const LIMIT: Duration = Duration::from_secs(60);
/// The lowest priority that there is.
const MOST: i32 = 19;

/// Starts `surefoot ARGS`, and compares the nice values of its threads with this thread's.
#[track_caller]
fn check(args: &[&str], expected: &[(&str, i32)]) {
    let folder = tempfile::tempdir().unwrap();
    let service = Surefoot::start(args, &[], &folder.path().join("log"));
    let own = rustix::process::getpriority_process(None).unwrap();
    let deadline = Instant::now() + LIMIT;
    for &(thread, lowered_by) in expected {
        let nice = loop {
            match service.process.nice_of(thread) {
                Some(nice) => break nice,
                None => assert!(Instant::now() < deadline, "no thread {thread} of {args:?}"),
            }
            std::thread::yield_now();
        };
        assert_eq!(nice, (own + lowered_by).min(MOST), "thread {thread} of {args:?}");
    }
}

#[test]
fn worlds_come_before_planners_and_workers() {
    check(&["serve"], &[("surefoot", 0), ("tokio", 0)]);
    check(&["plan"], &[("surefoot", 10), ("tokio", 10)]);
}

#[test]
fn worlds_come_before_the_workers_of_the_same_process() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().to_str().unwrap();
    let up = ["up", "--npcs", "1", "--cache", cache, "--planner-listen", "127.0.0.1:0"];
    check(&up, &[("surefoot", 0), ("world-", 0), ("inference", 10)]);
}
