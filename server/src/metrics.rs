//! The metrics of a server as Prometheus text.

use crate::figures::WorldFigures;
use crate::hosted::Tally;
use crate::registry::WorkerLoad;
use std::fmt::Write;
use std::sync::Arc;
use std::time::Duration;
use surefoot_world::End;

/// Upper bounds of the tick histogram, ms.
const BOUNDS_MS: [f64; 11] = [0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 12.0, 16.7, 33.3, 100.0];

/// Prometheus text that is being written, one family of samples after another.
#[derive(Default)]
struct Text(String);

impl Text {
    fn family(&mut self, name: &str, kind: &str, help: &str, samples: impl IntoIterator<Item = (String, f64)>) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.0, "# HELP surefoot_{name} {help}\n# TYPE surefoot_{name} {kind}");
        for (labels, value) in samples {
            let _ = writeln!(self.0, "surefoot_{name}{labels} {value}");
        }
    }
}

/// Figures that belong to no world.
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

/// Renders all figures.
pub fn render(worlds: &[Arc<WorldFigures>], workers: &[WorkerLoad], process: ProcessFigures) -> String {
    let mut text = Text::default();
    render_workers(&mut text, workers);
    let per_world = |value: fn(&WorldFigures) -> f64| {
        worlds.iter().map(move |world| (format!("{{world=\"{}\"}}", world.summary.id), value(world)))
    };
    text.family("worlds", "gauge", "Running worlds.", [(String::new(), worlds.len() as f64)]);
    let failed = process.failed_worlds as f64;
    text.family("worlds_failed_total", "counter", "Worlds that panicked.", [(String::new(), failed)]);
    let failed = process.failed_saves as f64;
    text.family("saves_failed_total", "counter", "Times that a world could not be saved.", [(String::new(), failed)]);
    let sure = f64::from(u8::from(process.holds_lease));
    let help = "Whether nobody can have taken over what this process has.";
    text.family("lease_held", "gauge", help, [(String::new(), sure)]);
    let taken = process.taken_over as f64;
    text.family("worlds_taken_over_total", "counter", "Worlds taken over from others.", [(String::new(), taken)]);
    let memory = process.memory_bytes as f64;
    text.family("memory_budget_bytes", "gauge", "Memory in use for maps and environments.", [(String::new(), memory)]);
    let by_state = worlds.iter().flat_map(|world| {
        let Tally { idle, seeking, down, .. } = world.tally;
        [("idle", idle), ("seeking", seeking), ("down", down)]
            .map(|(state, count)| (format!("{{world=\"{}\",state=\"{state}\"}}", world.summary.id), f64::from(count)))
    });
    text.family("npcs", "gauge", "NPCs by status.", by_state);
    let without_worker = per_world(|world| f64::from(world.tally.without_worker));
    text.family("npcs_without_worker", "gauge", "NPCs without a worker.", without_worker);
    let watchers = per_world(|world| world.watchers as f64);
    text.family("watchers", "gauge", "Readers of snapshots.", watchers);
    text.family("ticks_total", "counter", "Ticks stepped.", per_world(|world| world.summary.tick.0 as f64));
    let silent = per_world(|world| world.age().as_secs_f64());
    text.family("world_silent_seconds", "gauge", "Time since the world's thread wrote these figures.", silent);
    let calls = per_world(|world| world.calls as f64);
    text.family("world_calls_total", "counter", "Calls that the world's thread has run.", calls);
    let dropped = per_world(|world| world.counters.ticks_dropped as f64);
    text.family("ticks_dropped_total", "counter", "Ticks dropped after falling behind.", dropped);
    let late = per_world(|world| world.counters.ticks_late as f64);
    text.family("ticks_late_total", "counter", "Ticks done after the next one was due.", late);
    let requested = per_world(|world| world.counters.asked as f64);
    text.family("decisions_asked_total", "counter", "Decisions requested from workers.", requested);
    let answered = per_world(|world| world.counters.answered as f64);
    text.family("decisions_answered_total", "counter", "Decisions answered in time.", answered);
    let missed = per_world(|world| world.counters.missed as f64);
    text.family("decisions_missed_total", "counter", "Decisions not answered in time.", missed);
    let stale = per_world(|world| world.counters.stale as f64);
    text.family("answers_stale_total", "counter", "Answers that nobody waited for any more.", stale);
    let invalid = per_world(|world| world.counters.invalid as f64);
    text.family("answers_invalid_total", "counter", "Actions, waypoints and plans ignored for a bad number.", invalid);
    let unplanned = per_world(|world| world.counters.plans_failed as f64);
    text.family("plans_failed_total", "counter", "Plans that planners failed to deliver to workers.", unplanned);
    let ends = worlds.iter().flat_map(|world| {
        let counts = End::ALL.iter().zip(world.counters.ends);
        counts.map(|(end, count)| (format!("{{world=\"{}\",end=\"{}\"}}", world.summary.id, end.name()), count as f64))
    });
    text.family("attempts_total", "counter", "Attempts by outcome.", ends);
    render_ticks(&mut text, worlds);
    text.0
}

fn render_workers(text: &mut Text, workers: &[WorkerLoad]) {
    let per_worker = |value: fn(&WorkerLoad) -> f64| {
        workers.iter().map(move |worker| {
            let labels = format!("{{worker=\"{}\",name=\"{}\"}}", worker.id.0, escaped(&worker.name));
            (labels, value(worker))
        })
    };
    text.family("workers", "gauge", "Connected NPC workers.", [(String::new(), workers.len() as f64)]);
    let policies = workers.iter().map(|worker| {
        let (name, policy) = (escaped(&worker.name), escaped(&worker.policy));
        (format!("{{worker=\"{}\",name=\"{name}\",policy=\"{policy}\"}}", worker.id.0), 1.0)
    });
    text.family("worker_info", "gauge", "Connected NPC workers and their policies.", policies);
    let capacity = per_worker(|worker| f64::from(worker.capacity));
    text.family("worker_capacity", "gauge", "NPCs that a worker can decide for.", capacity);
    text.family(
        "worker_npcs",
        "gauge",
        "NPCs that a worker decides for.",
        per_worker(|worker| f64::from(worker.npc_count)),
    );
    let queued = per_worker(|worker| worker.queued as f64);
    text.family("worker_queue", "gauge", "Messages that a worker has not read yet.", queued);
}

fn render_ticks(text: &mut Text, worlds: &[Arc<WorldFigures>]) {
    let (name, help) = ("tick_seconds", "Time from when a tick was due until it was done.");
    text.family(name, "histogram", help, []);
    for world in worlds {
        let mut line = |suffix: &str, labels: String, value: f64| {
            let _ = writeln!(text.0, "surefoot_{name}_{suffix}{{world=\"{}\"{labels}}} {value}", world.summary.id);
        };
        for bound in BOUNDS_MS {
            let below = world.times.below(Duration::from_secs_f64(bound * 1.0e-3));
            line("bucket", format!(",le=\"{}\"", bound * 1.0e-3), below as f64);
        }
        line("bucket", ",le=\"+Inf\"".to_owned(), world.times.count() as f64);
        line("sum", String::new(), world.times.total().as_secs_f64());
        line("count", String::new(), world.times.count() as f64);
    }
}

/// Escapes the value of a label.
fn escaped(value: &str) -> String {
    value.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}
