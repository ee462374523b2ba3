//! A world: many NPCs on one map.

use crate::arrival::{Arrival, Place};
use crate::character::{Action, Body, CharacterProfile, MoveScratch};
use crate::crates::Pusher;
use crate::crowd::CrowdScratch;
use crate::editing::{self, Enclosed};
use crate::map::{Liquid, Map, Piece};
use crate::movers::{MoverOrder, MoverState, Movers};
use crate::neighbours::Neighbours;
use crate::npc::{MAX_PROFILES, Npc, NpcSlot, ProfileIdx, WorldConfig, WorldState};
use crate::player::Player;
use crate::recording::{CHECK_EVERY_TICKS, Input, Recording};
use crate::sense::{LastDecision, RayCone};
use crate::slot::BodySlot;
use crate::task::{End, Episode, TaskConfig};
use crate::{AbilitySet, MoverAt, MoverId, TICKS_PER_DECISION, Tick, Vec3};
use std::collections::BTreeSet;
use std::sync::Arc;

mod footing;
mod players;
mod profiles;
mod sensing;

/// Result of one decision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DecisionOutcome {
    /// Reward of the decision.
    pub reward: f32,
    /// How the episode ended, if it did.
    pub end: Option<End>,
}

/// A map with its NPCs, stepped tick by tick. Once its buffers have grown, a tick allocates memory only if the map has
/// crates or a recording runs.
///
/// The calls of one decision, for one NPC: [`World::observe`], [`World::decide`], ten times [`World::tick`]
/// (which moves every NPC), [`World::close_decision`]. Different NPCs may be at different ticks of their decisions.
#[derive(Debug)]
pub struct World {
    map: Arc<Map>,
    config: WorldConfig,
    cone: RayCone,
    tick: Tick,
    npcs: Vec<Option<Npc>>,
    /// Empty slots of `npcs`.
    free: BTreeSet<u32>,
    /// Abilities that each NPC used in the last tick; not part of the state.
    used_in_tick: Vec<AbilitySet>,
    /// Scratch memory of each NPC; not part of the state.
    scratch: Vec<MoveScratch>,
    crowd: CrowdScratch,
    neighbours: Neighbours,
    movers: Movers,
    players: Vec<Option<Player>>,
    recording: Option<Box<Recording>>,
}

impl World {
    /// Creates an empty world on `map` with one profile and without collisions between NPCs.
    pub fn new(map: Arc<Map>, profile: CharacterProfile, task: TaskConfig) -> Self {
        Self::with_config(map, WorldConfig::new(profile, task, false))
    }

    /// Creates an empty world on `map` with one or more profiles.
    ///
    /// # Panics
    /// If there are no profiles or more than 256, or a constant of the task is out of range.
    pub fn with_config(map: Arc<Map>, config: WorldConfig) -> Self {
        assert!((1..=MAX_PROFILES).contains(&config.profiles.len()), "1 to {MAX_PROFILES} profiles");
        assert!(config.task.is_sound(), "constants of the task in range");
        Self {
            movers: Movers::new(&map),
            map,
            config,
            cone: RayCone::default(),
            tick: Tick(0),
            npcs: Vec::new(),
            free: BTreeSet::new(),
            used_in_tick: Vec::new(),
            scratch: Vec::new(),
            crowd: CrowdScratch::default(),
            neighbours: Neighbours::default(),
            players: Vec::new(),
            recording: None,
        }
    }

    /// Starts to record every input. Discards a recording in progress.
    pub fn start_recording(&mut self) {
        self.recording = Some(Box::new(Recording::begin(&self.map, &self.config, self.save())));
    }

    /// Ends the recording in progress and returns it; `None` if there is none.
    pub fn finish_recording(&mut self) -> Option<Recording> {
        let mut recording = self.recording.take()?;
        recording.note_state(self.tick, self.save().hash());
        Some(*recording)
    }

    fn note(&mut self, input: Input) {
        if let Some(recording) = &mut self.recording {
            recording.note(self.tick, input);
        }
    }

    /// Copies the state, which restores this world together with the map and the configuration.
    pub fn save(&self) -> WorldState {
        let movers = self.movers.states().to_vec();
        WorldState { tick: self.tick, npcs: self.npcs.clone(), movers, players: self.players.clone() }
    }

