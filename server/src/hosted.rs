//! One world on the server: its NPCs, whose decision is due, who answers, how attempts end.
//!
//! A tick is [`HostedWorld::ask`], the physics, and [`HostedWorld::settle`]. Answers arrive between ticks.

use crate::registry::{Registry, WorkerId};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::collections::BTreeMap;
use std::sync::Arc;
use surefoot_proto::convert;
use surefoot_proto::world::v1 as wire;
use surefoot_world::character::Action;
use surefoot_world::{
    CharacterProfile, End, Map, NpcSlot, OBSERVATION_LEN, TICKS_PER_DECISION, TaskConfig, Vec3, World, navigable,
};

/// Missed answers in a row after which an NPC stops repeating its last action.
const MISSES_UNTIL_NEUTRAL: u8 = 2;
/// Ticks whose durations are remembered.
const TIMED_TICKS: usize = 600;

/// How a world's time passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeMode {
    /// 60 ticks a second.
    Realtime,
    /// As fast as answers come.
    Lockstep,
}

impl TimeMode {
    /// The mode on the wire.
    pub fn to_wire(self) -> wire::TimeMode {
        match self {
            TimeMode::Realtime => wire::TimeMode::Realtime,
            TimeMode::Lockstep => wire::TimeMode::Lockstep,
        }
    }
}

/// What the server knows of an NPC beyond the world's own state.
#[derive(Debug)]
struct Record {
    slot: NpcSlot,
    goal: Option<Vec3>,
    waypoint: Option<Vec3>,
    last_outcome: Option<End>,
    attempts: u32,
    worker: Option<WorkerId>,
    /// Tick of the observation that has not been answered yet.
    awaiting: Option<u64>,
    misses: u8,
}

/// Counters since the world began.
#[derive(Debug, Clone, Default)]
pub struct Counters {
    /// Decisions asked for.
    pub asked: u64,
    /// Answered within their period.
    pub answered: u64,
    /// Not answered within it.
    pub missed: u64,
    /// Answers that nobody waited for any more.
    pub stale: u64,
    /// Ticks dropped to catch up.
    pub ticks_dropped: u64,
    /// Attempts by how they ended, in the order of [`End::ALL`].
    pub ends: [u64; End::ALL.len()],
}

/// A world with its NPCs and their decisions.
#[derive(Debug)]
pub struct HostedWorld {
    id: u64,
    world: World,
    mode: TimeMode,
    records: BTreeMap<u64, Record>,
    last_serial: u32,
    counters: Counters,
    tick_us: Vec<f32>,
    registry: Arc<Registry>,
    batches: BTreeMap<WorkerId, wire::ObservationBatch>,
    row: Vec<f32>,
    /// The tick that has been asked for but not stepped yet (lockstep).
    asked_tick: Option<u64>,
}

/// Something a client asked for that this world cannot do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NpcError {
    /// No such NPC.
    #[error("npc {0} does not exist")]
    Unknown(u64),
    /// The world is full.
    #[error("world {world} already has {limit} NPCs, the most it may have (--max-npcs)")]
    Full {
        /// Its id.
        world: u64,
        /// The limit.
        limit: usize,
    },
    /// The position lies outside the map.
    #[error("{field} lies outside the map, which spans 0 to {extent:?} m")]
    Outside {
        /// Path of the field.
        field: &'static str,
        /// Extent of the map.
        extent: [f32; 3],
    },
    /// The NPC fell, burnt or drowned.
    #[error("npc {0} is down: teleport it first")]
    Down(u64),
    /// The map has nowhere to stand.
    #[error(transparent)]
    NoGround(#[from] navigable::NoGround),
}

/// Bits of an NPC id below the world's id.
const SERIAL_BITS: u32 = 32;

/// The world that an NPC id belongs to.
pub fn world_of(npc_id: u64) -> u64 {
    npc_id >> SERIAL_BITS
}

impl HostedWorld {
    /// An empty world.
    pub fn new(id: u64, map: Arc<Map>, mode: TimeMode, registry: Arc<Registry>) -> Self {
        Self {
            id,
            world: World::new(map, CharacterProfile::default(), TaskConfig::default()),
            mode,
            records: BTreeMap::new(),
            last_serial: 0,
            counters: Counters::default(),
            tick_us: Vec::with_capacity(TIMED_TICKS),
            registry,
            batches: BTreeMap::new(),
            row: vec![0.0; OBSERVATION_LEN],
            asked_tick: None,
        }
    }

    /// How time passes.
    pub fn mode(&self) -> TimeMode {
        self.mode
    }

    /// Counters since the world began.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Durations of recent ticks, us, in no particular order.
    pub fn tick_us(&self) -> &[f32] {
        &self.tick_us
    }

