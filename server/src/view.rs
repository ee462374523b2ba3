//! What one reader sees of a world: the NPCs of a region, all of them or only those that changed.

use crate::hosted::{NpcState, Snapshot};
use crate::ids::NpcId;
use std::collections::BTreeMap;
use std::time::SystemTime;
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

    /// Whether a point lies inside.
    pub fn holds(&self, point: Vec3) -> bool {
        self.low.cmple(point).all() && point.cmple(self.high).all()
    }
}

/// What a reader is shown of one snapshot.
#[derive(Debug, Clone, PartialEq)]
pub struct Shown {
    /// When it was taken, in the world's time.
    pub tick: Tick,
    /// When it was taken, by the server's clock.
    pub time: SystemTime,
    /// NPCs of the region: all of them, or those that the reader does not know yet.
    pub npcs: Vec<NpcState>,
    /// NPCs that the reader knows and that have changed: as they were, and as they are.
    pub changed: Vec<(NpcState, NpcState)>,
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
    /// With changes only: what the reader has, once it has something.
    seen: Option<BTreeMap<NpcId, NpcState>>,
}

impl View {
    /// NPCs of `region`; with `delta` only what changed since the snapshot shown before.
    pub fn new(region: Option<Region>, delta: bool) -> Self {
        Self { region, delta, seen: None }
    }

    /// What the reader is to be sent of a snapshot.
    pub fn show(&mut self, snapshot: &Snapshot) -> Shown {
        let &Snapshot { tick, time, .. } = snapshot;
        let within = |npc: &&NpcState| self.region.is_none_or(|region| region.holds(npc.position));
        let npcs = snapshot.npcs.iter().filter(within).copied();
        let mut shown = Shown { tick, time, npcs: Vec::new(), changed: Vec::new(), is_delta: false, gone: Vec::new() };
        if !self.delta {
            return Shown { npcs: npcs.collect(), ..shown };
        }
        let now: BTreeMap<NpcId, NpcState> = npcs.map(|npc| (npc.id, npc)).collect();
        shown.is_delta = self.seen.is_some();
        let before = self.seen.take().unwrap_or_default();
        for (id, npc) in &now {
            match before.get(id) {
                None => shown.npcs.push(*npc),
                Some(old) if old != npc => shown.changed.push((*old, *npc)),
                Some(_) => {}
            }
        }
        shown.gone = before.keys().filter(|id| !now.contains_key(id)).copied().collect();
        self.seen = Some(now);
        shown
    }
}
