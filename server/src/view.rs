//! What one reader sees of a world: the NPCs of a region, all of them or only those that changed.

use crate::hosted::{NpcState, Snapshot, WorldStats};
use crate::ids::NpcId;
use std::collections::BTreeMap;
use surefoot_world::{Tick, Vec3};

/// A box with edges along the axes; the low corner is nowhere above the high one.
#[derive(Debug, Clone, Copy)]
pub struct Region {
    /// Lowest corner, m.
    pub low: Vec3,
    /// Highest corner, m.
    pub high: Vec3,
}

impl Region {
    /// Its lowest and its highest corner, m.
    pub fn corners(&self) -> [Vec3; 2] {
        [self.low, self.high]
    }

    fn holds(&self, point: Vec3) -> bool {
        self.low.cmple(point).all() && point.cmple(self.high).all()
    }
}

/// What a reader is shown of one snapshot.
#[derive(Debug, Clone, PartialEq)]
pub struct Shown {
    /// When it was taken.
    pub tick: Tick,
    /// NPCs of the region: all of them, or those that changed.
    pub npcs: Vec<NpcState>,
    /// Figures of the world.
    pub stats: WorldStats,
    /// Whether only changes are shown.
    pub is_delta: bool,
    /// NPCs that have left the region or the world since the snapshot shown before.
    pub gone: Vec<NpcId>,
}

/// Turns snapshots into what one reader asked for.
#[derive(Debug)]
pub struct View {
    region: Option<Region>,
    delta: bool,
    /// With changes only: what the reader has.
    seen: Option<BTreeMap<NpcId, NpcState>>,
}

impl View {
    /// NPCs of `region`; with `delta` only what changed since the snapshot shown before.
    pub fn new(region: Option<Region>, delta: bool) -> Self {
        Self { region, delta, seen: None }
    }

    /// What the reader is to be sent of a snapshot.
    pub fn show(&mut self, snapshot: &Snapshot) -> Shown {
        let within = |npc: &&NpcState| self.region.is_none_or(|region| region.holds(npc.position));
        let npcs: Vec<NpcState> = snapshot.npcs.iter().filter(within).copied().collect();
        let (tick, stats) = (snapshot.tick, snapshot.stats.clone());
        let full = Shown { tick, npcs, stats, is_delta: false, gone: Vec::new() };
        if !self.delta {
            return full;
        }
        let now: BTreeMap<NpcId, NpcState> = full.npcs.iter().map(|npc| (npc.id, *npc)).collect();
        let Some(before) = self.seen.replace(now) else { return full };
        let now = self.seen.as_ref().expect("just put there");
        Shown {
            gone: before.keys().filter(|id| !now.contains_key(id)).copied().collect(),
            npcs: full.npcs.into_iter().filter(|npc| before.get(&npc.id) != Some(npc)).collect(),
            is_delta: true,
            ..full
        }
    }
}
