//! The latest figures of a world. Its thread overwrites them after each tick; other threads read them without a call.

use crate::hosted::{Counters, HostedWorld, Tally, TimeMode};
use crate::ids::WorldId;
use crate::times::TickTimes;
use std::sync::Arc;
use std::time::{Duration, Instant};
use surefoot_world::{CharacterProfile, Map, Tick};

/// Description of a world at one moment.
#[derive(Debug, Clone)]
pub struct WorldSummary {
    /// Id of the world.
    pub id: WorldId,
    /// The map of the world.
    pub map: Arc<Map>,
    /// How the world's time passes.
    pub mode: TimeMode,
    /// Number of NPCs.
    pub npc_count: usize,
    /// Number of ticks stepped.
    pub tick: Tick,
    /// Bodies that its NPCs have or had, the default one first.
    pub bodies: Vec<CharacterProfile>,
    /// Whether its NPCs collide with each other.
    pub solid_npcs: bool,
}

impl WorldSummary {
    /// Describes a world.
    pub fn of(world: &HostedWorld) -> Self {
        Self {
            id: world.id(),
            map: world.map().clone(),
            mode: world.mode(),
            npc_count: world.npc_count(),
            tick: world.tick(),
            bodies: world.bodies().to_vec(),
            solid_npcs: world.has_solid_npcs(),
        }
    }
}

/// Figures of a world.
#[derive(Debug, Clone)]
pub struct WorldFigures {
    /// Description of the world.
    pub summary: WorldSummary,
    /// Its NPCs by status.
    pub tally: Tally,
    /// Readers of its snapshots.
    pub watchers: usize,
    /// Calls that its thread has run.
    pub calls: u64,
    /// Counters since the world began.
    pub counters: Counters,
    /// Times from when ticks were due until they were done.
    pub times: TickTimes,
    /// When the thread wrote this.
    written: Instant,
}

impl WorldFigures {
    /// The figures of a world with `watchers` readers, whose thread has run `calls` calls.
    pub fn of(world: &HostedWorld, watchers: usize, calls: u64) -> Self {
        Self {
            summary: WorldSummary::of(world),
            tally: world.tally(),
            watchers,
            calls,
            counters: world.counters().clone(),
            times: world.times().clone(),
            written: Instant::now(),
        }
    }

    /// Time since the world's thread wrote this. A thread that is not stuck writes at least every 50 ms.
    pub fn age(&self) -> Duration {
        self.written.elapsed()
    }
}
