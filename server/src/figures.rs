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
    pub id: WorldId,
    pub map: Arc<Map>,
    pub mode: TimeMode,
    pub npc_count: usize,
    /// Number of ticks stepped.
    pub tick: Tick,
    /// Bodies that its NPCs have or had, the default one first.
    pub bodies: Vec<CharacterProfile>,
    pub solid_npcs: bool,
    pub zone_count: usize,
}

impl WorldSummary {
    pub fn of(world: &HostedWorld) -> Self {
        Self {
            id: world.id(),
            map: world.map().clone(),
            mode: world.mode(),
            npc_count: world.npc_count(),
            tick: world.tick(),
            bodies: world.bodies().to_vec(),
            solid_npcs: world.has_solid_npcs(),
            zone_count: world.zones().count(),
        }
    }
}

/// Figures of a world.
#[derive(Debug, Clone)]
pub struct WorldFigures {
    pub summary: WorldSummary,
    pub tally: Tally,
    pub watchers: usize,
    pub calls: u64,
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
