//! Many NPCs on one map.

use crate::character::{Action, Body, CharacterProfile, MoveScratch, TickEvents};
use crate::map::{Liquid, Map};
use crate::sense::{self, LastDecision, RayCone, SenseContext};
use crate::task::{End, Episode, TaskConfig};
use crate::{TICKS_PER_DECISION, Vec3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Index of an NPC's place in its world's arrays; reused after the NPC is removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NpcSlot(pub u32);

/// One NPC: its body, its running decision and its episode.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Npc {
    /// Position and motion.
    pub body: Body,
    /// The action that is held.
    pub action: Action,
    /// The attempt under way; an NPC without one stands still.
    pub episode: Option<Episode>,
    /// What the running decision started from.
    pub last: LastDecision,
    /// What happened since the running decision began.
    pub events: TickEvents,
    /// The hazard it came to; it stays where that happened until it is teleported.
    pub harm: Option<End>,
}

/// What one decision came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DecisionOutcome {
    /// Reward of the decision.
    pub reward: f32,
    /// How the episode ended, if it did.
    pub end: Option<End>,
}

/// Everything about a world that changes while it is stepped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorldState {
    tick: u64,
    npcs: Vec<Option<Npc>>,
}

/// A map with its NPCs, stepped tick by tick. Nothing is allocated while stepping.
///
/// The calls of one decision, for one NPC: [`World::observe`], [`World::decide`], ten times [`World::tick`]
/// (which moves every NPC), [`World::close_decision`]. NPCs may be at different ticks of their decisions.
#[derive(Debug)]
pub struct World {
    map: Arc<Map>,
    profile: CharacterProfile,
    task: TaskConfig,
    cone: RayCone,
    tick: u64,
    npcs: Vec<Option<Npc>>,
    scratch: MoveScratch,
}

impl World {
    /// An empty world on `map`.
    pub fn new(map: Arc<Map>, profile: CharacterProfile, task: TaskConfig) -> Self {
        Self {
            map,
            profile,
            task,
            cone: RayCone::default(),
            tick: 0,
            npcs: Vec::new(),
            scratch: MoveScratch::default(),
        }
    }

    /// A copy of all that changes; together with the map, the profile and the task it restores this world.
    pub fn save(&self) -> WorldState {
        WorldState { tick: self.tick, npcs: self.npcs.clone() }
    }

    /// Continues from a saved state; the map, profile and task must be those it was saved with.
    pub fn restore(&mut self, state: WorldState) {
        self.tick = state.tick;
        self.npcs = state.npcs;
    }

    /// The map.
    pub fn map(&self) -> &Arc<Map> {
        &self.map
    }

    /// The profile of every NPC here.
    pub fn profile(&self) -> &CharacterProfile {
        &self.profile
    }

    /// Constants of the task.
    pub fn task(&self) -> &TaskConfig {
        &self.task
    }

    /// Ticks stepped so far.
    pub fn current_tick(&self) -> u64 {
        self.tick
    }

    /// Adds a resting NPC and returns its slot.
    pub fn spawn(&mut self, feet: Vec3, yaw: f32) -> NpcSlot {
        let npc = Npc {
            body: Body::at(feet, yaw),
            action: Action::default(),
            episode: None,
            last: LastDecision::default(),
            events: TickEvents::default(),
            harm: None,
        };
        let free = self.npcs.iter().position(Option::is_none).unwrap_or_else(|| {
            self.npcs.push(None);
            self.npcs.len() - 1
        });
        self.npcs[free] = Some(npc);
        NpcSlot(free as u32)
    }

    /// Removes an NPC; false if the slot was empty.
    pub fn despawn(&mut self, slot: NpcSlot) -> bool {
        self.npcs.get_mut(slot.0 as usize).is_some_and(|npc| npc.take().is_some())
    }

    /// Slots below this may be taken.
    pub fn slot_count(&self) -> usize {
        self.npcs.len()
    }

    /// The NPC in `slot`.
    pub fn npc(&self, slot: NpcSlot) -> Option<&Npc> {
        self.npcs.get(slot.0 as usize).and_then(Option::as_ref)
    }

    /// All NPCs with their slots.
    pub fn npcs(&self) -> impl Iterator<Item = (NpcSlot, &Npc)> {
        self.npcs.iter().enumerate().filter_map(|(idx, npc)| npc.as_ref().map(|npc| (NpcSlot(idx as u32), npc)))
    }

