//! The Prometheus text of a server.

use crate::hosted::HostedWorld;
use std::fmt::Write;
use surefoot_world::End;

/// Figures of one world, copied out of its thread.
#[derive(Debug, Clone)]
pub struct WorldFigures {
    id: u64,
    npcs: usize,
    ticks: u64,
    counters: crate::hosted::Counters,
    tick_us: Vec<f32>,
}

impl WorldFigures {
    /// Copies the figures of `world`.
    pub fn of(id: u64, world: &HostedWorld) -> Self {
        Self {
            id,
            npcs: world.npc_count(),
            ticks: world.tick(),
            counters: world.counters().clone(),
            tick_us: world.tick_us().to_vec(),
        }
    }
}

/// Upper bounds of the tick histogram, s.
const BUCKETS: [f32; 7] = [0.000_5, 0.001, 0.002, 0.005, 0.01, 0.016_67, 0.05];

/// Renders all figures.
pub fn render(worlds: &[WorldFigures], workers: usize, carried: u32) -> String {
    let mut text = String::new();
    let mut family = |name: &str, kind: &str, help: &str, samples: &[(String, f64)]| {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "# HELP surefoot_{name} {help}\n# TYPE surefoot_{name} {kind}");
        for (labels, value) in samples {
            let _ = writeln!(text, "surefoot_{name}{labels} {value}");
        }
    };
    let per_world = |value: &dyn Fn(&WorldFigures) -> f64| -> Vec<(String, f64)> {
        worlds.iter().map(|world| (format!("{{world=\"{}\"}}", world.id), value(world))).collect()
    };
    family("workers", "gauge", "Connected NPC workers.", &[(String::new(), workers as f64)]);
    family("npcs_carried", "gauge", "NPCs that have a worker.", &[(String::new(), f64::from(carried))]);
    family("npcs", "gauge", "NPCs on each world.", &per_world(&|world| world.npcs as f64));
    family("ticks_total", "counter", "Ticks stepped.", &per_world(&|world| world.ticks as f64));
    family(
        "ticks_dropped_total",
        "counter",
        "Ticks dropped to catch up.",
        &per_world(&|world| world.counters.ticks_dropped as f64),
    );
    family(
        "decisions_asked_total",
        "counter",
        "Decisions asked for.",
        &per_world(&|world| world.counters.asked as f64),
    );
    family(
        "decisions_answered_total",
        "counter",
        "Decisions answered in time.",
        &per_world(&|world| world.counters.answered as f64),
    );
    family(
        "decisions_missed_total",
        "counter",
        "Decisions not answered in time.",
        &per_world(&|world| world.counters.missed as f64),
    );
    family(
        "answers_stale_total",
        "counter",
        "Answers that nobody waited for any more.",
        &per_world(&|world| world.counters.stale as f64),
    );
    let mut ends = Vec::new();
    for world in worlds {
        for (end, count) in End::ALL.iter().zip(world.counters.ends) {
            ends.push((format!("{{world=\"{}\",end=\"{}\"}}", world.id, end.name()), count as f64));
        }
    }
    family("attempts_total", "counter", "Attempts by how they ended.", &ends);
    let mut ticks = Vec::new();
    for world in worlds {
        for bound in BUCKETS {
            let below = world.tick_us.iter().filter(|us| **us <= bound * 1.0e6).count();
            ticks.push((format!("{{world=\"{}\",le=\"{bound}\"}}", world.id), below as f64));
        }
        ticks.push((format!("{{world=\"{}\",le=\"+Inf\"}}", world.id), world.tick_us.len() as f64));
    }
    family("recent_tick_seconds", "gauge", "Of the last 600 ticks, how many took at most so long.", &ticks);
    text
}
