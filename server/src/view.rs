//! One reader's view of a world: the NPCs of a region, either all of them or only changes.

use crate::hosted::{NpcState, Snapshot};
use crate::ids::NpcId;
use std::collections::BTreeMap;
use std::time::SystemTime;
use surefoot_world::map::MoverStop;
use surefoot_world::{MoverState, Player, PlayerSlot, Tick, Vec3};

/// An axis-aligned box; no coordinate of `low` exceeds that of `high`.
#[derive(Debug, Clone, Copy)]
pub struct Region {
    pub low: Vec3,
    pub high: Vec3,
}

impl Region {
    pub fn corners(&self) -> [Vec3; 2] {
        [self.low, self.high]
    }

    /// Whether the region contains a point; the boundary counts.
    pub fn holds(&self, point: Vec3) -> bool {
        self.low.cmple(point).all() && point.cmple(self.high).all()
    }
}

/// The part of a snapshot for one reader.
#[derive(Debug, Clone, PartialEq)]
pub struct Shown {
    pub tick: Tick,
    /// Time of the server's clock at the snapshot.
    pub time: SystemTime,
    /// NPCs of the region: all of them, or those that are new to the reader.
    pub npcs: Vec<NpcState>,
    /// Known NPCs that have changed: old state, new state.
    pub changed: Vec<(NpcState, NpcState)>,
    /// Whether this has only changes since the previous snapshot.
    pub is_delta: bool,
    /// NPCs that have left the region or the world since the previous snapshot.
    pub gone: Vec<NpcId>,
    /// State and pose of movers by index: all of them, or those that have changed since the previous snapshot.
    pub movers: Vec<(usize, MoverState, MoverStop)>,
    pub players: Vec<(PlayerSlot, Player)>,
    pub map_revision: u64,
}

/// Reduces snapshots to the subscription of one reader.
#[derive(Debug)]
pub struct View {
    region: Option<Region>,
    delta: bool,
    /// Whether the reader gets how NPCs move.
    movement: bool,
    /// With `delta`: the NPCs that the reader knows; `None` before the first snapshot.
    seen: Option<BTreeMap<NpcId, NpcState>>,
    /// With `delta`: the movers as last sent.
    seen_movers: Vec<(MoverState, MoverStop)>,
}

impl View {
    /// A view of the NPCs in `region` (`None`: everywhere); with `delta`, only changes since the previous snapshot.
    pub fn new(region: Option<Region>, delta: bool) -> Self {
        Self { region, delta, movement: false, seen: None, seen_movers: Vec::new() }
    }

    /// The same view, with or without how NPCs move.
    pub fn with_movement(self, movement: bool) -> Self {
        Self { movement, ..self }
    }

    /// Returns the part of `snapshot` for the reader.
    pub fn show(&mut self, snapshot: &Snapshot) -> Shown {
        let &Snapshot { tick, time, .. } = snapshot;
        let within = |npc: &&NpcState| self.region.is_none_or(|region| region.holds(npc.position));
        let shown = |npc: &NpcState| if self.movement { *npc } else { npc.without_movement() };
        let npcs = snapshot.npcs.iter().filter(within).map(shown);
        let known = std::mem::replace(&mut self.seen_movers, snapshot.movers.clone());
        let movers = snapshot.movers.iter().enumerate();
        let is_news = |(idx, mover): &(usize, &(MoverState, MoverStop))| !self.delta || known.get(*idx) != Some(*mover);
        let movers = movers.filter(is_news).map(|(idx, (state, pose))| (idx, *state, *pose)).collect();
        let players = snapshot.players.clone();
        let mut shown = Shown {
            tick,
            time,
            npcs: Vec::new(),
            changed: Vec::new(),
            is_delta: false,
            gone: Vec::new(),
            movers,
            players,
            map_revision: snapshot.map_revision,
        };
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