    /// Puts an NPC elsewhere, at rest and without an episode.
    ///
    /// # Panics
    /// If the slot is empty, like every call below.
    pub fn teleport(&mut self, slot: NpcSlot, feet: Vec3, yaw: f32) {
        let npc = self.npc_mut(slot);
        npc.body = Body::at(feet, yaw);
        npc.action = Action::default();
        npc.episode = None;
        npc.last = LastDecision::default();
        npc.harm = None;
    }

    /// Starts an episode towards `goal`, keeping the body's motion.
    pub fn set_goal(&mut self, slot: NpcSlot, goal: Vec3) {
        let npc = self.npc_mut(slot);
        npc.episode = Some(Episode::new(goal, npc.body.feet));
    }

    /// Ends the episode without an outcome; the NPC comes to rest.
    pub fn clear_goal(&mut self, slot: NpcSlot) {
        let npc = self.npc_mut(slot);
        npc.episode = None;
        npc.action = Action::default();
        npc.body.jump_pending = false;
    }

    /// Starts a decision: `action` is held until the next one.
    pub fn decide(&mut self, slot: NpcSlot, action: Action) {
        let npc = self.npc_mut(slot);
        npc.last.velocity = npc.body.velocity;
        npc.last.action = action.to_array();
        npc.action = action;
        npc.events = TickEvents::default();
        npc.body.begin_decision(&action);
    }

    /// Moves every NPC by one tick. An NPC that came to harm stays where it is;
    /// one that reached its goal runs on until its decision is over.
    pub fn tick(&mut self) {
        let Self { map, profile, task, npcs, scratch, .. } = self;
        for npc in npcs.iter_mut().flatten() {
            tick_npc(npc, map, profile, task, scratch);
        }
        self.tick += 1;
    }

    /// Ten ticks: a whole decision when all NPCs decide together.
    pub fn tick_decision(&mut self) {
        for _ in 0..TICKS_PER_DECISION {
            self.tick();
        }
    }

    /// Closes the running decision of an NPC with an episode: its reward, and its end if it came.
    pub fn close_decision(&mut self, slot: NpcSlot) -> Option<DecisionOutcome> {
        let task = self.task.clone();
        let episode = self.npc_mut(slot).episode.as_mut()?;
        let reward = episode.close_decision(&task);
        Some(DecisionOutcome { reward, end: episode.end })
    }

    /// Writes the NPC's observation into `row`; false (and zeros) if it has no episode.
    pub fn observe(&self, slot: NpcSlot, row: &mut [f32]) -> bool {
        let npc = self.npc(slot).expect("observe an occupied slot");
        let Some(episode) = &npc.episode else {
            row.fill(0.0);
            return false;
        };
        let context = SenseContext { map: &self.map, profile: &self.profile, task: &self.task };
        sense::observe(&self.cone, context, &npc.body, episode, &npc.last, row);
        true
    }

    fn npc_mut(&mut self, slot: NpcSlot) -> &mut Npc {
        self.npcs[slot.0 as usize].as_mut().expect("an occupied slot")
    }
}

fn tick_npc(npc: &mut Npc, map: &Map, profile: &CharacterProfile, task: &TaskConfig, scratch: &mut MoveScratch) {
    if npc.harm.is_some() || npc.episode.and_then(|episode| episode.end) == Some(End::NoProgress) {
        return;
    }
    let events = npc.body.tick(map, profile, &npc.action, scratch);
    npc.events.jumped |= events.jumped;
    npc.events.double_jumped |= events.double_jumped;
    npc.events.padded |= events.padded;
    npc.harm = hazard_end(npc, map, task);
    if let Some(episode) = npc.episode.as_mut().filter(|episode| episode.end.is_none()) {
        episode.note_tick(npc.body.feet, task);
        episode.end = episode.end.or(npc.harm);
    }
}

/// The hazard that ends an attempt at this tick.
fn hazard_end(npc: &mut Npc, map: &Map, task: &TaskConfig) -> Option<End> {
    if map.is_outside(npc.body.feet) {
        return Some(End::Fell);
    }
    match map.liquid_at(npc.body.feet, 0.0) {
        Some(Liquid::Lava) => Some(End::Burnt),
        Some(Liquid::Water) => {
            npc.last.ticks_in_water += 1;
            (npc.last.ticks_in_water >= task.drown_ticks).then_some(End::Drowned)
        }
        None => {
            npc.last.ticks_in_water = npc.last.ticks_in_water.saturating_sub(1);
            None
        }
    }
}