    /// Restores a saved state of a world with the same map and configuration. Discards a recording in progress.
    pub fn restore(&mut self, state: WorldState) {
        self.recording = None;
        self.tick = state.tick;
        self.npcs = state.npcs;
        self.free = (0..).zip(&self.npcs).filter(|(_, npc)| npc.is_none()).map(|(slot, _)| slot).collect();
        self.neighbours.forget();
        self.movers.restore(&self.map, state.movers);
        self.players = state.players;
        self.used_in_tick = vec![AbilitySet::default(); self.npcs.len()];
        self.scratch.resize_with(self.npcs.len(), MoveScratch::default);
    }

    /// Map of the world.
    pub fn map(&self) -> &Arc<Map> {
        &self.map
    }

    /// Configuration of the world.
    pub fn config(&self) -> &WorldConfig {
        &self.config
    }

    /// Constants of the task.
    pub fn task(&self) -> &TaskConfig {
        &self.config.task
    }

    /// Ticks stepped so far.
    pub fn current_tick(&self) -> Tick {
        self.tick
    }

    /// Adds an NPC of the first profile at rest and returns its slot; `feet` is in m, `yaw` in rad.
    pub fn spawn(&mut self, feet: Vec3, yaw: f32) -> NpcSlot {
        self.spawn_as(ProfileIdx::default(), feet, yaw)
    }

    /// Adds an NPC of a profile at rest and returns its slot; `feet` is in m, `yaw` in rad.
    ///
    /// # Panics
    /// If the world has no such profile.
    pub fn spawn_as(&mut self, profile: ProfileIdx, feet: Vec3, yaw: f32) -> NpcSlot {
        assert!(usize::from(profile.0) < self.config.profiles.len(), "a profile of this world");
        self.note(Input::Spawn(profile, feet, yaw));
        let npc = Npc {
            profile,
            body: Body::at(feet, yaw),
            action: Action::default(),
            episode: None,
            last: LastDecision::default(),
            used_abilities: AbilitySet::default(),
            harm: None,
        };
        let slot = self.free.pop_first().unwrap_or_else(|| {
            self.npcs.push(None);
            self.used_in_tick.push(AbilitySet::default());
            self.scratch.push(MoveScratch::default());
            self.npcs.len() as u32 - 1
        });
        self.npcs[slot as usize] = Some(npc);
        self.used_in_tick[slot as usize] = AbilitySet::default();
        self.list(BodySlot::Npc(NpcSlot(slot)));
        NpcSlot(slot)
    }

    /// Adds a copy of an NPC of another world with the same map and configuration, and returns its slot. Discards a
    /// recording in progress, which cannot contain the copy.
    ///
    /// # Panics
    /// If the world has no such profile.
    pub fn adopt(&mut self, npc: Npc) -> NpcSlot {
        self.recording = None;
        let slot = self.spawn_as(npc.profile, npc.body.feet, npc.body.yaw);
        self.unlist(BodySlot::Npc(slot));
        *self.npc_mut(slot) = npc;
        self.list(BodySlot::Npc(slot));
        slot
    }

    /// Removes all NPCs; the next one gets the first slot.
    pub fn clear(&mut self) {
        self.recording = None;
        self.npcs.clear();
        self.free.clear();
        self.neighbours.forget();
        self.used_in_tick.clear();
        self.scratch.clear();
    }

    /// Removes an NPC; false if the slot was empty.
    pub fn despawn(&mut self, slot: NpcSlot) -> bool {
        if self.npc(slot).is_none() {
            return false;
        }
        self.note(Input::Despawn(slot));
        self.unlist(BodySlot::Npc(slot));
        self.npcs[slot.0 as usize] = None;
        self.free.insert(slot.0)
    }

    /// Number of slots, occupied and empty.
    pub fn slot_count(&self) -> usize {
        self.npcs.len()
    }

    /// The NPC in `slot`; `None` if the slot is empty.
    pub fn npc(&self, slot: NpcSlot) -> Option<&Npc> {
        self.npcs.get(slot.0 as usize).and_then(Option::as_ref)
    }

    /// The profile of an NPC of this world.
    pub fn profile_of(&self, npc: &Npc) -> &CharacterProfile {
        &self.config.profiles[usize::from(npc.profile.0)]
    }