    /// Ticks stepped.
    pub fn tick(&self) -> u64 {
        self.world.current_tick()
    }

    /// NPCs on it.
    pub fn npc_count(&self) -> usize {
        self.records.len()
    }

    /// Notes how long a tick took.
    pub fn note_duration(&mut self, microseconds: f32) {
        if self.tick_us.len() < TIMED_TICKS {
            self.tick_us.push(microseconds);
        } else {
            let at = self.tick() as usize % TIMED_TICKS;
            self.tick_us[at] = microseconds;
        }
    }

    /// Counts ticks that were skipped because the thread fell behind.
    pub fn note_dropped(&mut self, ticks: u64) {
        self.counters.ticks_dropped += ticks;
    }

    // --- what clients ask for ---

    /// Adds an NPC and returns its id.
    ///
    /// # Errors
    /// If the world is full or the position lies outside the map.
    pub fn spawn(&mut self, position: Vec3, yaw: f32, limit: usize) -> Result<u64, NpcError> {
        self.check_inside(position, "position")?;
        if self.records.len() >= limit {
            return Err(NpcError::Full { world: self.id, limit });
        }
        self.last_serial += 1;
        let id = self.id << SERIAL_BITS | u64::from(self.last_serial);
        let slot = self.world.spawn(position, yaw);
        let record = Record {
            slot,
            goal: None,
            waypoint: None,
            last_outcome: None,
            attempts: 0,
            worker: None,
            awaiting: None,
            misses: 0,
        };
        self.records.insert(id, record);
        self.assign_workers();
        Ok(id)
    }

    /// Removes an NPC.
    ///
    /// # Errors
    /// If it does not exist.
    pub fn despawn(&mut self, id: u64) -> Result<(), NpcError> {
        let record = self.records.remove(&id).ok_or(NpcError::Unknown(id))?;
        self.world.despawn(record.slot);
        if let Some(worker) = record.worker {
            self.registry.release(worker);
            self.send_release(worker, vec![id]);
        }
        Ok(())
    }

    /// Sends an NPC to a goal.
    ///
    /// # Errors
    /// If it does not exist or is down, or the goal lies outside the map.
    pub fn set_goal(&mut self, id: u64, goal: Vec3) -> Result<(), NpcError> {
        self.check_inside(goal, "goal")?;
        let record = self.records.get_mut(&id).ok_or(NpcError::Unknown(id))?;
        if self.world.npc(record.slot).is_some_and(|npc| npc.harm.is_some()) {
            return Err(NpcError::Down(id));
        }
        record.goal = Some(goal);
        record.waypoint = None;
        record.attempts += 1;
        record.awaiting = None;
        self.world.set_goal(record.slot, goal);
        Ok(())
    }

    /// Puts an NPC elsewhere, at rest.
    ///
    /// # Errors
    /// If it does not exist or the position lies outside the map.
    pub fn teleport(&mut self, id: u64, position: Vec3, yaw: f32) -> Result<(), NpcError> {
        self.check_inside(position, "position")?;
        let record = self.records.get_mut(&id).ok_or(NpcError::Unknown(id))?;
        record.goal = None;
        record.waypoint = None;
        record.awaiting = None;
        self.world.teleport(record.slot, position, yaw);
        Ok(())
    }

    /// State of one NPC.
    ///
    /// # Errors
    /// If it does not exist.
    pub fn npc(&self, id: u64) -> Result<wire::Npc, NpcError> {
        let record = self.records.get(&id).ok_or(NpcError::Unknown(id))?;
        Ok(self.describe(id, record))
    }

    /// State of all NPCs and of the world.
    pub fn snapshot(&self) -> wire::WatchWorldResponse {
        wire::WatchWorldResponse {
            tick: self.tick(),
            npcs: self.records.iter().map(|(&id, record)| self.describe(id, record)).collect(),
            stats: Some(self.stats()),
        }
    }

