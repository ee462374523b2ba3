//! The metrics of a server as Prometheus text.

use crate::figures::WorldFigures;
use crate::hosted::{Standing, Tally};
use crate::registry::WorkerLoad;
use std::fmt::Write;
use std::sync::Arc;
use std::time::Duration;
use surefoot_net::metrics::family;
use surefoot_world::End;

/// Upper bounds of the tick histogram, ms.
const BOUNDS_MS: [f64; 11] = [0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 12.0, 16.7, 33.3, 100.0];

/// A metric with one sample for each `T`: name, type, help and value.
type Metric<T> = (&'static str, &'static str, &'static str, fn(&T) -> f64);

const OF_PROCESS: [Metric<ProcessFigures>; 5] = [
    ("worlds_failed_total", "counter", "Worlds that panicked.", |it| it.failed_worlds as f64),
    ("saves_failed_total", "counter", "Times that a world could not be saved.", |it| it.failed_saves as f64),
    ("lease_held", "gauge", "1 while this process holds its lease, so that no other has its worlds.", |it| {
        f64::from(u8::from(it.holds_lease))
    }),
    ("worlds_taken_over_total", "counter", "Worlds taken over from other servers.", |it| it.taken_over as f64),
    ("memory_budget_bytes", "gauge", "Memory in use for maps and environments.", |it| it.memory_bytes as f64),
];

const OF_WORKERS: [Metric<WorkerLoad>; 3] = [
    ("worker_capacity", "gauge", "NPCs that a worker can decide for.", |it| f64::from(it.capacity)),
    ("worker_npcs", "gauge", "NPCs that a worker decides for.", |it| f64::from(it.npc_count)),
    ("worker_queue", "gauge", "Messages that a worker has not read yet.", |it| it.queued as f64),
];

const OF_WORLDS: [Metric<WorldFigures>; 13] = [
    ("npcs_without_worker", "gauge", "NPCs without a worker.", |it| f64::from(it.tally.without_worker)),
    ("watchers", "gauge", "Readers of snapshots and segments.", |it| it.watchers as f64),
    ("ticks_total", "counter", "Ticks stepped.", |it| it.summary.tick.0 as f64),
    ("world_silent_seconds", "gauge", "Time since the world's thread wrote these figures.", |it| {
        it.age().as_secs_f64()
    }),
    ("world_calls_total", "counter", "Calls that the world's thread has run.", |it| it.calls as f64),
    ("ticks_dropped_total", "counter", "Ticks dropped after falling behind.", |it| it.counters.ticks_dropped as f64),
    ("ticks_late_total", "counter", "Ticks done after the next one was due.", |it| it.counters.ticks_late as f64),
    ("decisions_asked_total", "counter", "Decisions requested from workers.", |it| it.counters.asked as f64),
    ("decisions_answered_total", "counter", "Decisions answered in time.", |it| it.counters.answered as f64),
    ("decisions_missed_total", "counter", "Decisions not answered in time.", |it| it.counters.missed as f64),
    ("answers_stale_total", "counter", "Answers to decisions that were no longer pending.", |it| {
        it.counters.stale as f64
    }),
    ("answers_invalid_total", "counter", "Actions, waypoints and plans ignored for a bad number.", |it| {
        it.counters.invalid as f64
    }),
    ("plans_failed_total", "counter", "Plans that planners failed to deliver to workers.", |it| {
        it.counters.plans_failed as f64
    }),
];

/// Renders metrics of `all`, whose samples have the same labels.
fn families<'a, T: 'a>(
    metrics: &[Metric<T>],
    all: impl Iterator<Item = &'a T> + Clone,
    labels: impl Fn(&T) -> String,
) -> String {
    let family =
        |(name, kind, help, value): &Metric<T>| family(name, kind, help, all.clone().map(|it| (labels(it), value(it))));
    metrics.iter().map(family).collect()
}

/// Figures of the process.
#[derive(Debug, Clone, Copy)]
pub struct ProcessFigures {
    /// Worlds that panicked since the start.
    pub failed_worlds: u64,
    /// Times that a world could not be saved since the start.
    pub failed_saves: u64,
    /// Memory in use for maps and environments.
    pub memory_bytes: u64,
    /// Whether no other server of the fleet can have taken over its worlds.
    pub holds_lease: bool,
    /// Worlds that were taken over from other servers of the fleet since the start.
    pub taken_over: u64,
}

pub fn render(worlds: &[Arc<WorldFigures>], workers: &[WorkerLoad], process: ProcessFigures) -> String {
    let policies = workers.iter().map(|worker| {
        let (name, policy) = (escaped(&worker.name), escaped(&worker.policy));
        (format!("{{worker=\"{}\",name=\"{name}\",policy=\"{policy}\"}}", worker.id.0), 1.0)
    });
    let of_worker = |worker: &WorkerLoad| format!("{{worker=\"{}\",name=\"{}\"}}", worker.id.0, escaped(&worker.name));
    let by_state = worlds.iter().flat_map(|world| {
        let Tally { idle, seeking, down, .. } = world.tally;
        [("idle", idle), ("seeking", seeking), ("down", down)]
            .map(|(state, count)| (format!("{{world=\"{}\",state=\"{state}\"}}", world.summary.id), f64::from(count)))
    });
    let standing = worlds.iter().flat_map(|world| {
        let counts = Standing::ALL.iter().zip(world.tally.standing);
        counts.map(|(reason, count)| {
            (format!("{{world=\"{}\",reason=\"{}\"}}", world.summary.id, reason.name()), f64::from(count))
        })
    });
    let ends = worlds.iter().flat_map(|world| {
        let counts = End::ALL.iter().zip(world.counters.ends);
        counts.map(|(end, count)| (format!("{{world=\"{}\",end=\"{}\"}}", world.summary.id, end.name()), count as f64))
    });
    let of_world = |world: &WorldFigures| format!("{{world=\"{}\"}}", world.summary.id);
    [
        family("workers", "gauge", "Connected NPC workers.", [("", workers.len() as f64)]),
        family("worker_info", "gauge", "Connected NPC workers and their policies.", policies),
        families(&OF_WORKERS, workers.iter(), of_worker),
        family("worlds", "gauge", "Running worlds.", [("", worlds.len() as f64)]),
        families(&OF_PROCESS, [&process].into_iter(), |_| String::new()),
        family("npcs", "gauge", "NPCs by status.", by_state),
        family("npcs_standing", "gauge", "NPCs with a goal that stand, by reason.", standing),
        families(&OF_WORLDS, worlds.iter().map(|world| &**world), of_world),
        family("attempts_total", "counter", "Attempts by outcome.", ends),
        tick_times(worlds),
    ]
    .concat()
}

fn tick_times(worlds: &[Arc<WorldFigures>]) -> String {
    let (name, help) = ("tick_seconds", "Time from when a tick was due until it was done.");
    let mut text = family::<&str>(name, "histogram", help, []);
    for world in worlds {
        let mut line = |suffix: &str, labels: String, value: f64| {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "surefoot_{name}_{suffix}{{world=\"{}\"{labels}}} {value}", world.summary.id);
        };
        for bound in BOUNDS_MS {
            let below = world.times.below(Duration::from_secs_f64(bound * 1.0e-3));
            line("bucket", format!(",le=\"{}\"", bound / 1.0e3), below as f64);
        }
        line("bucket", ",le=\"+Inf\"".to_owned(), world.times.count() as f64);
        line("sum", String::new(), world.times.total().as_secs_f64());
        line("count", String::new(), world.times.count() as f64);
    }
    text
}

fn escaped(value: &str) -> String {
    value.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}