    /// Abilities that the NPC in `slot` used in the last tick.
    ///
    /// # Panics
    /// If no NPC has ever been in `slot`.
    pub fn used_in_tick(&self, slot: NpcSlot) -> AbilitySet {
        self.used_in_tick[slot.0 as usize]
    }

    /// All NPCs with their slots, in ascending order.
    pub fn npcs(&self) -> impl Iterator<Item = (NpcSlot, &Npc)> + Clone {
        self.npcs.iter().enumerate().filter_map(|(idx, npc)| npc.as_ref().map(|npc| (NpcSlot(idx as u32), npc)))
    }

    /// Moves an NPC to another place, where it rests without an episode; `feet` is in m, `yaw` in rad.
    ///
    /// # Panics
    /// If the slot is empty; so do all methods below that take a slot.
    pub fn teleport(&mut self, slot: NpcSlot, feet: Vec3, yaw: f32) {
        self.note(Input::Teleport(slot, feet, yaw));
        self.unlist(BodySlot::Npc(slot));
        let npc = self.npc_mut(slot);
        npc.body = Body::at(feet, yaw);
        npc.action = Action::default();
        npc.episode = None;
        npc.last = LastDecision::default();
        npc.harm = None;
        self.list(BodySlot::Npc(slot));
    }

    /// Starts an episode that ends when the NPC touches `waypoint`, m; the body keeps its motion.
    pub fn set_waypoint(&mut self, slot: NpcSlot, waypoint: Vec3) {
        self.head_for(slot, waypoint, Arrival::Touch);
    }

    /// Starts an episode that ends when the NPC has arrived at `waypoint`, m; the body keeps its motion. An NPC that
    /// follows a plan has one episode for each waypoint.
    pub fn head_for(&mut self, slot: NpcSlot, waypoint: Vec3, arrival: Arrival) {
        self.note(Input::HeadFor(slot, waypoint, arrival));
        let npc = self.npc_mut(slot);
        npc.episode = Some(Episode::new(waypoint, npc.body.feet).arriving(arrival));
    }

    /// Drops the episode; the NPC comes to rest.
    pub fn clear_waypoint(&mut self, slot: NpcSlot) {
        self.note(Input::ClearWaypoint(slot));
        let npc = self.npc_mut(slot);
        npc.episode = None;
        npc.action = Action::default();
        npc.body.jump_pending = false;
    }

    /// Starts a decision: `action` is held until the next one.
    pub fn decide(&mut self, slot: NpcSlot, action: Action) {
        self.note(Input::Decide(slot, action));
        let npc = self.npc_mut(slot);
        npc.last.velocity = npc.body.velocity;
        npc.last.action = action.to_array();
        npc.action = action;
        npc.used_abilities = AbilitySet::default();
        npc.body.begin_decision(&action);
    }

    /// Advances every NPC by one tick. A harmed NPC stays in place. An NPC that has reached its goal continues until
    /// its decision ends.
    pub fn tick(&mut self) {
        if self.movers.is_empty() {
            self.move_npcs(1);
        } else {
            self.move_with_movers();
        }
        if self.has_contacts() {
            let Self { map, config, npcs, scratch, crowd, players, .. } = self;
            let players = players.iter().flatten();
            crowd.separate(npcs, players, map, config, scratch);
        }
        if self.recording.is_some() && self.tick.0.is_multiple_of(CHECK_EVERY_TICKS) {
            let hash = self.save().hash();
            self.recording.iter_mut().for_each(|recording| recording.note_state(self.tick, hash));
        }
    }

    /// Whether NPCs can touch each other or players.
    fn has_contacts(&self) -> bool {
        self.config.npc_collision || self.players.iter().any(Option::is_some)
    }

    /// Advances every NPC by ten ticks, which is a whole decision if all NPCs decide together.
    pub fn tick_decision(&mut self) {
        if self.has_contacts() || self.recording.is_some() || !self.movers.is_empty() {
            (0..TICKS_PER_DECISION).for_each(|_| self.tick());
        } else {
            self.move_npcs(TICKS_PER_DECISION);
        }
    }