    /// Places where a character can stand.
    ///
    /// # Errors
    /// If the map has none.
    pub fn sample_ground(map: &Map, count: usize, seed: u64) -> Result<Vec<Vec3>, NpcError> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        Ok(navigable::sample_many(map, &CharacterProfile::default(), count, &mut rng)?)
    }

    fn check_inside(&self, point: Vec3, field: &'static str) -> Result<(), NpcError> {
        let extent = self.world.map().extent();
        if self.world.map().is_outside(point) || point.y > extent.y {
            return Err(NpcError::Outside { field, extent: extent.to_array() });
        }
        Ok(())
    }

    fn describe(&self, id: u64, record: &Record) -> wire::Npc {
        let npc = self.world.npc(record.slot).expect("every record has an NPC");
        let status = if npc.harm.is_some() {
            wire::NpcStatus::Down
        } else if record.goal.is_some() {
            wire::NpcStatus::Seeking
        } else {
            wire::NpcStatus::Idle
        };
        wire::Npc {
            npc_id: id,
            position: Some(convert::to_wire(npc.body.feet)),
            velocity: Some(convert::to_wire(npc.body.velocity)),
            yaw: npc.body.yaw,
            status: status.into(),
            goal: record.goal.map(convert::to_wire),
            waypoint: record.waypoint.map(convert::to_wire),
            last_outcome: convert::outcome(record.last_outcome).into(),
            attempts: record.attempts,
            worker_id: record.worker.map_or(0, |worker| worker.0),
        }
    }

    fn stats(&self) -> wire::WorldStats {
        let mut sorted = self.tick_us.clone();
        sorted.sort_unstable_by(f32::total_cmp);
        let quantile = |share: f64| {
            let last = sorted.len().checked_sub(1)?;
            Some(sorted[(last as f64 * share).round() as usize])
        };
        let [reached, fell, burnt, drowned, no_progress] = self.counters.ends;
        wire::WorldStats {
            tick_us_p50: quantile(0.5).unwrap_or(0.0),
            tick_us_p99: quantile(0.99).unwrap_or(0.0),
            ticks_dropped: self.counters.ticks_dropped,
            decisions_asked: self.counters.asked,
            decisions_answered: self.counters.answered,
            decisions_missed: self.counters.missed,
            reached,
            fell,
            burnt,
            drowned,
            no_progress,
        }
    }

    // --- workers ---

    /// Gives every NPC without a worker to one with room, and tells it.
    pub fn assign_workers(&mut self) {
        let mut given: BTreeMap<WorkerId, Vec<u64>> = BTreeMap::new();
        for (&id, record) in &mut self.records {
            if record.worker.is_none() {
                let Some(worker) = self.registry.assign() else { break };
                record.worker = Some(worker);
                record.awaiting = None;
                given.entry(worker).or_default().push(id);
            }
        }
        for (worker, npc_ids) in given {
            let assignment = wire::Assignment {
                world_id: self.id,
                map: self.world.map().spec().map(convert::map_spec_to_wire),
                npc_ids,
                mode: self.mode.to_wire().into(),
            };
            self.registry.send(worker, response(wire::work_response::Message::Assignment(assignment)));
        }
    }

    /// Hands the NPCs of a lost worker to others.
    pub fn lose_worker(&mut self, lost: WorkerId) {
        for record in self.records.values_mut().filter(|record| record.worker == Some(lost)) {
            record.worker = None;
            record.awaiting = None;
        }
        // An observation that a lost worker will never answer is asked again of the next one.
        self.asked_tick = None;
        self.assign_workers();
    }

    /// Gives all places back when the world ends.
    pub fn release_all(&mut self) {
        let ids: Vec<u64> = self.records.keys().copied().collect();
        for id in ids {
            let _ = self.despawn(id);
        }
    }

    fn send_release(&self, worker: WorkerId, npc_ids: Vec<u64>) {
        let release = wire::Release { world_id: self.id, npc_ids };
        self.registry.send(worker, response(wire::work_response::Message::Release(release)));
    }

    // --- the tick ---

    /// Whether a lockstep world can be stepped: every answer is in, and there is something to do.
    pub fn is_ready(&mut self) -> bool {
        if self.asked_tick != Some(self.tick()) {
            let mut seeking = self.records.values().filter(|record| record.goal.is_some()).peekable();
            if seeking.peek().is_none() || seeking.any(|record| record.worker.is_none()) {
                return false;
            }
            self.ask();
            self.asked_tick = Some(self.tick());
        }
        self.records.values().all(|record| record.awaiting.is_none())
    }

    /// One tick: ask, move, settle. Lockstep worlds have asked already in [`HostedWorld::is_ready`].
    pub fn step(&mut self) {
        if self.mode == TimeMode::Realtime {
            self.ask();
        }
        self.world.tick();
        self.settle();
    }

    /// Sends the observations of all NPCs whose decision is due to their workers.
    ///
    /// In realtime a tenth of the NPCs is due at each tick; in lockstep all of them are at every tenth.
    fn ask(&mut self) {
        let tick = self.tick();
        let period = u64::from(TICKS_PER_DECISION);
        for (&id, record) in &mut self.records {
            let phase = if self.mode == TimeMode::Realtime { u64::from(record.slot.0) } else { 0 };
            let (Some(goal), Some(worker)) = (record.goal, record.worker) else { continue };
            if !(tick + phase).is_multiple_of(period) {
                continue;
            }
            if record.awaiting.take().is_some() {
                self.counters.missed += 1;
                record.misses = record.misses.saturating_add(1);
                if record.misses >= MISSES_UNTIL_NEUTRAL {
                    self.world.decide(record.slot, Action::default());
                }
            }
            self.world.close_decision(record.slot);
            self.world.observe(record.slot, &mut self.row);
            let npc = self.world.npc(record.slot).expect("every record has an NPC");
            let batch = self.batches.entry(worker).or_default();
            batch.npc_ids.push(id);
            extend_packed(&mut batch.observations, &self.row);
            extend_packed(&mut batch.positions, &npc.body.feet.to_array());
            extend_packed(&mut batch.goals, &goal.to_array());
            batch.attempts.push(record.attempts);
            let touched = npc.episode.and_then(|episode| episode.end) == Some(End::Reached);
            batch.waypoint_reached.push(touched);
            batch.grounded.push(npc.body.is_grounded());
            record.awaiting = Some(tick);
            self.counters.asked += 1;
        }
        for (worker, mut batch) in std::mem::take(&mut self.batches) {
            (batch.world_id, batch.tick) = (self.id, tick);
            // A full queue loses the batch: its NPCs count as missed at their next decision.
            self.registry.send(worker, response(wire::work_response::Message::Observations(batch)));
        }
    }

    /// Takes a worker's answers. Answers that nobody waits for any more are counted and ignored.
    pub fn answer(&mut self, worker: WorkerId, answer: &Answer) {
        for (&id, &action) in answer.npc_ids.iter().zip(&answer.actions) {
            let Some(record) = self.records.get_mut(&id) else {
                self.counters.stale += 1;
                continue;
            };
            if record.worker != Some(worker) || record.awaiting != Some(answer.tick) {
                self.counters.stale += 1;
                continue;
            }
            record.awaiting = None;
            record.misses = 0;
            self.counters.answered += 1;
            self.world.decide(record.slot, action);
        }
        for &(id, position) in &answer.waypoints {
            if let Some(record) = self.records.get_mut(&id)
                && record.worker == Some(worker)
                && record.goal.is_some()
            {
                record.waypoint = Some(position);
                self.world.set_goal(record.slot, position);
            }
        }
        for &id in &answer.gave_up {
            if self.records.get(&id).is_some_and(|record| record.worker == Some(worker) && record.goal.is_some()) {
                self.end_attempt(id, End::NoProgress);
            }
        }
    }

    /// Ends the attempts that this tick decided.
    fn settle(&mut self) {
        let goal_radius = self.world.task().goal_radius;
        let mut ended = Vec::new();
        for (&id, record) in &self.records {
            let Some(goal) = record.goal else { continue };
            let npc = self.world.npc(record.slot).expect("every record has an NPC");
            let stuck = npc.episode.and_then(|episode| episode.end).filter(|end| *end == End::NoProgress);
            let reached = (npc.body.feet.distance(goal) <= goal_radius).then_some(End::Reached);
            if let Some(end) = reached.or(npc.harm).or(stuck) {
                ended.push((id, end));
            }
        }
        for (id, end) in ended {
            self.end_attempt(id, end);
        }
    }

    fn end_attempt(&mut self, id: u64, end: End) {
        let record = self.records.get_mut(&id).expect("an attempt has a record");
        record.goal = None;
        record.waypoint = None;
        record.awaiting = None;
        record.last_outcome = Some(end);
        self.world.clear_goal(record.slot);
        if let Some(worker) = record.worker {
            let ended = wire::AttemptsEnded {
                world_id: self.id,
                npc_ids: vec![id],
                attempts: vec![record.attempts],
                outcomes: vec![convert::outcome(Some(end)).into()],
            };
            self.registry.send(worker, response(wire::work_response::Message::Ended(ended)));
        }
        let at = End::ALL.iter().position(|other| *other == end).expect("all ends are listed");
        self.counters.ends[at] += 1;
    }
}

/// A worker's answer, checked.
#[derive(Debug, Clone, Default)]
pub struct Answer {
    /// Tick of the observations.
    pub tick: u64,
    /// Whose actions follow.
    pub npc_ids: Vec<u64>,
    /// One action for each.
    pub actions: Vec<Action>,
    /// New waypoints.
    pub waypoints: Vec<(u64, Vec3)>,
    /// Attempts to be given up.
    pub gave_up: Vec<u64>,
}

fn response(message: wire::work_response::Message) -> wire::WorkResponse {
    wire::WorkResponse { message: Some(message) }
}

fn extend_packed(bytes: &mut Vec<u8>, values: &[f32]) {
    for value in values {
        bytes.extend(value.to_le_bytes());
    }
}