    /// Moves the NPCs one by one, each by all ticks, so that its surroundings stay in the cache.
    fn move_npcs(&mut self, tick_count: u32) {
        self.neighbours.forget();
        let Self { map, config, npcs, used_in_tick, scratch, movers, .. } = self;
        for ((npc, used), scratch) in npcs.iter_mut().zip(used_in_tick).zip(scratch) {
            let Some(npc) = npc else { continue };
            let profile = &config.profiles[usize::from(npc.profile.0)];
            for _ in 0..tick_count {
                *used = tick_npc(npc, Place { map, movers, profile }, &config.task, scratch);
            }
        }
        self.tick = self.tick + u64::from(tick_count);
    }

    /// Moves the movers, then the NPCs that they carry and push. A mover that would crush an NPC stays where it was.
    fn move_with_movers(&mut self) {
        self.neighbours.forget();
        let pushers = if self.movers.has_crates() { self.pushers() } else { Vec::new() };
        let Self { map, config, npcs, used_in_tick, scratch, movers, .. } = self;
        movers.advance(map, &pushers);
        for ((npc, used), scratch) in npcs.iter_mut().zip(used_in_tick).zip(scratch) {
            let Some(npc) = npc else { continue };
            let profile = &config.profiles[usize::from(npc.profile.0)];
            if npc.harm.is_some() {
                *used = AbilitySet::default();
                continue;
            }
            let carried = movers.carry(map, profile, &mut npc.body, scratch);
            *used = tick_npc(npc, Place { map, movers, profile }, &config.task, scratch);
            if carried != Vec3::ZERO && !npc.body.is_grounded() {
                // A body that leaves a mover keeps the mover's speed.
                npc.body.velocity += Vec3::new(carried.x, carried.y.max(0.0), carried.z);
            }
            movers.mark_blocked(profile, &npc.body, scratch);
        }
        movers.undo_blocked(map);
        self.tick = self.tick + 1;
    }

    /// Bodies that push crates: walking NPCs and solid players.
    fn pushers(&self) -> Vec<Pusher> {
        let walking = self.npcs.iter().flatten().filter(|npc| npc.harm.is_none() && !npc.body.is_carried());
        let npcs = walking.map(|npc| {
            let profile = &self.config.profiles[usize::from(npc.profile.0)];
            let wish = npc.body.wish(profile, &npc.action);
            Pusher { feet: npc.body.feet, radius: profile.radius, height: profile.height, wish }
        });
        let players = self.players.iter().flatten().filter(|player| player.is_solid());
        let players = players.map(|Player { feet, velocity, radius, height, .. }| Pusher {
            feet: *feet,
            radius: *radius,
            height: *height,
            wish: Vec3::new(velocity.x, 0.0, velocity.z),
        });
        npcs.chain(players).collect()
    }

    /// States of the movers, in the order of the map.
    pub fn movers(&self) -> &[MoverState] {
        self.movers.states()
    }

    /// Gives a mover an order; false, and nothing changes, if it does not exist or cannot follow it.
    pub fn order(&mut self, mover: MoverId, order: MoverOrder) -> bool {
        let obeyed = self.movers.order(&self.map, mover, order);
        if obeyed {
            self.note(Input::Order(mover, order));
        }
        obeyed
    }

    /// Calls a lift or platform to a stop. The call has no effect if the mover cycles, travels, or was called elsewhere
    /// within the last second.
    pub fn call(&mut self, MoverAt { mover, stop }: MoverAt) {
        let idx = mover.idx();
        let called = self.map.movers().get(idx).zip(self.movers.states().get(idx));
        if called.is_some_and(|(mover, state)| state.follows_call(mover, stop)) {
            self.order(mover, MoverOrder::GoTo(stop));
        }
    }

    /// Copies the states of the movers of another world on the same map, in the order of the map. Discards a recording
    /// in progress, which cannot contain them.
    ///
    /// # Panics
    /// If the states do not fit the movers of the map.
    pub fn set_movers(&mut self, states: Vec<MoverState>) {
        assert!(Movers::fit(&self.map, &states), "states of the movers of this map");
        self.recording = None;
        self.movers.restore(&self.map, states);
    }

    /// Replaces the map by `map`, which must differ only in its pieces. Moves each NPC that a new piece would enclose
    /// to the nearest place beside or on top of the piece, where it rests. Returns the slots of these NPCs.
    ///
    /// # Errors
    /// If there is no such place within 4.5 m of one of them; then nothing changes.
    ///
    /// # Panics
    /// If `map` differs in more than its pieces.
    pub fn edit(&mut self, map: Arc<Map>) -> Result<Vec<NpcSlot>, Enclosed> {
        assert!(map.built_hash() == self.map.built_hash(), "the same map but for its pieces");
        // Pieces are sorted by name.
        let known = self.map.pieces();
        let same = |piece: &Piece| known.binary_search_by(|it| it.name.cmp(&piece.name)).map(|at| &known[at] == piece);
        let is_new = |piece: &&Piece| !same(piece).unwrap_or(false);
        let changed: Vec<(Vec3, Vec3)> = map.pieces().iter().filter(is_new).map(Piece::bounds).collect();
        let mut scratch = MoveScratch::default();
        let mut moves = Vec::new();
        for (slot, npc) in self.npcs().filter(|(_, npc)| npc.harm.is_none()) {
            let place = editing::place_for(&map, &changed, self.profile_of(npc), &npc.body, &mut scratch);
            moves.extend(place.map_err(|()| Enclosed(slot))?.map(|place| (slot, place)));
        }
        self.note(Input::Edit(map.pieces().to_vec()));
        self.map = map;
        self.movers.wake_crates();
        self.neighbours.forget();
        for &(slot, place) in &moves {
            let npc = self.npc_mut(slot);
            npc.body = Body::at(place, npc.body.yaw);
        }
        Ok(moves.into_iter().map(|(slot, _)| slot).collect())
    }

    /// Closes the current decision of an NPC and returns its reward; `None` if the NPC has no episode.
    pub fn close_decision(&mut self, slot: NpcSlot) -> Option<DecisionOutcome> {
        self.note(Input::Close(slot));
        let npc = self.npcs[slot.0 as usize].as_mut().expect("an occupied slot");
        let episode = npc.episode.as_mut()?;
        let reward = episode.close_decision(&self.config.task);
        Some(DecisionOutcome { reward, end: episode.end })
    }

    fn npc_mut(&mut self, slot: NpcSlot) -> &mut Npc {
        self.npcs[slot.0 as usize].as_mut().expect("an occupied slot")
    }
}

fn tick_npc(npc: &mut Npc, at: Place<'_>, task: &TaskConfig, scratch: &mut MoveScratch) -> AbilitySet {
    if npc.harm.is_some() || npc.episode.and_then(|episode| episode.end) == Some(End::NoProgress) {
        return AbilitySet::default();
    }
    let before = npc.body;
    let used = npc.body.tick(at.map, at.profile, &npc.action, scratch);
    if !(npc.body.feet.is_finite() && npc.body.velocity.is_finite()) {
        // A position that is not finite must not spread: the body stays at its last position and counts as fallen.
        npc.body = before;
        npc.harm = Some(End::Fell);
    }
    npc.used_abilities = npc.used_abilities.union(used);
    npc.harm = npc.harm.or_else(|| hazard_end(npc, at, task));
    if let Some(episode) = npc.episode.as_mut().filter(|episode| episode.end.is_none()) {
        episode.note_tick(npc.body.feet, task);
        if episode.arrival.is_met(at, &npc.body, episode.goal, task.goal_radius) {
            episode.end = Some(End::Reached);
        }
        episode.end = episode.end.or(npc.harm);
    }
    used
}

/// The hazard that ends an attempt in this tick; counts ticks in water.
fn hazard_end(npc: &mut Npc, Place { map, profile, .. }: Place<'_>, task: &TaskConfig) -> Option<End> {
    if map.is_outside(npc.body.feet) {
        return Some(End::Fell);
    }
    match map.liquid_at(npc.body.feet, 0.0) {
        Some(Liquid::Lava) => Some(End::Burnt),
        Some(Liquid::Water) if profile.is_harmed_by(Liquid::Water) => {
            npc.last.ticks_in_water += 1;
            (npc.last.ticks_in_water >= task.drown_ticks).then_some(End::Drowned)
        }
        Some(Liquid::Water) if npc.body.is_out_of_breath(profile) => Some(End::Drowned),
        Some(Liquid::Water) | None => {
            npc.last.ticks_in_water = npc.last.ticks_in_water.saturating_sub(1);
            None
        }
    }
}
