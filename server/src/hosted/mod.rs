//! One world on the server: its NPCs, whose decision is due, who answers, how attempts end.
//!
//! A tick is [`HostedWorld::step`]: ask the workers, move, settle. Answers arrive between ticks. Here is what clients
//! ask for; `decisions` is the tick and the traffic with workers, `saved` what outlives the process.

mod decisions;
mod saved;

pub use decisions::Answer;
pub use saved::{SavedError, SavedMap, SavedWorld};

use crate::quota::Ticket;
use crate::registry::{Registry, WorkerId};
use crate::times::TickTimes;
use decisions::Outbox;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;
use surefoot_proto::convert;
use surefoot_proto::world::v1 as wire;
use surefoot_world::sense::Sight;
use surefoot_world::{
    CharacterProfile, End, Map, NpcSlot, OBSERVATION_LEN, TICKS_PER_SECOND, TaskConfig, Vec3, World, navigable,
};

/// How a world's time passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
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
    /// The worker that takes it over at its next decision.
    next_worker: Option<WorkerId>,
    /// Tick of the observation that has not been answered yet.
    awaiting: Option<u64>,
    misses: u8,
    /// The plan it follows, as its worker told.
    plan: Option<Arc<wire::NpcPlan>>,
    /// Its last attempts that ended, the latest last.
    history: VecDeque<wire::EndedAttempt>,
    /// Tick at which its attempt began.
    began: u64,
    /// Its place in its client's quota.
    ticket: Ticket,
}

/// Attempts of an NPC that are remembered; the oldest is forgotten first.
const MAX_HISTORY: usize = 32;

impl Record {
    fn new(slot: NpcSlot, ticket: Ticket) -> Self {
        Self {
            slot,
            goal: None,
            waypoint: None,
            last_outcome: None,
            attempts: 0,
            worker: None,
            next_worker: None,
            awaiting: None,
            misses: 0,
            plan: None,
            history: VecDeque::new(),
            began: 0,
            ticket,
        }
    }

    /// Remembers how the attempt that is going on ended at `tick`.
    fn note_end(&mut self, end: End, tick: u64) {
        if self.history.len() == MAX_HISTORY {
            self.history.pop_front();
        }
        self.history.push_back(wire::EndedAttempt {
            attempt: self.attempts,
            outcome: convert::outcome(Some(end)).into(),
            goal: self.goal.map(convert::to_wire),
            seconds: tick.saturating_sub(self.began) as f32 / TICKS_PER_SECOND as f32,
        });
        self.last_outcome = Some(end);
    }

    /// Forgets where it was going.
    fn clear_goal(&mut self) {
        self.goal = None;
        self.waypoint = None;
        self.awaiting = None;
        self.plan = None;
    }
}

/// Counters since the world began.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Decisions asked for.
    pub asked: u64,
    /// Answered within their period.
    pub answered: u64,
    /// Not answered within it.
    pub missed: u64,
    /// Answers that nobody waited for any more.
    pub stale: u64,
    /// Ticks left out because the world was too far behind.
    pub ticks_dropped: u64,
    /// Ticks that were done later than a period after they were due.
    pub ticks_late: u64,
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
    times: TickTimes,
    registry: Arc<Registry>,
    outbox: BTreeMap<WorkerId, Outbox>,
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
            times: TickTimes::default(),
            registry,
            outbox: BTreeMap::new(),
            batches: BTreeMap::new(),
            row: vec![0.0; OBSERVATION_LEN],
            asked_tick: None,
        }
    }

    /// Its id on the server.
    pub fn id(&self) -> u64 {
        self.id
    }

    /// How time passes.
    pub fn mode(&self) -> TimeMode {
        self.mode
    }

    /// Counters since the world began.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// From when ticks were due until they were done.
    pub fn times(&self) -> &TickTimes {
        &self.times
    }

    /// Ticks stepped.
    pub fn tick(&self) -> u64 {
        self.world.current_tick()
    }

    /// NPCs on it.
    pub fn npc_count(&self) -> usize {
        self.records.len()
    }

    /// Notes how long after it was due a tick was done, and whether the next was due by then.
    pub fn note_tick(&mut self, took: Duration, is_late: bool) {
        self.times.note(took);
        self.counters.ticks_late += u64::from(is_late);
    }

    /// Counts ticks that were skipped because the thread fell behind.
    pub fn note_dropped(&mut self, ticks: u64) {
        self.counters.ticks_dropped += ticks;
    }

    // --- what clients ask for ---

    /// Adds an NPC for the client that holds `ticket` and returns its id.
    ///
    /// # Errors
    /// If the world is full or the position lies outside the map.
    pub fn spawn(&mut self, position: Vec3, yaw: f32, limit: usize, ticket: Ticket) -> Result<u64, NpcError> {
        self.check_inside(position, "position")?;
        if self.records.len() >= limit {
            return Err(NpcError::Full { world: self.id, limit });
        }
        self.last_serial += 1;
        let id = self.id << SERIAL_BITS | u64::from(self.last_serial);
        let slot = self.world.spawn(position, yaw);
        self.records.insert(id, Record::new(slot, ticket));
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
            self.outbox.entry(worker).or_default().released.push(id);
        }
        // A place is taken with the worker that it was to go to, no longer with the one that has it.
        if let Some(holder) = record.next_worker.or(record.worker) {
            self.registry.release(holder);
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
        record.clear_goal();
        record.goal = Some(goal);
        record.attempts += 1;
        record.began = self.world.current_tick();
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
        record.clear_goal();
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

    /// The plan that an NPC follows.
    ///
    /// # Errors
    /// If it does not exist.
    pub fn plan(&self, id: u64) -> Result<Option<Arc<wire::NpcPlan>>, NpcError> {
        Ok(self.records.get(&id).ok_or(NpcError::Unknown(id))?.plan.clone())
    }

    /// An NPC's last attempts that ended, the latest last.
    ///
    /// # Errors
    /// If it does not exist.
    pub fn history(&self, id: u64) -> Result<Vec<wire::EndedAttempt>, NpcError> {
        Ok(self.records.get(&id).ok_or(NpcError::Unknown(id))?.history.iter().copied().collect())
    }

    /// What an NPC sees.
    ///
    /// # Errors
    /// If it does not exist.
    pub fn sight(&self, id: u64) -> Result<Sight, NpcError> {
        Ok(self.world.sight(self.records.get(&id).ok_or(NpcError::Unknown(id))?.slot))
    }

    /// State of all NPCs and of the world.
    pub fn snapshot(&self) -> wire::WatchWorldResponse {
        wire::WatchWorldResponse {
            tick: self.tick(),
            npcs: self.records.iter().map(|(&id, record)| self.describe(id, record)).collect(),
            stats: Some(self.stats()),
            is_delta: false,
            gone_npc_ids: Vec::new(),
        }
    }

    /// How many NPCs are idle, seeking and down, and how many have no worker.
    pub fn tally(&self) -> Tally {
        let mut tally = Tally::default();
        for record in self.records.values() {
            match self.status(record) {
                wire::NpcStatus::Down => tally.down += 1,
                wire::NpcStatus::Seeking => tally.seeking += 1,
                wire::NpcStatus::Idle | wire::NpcStatus::Unspecified => tally.idle += 1,
            }
            tally.without_worker += u32::from(record.worker.is_none());
        }
        tally
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

    fn status(&self, record: &Record) -> wire::NpcStatus {
        if self.world.npc(record.slot).is_some_and(|npc| npc.harm.is_some()) {
            wire::NpcStatus::Down
        } else if record.goal.is_some() {
            wire::NpcStatus::Seeking
        } else {
            wire::NpcStatus::Idle
        }
    }

    fn describe(&self, id: u64, record: &Record) -> wire::Npc {
        let npc = self.world.npc(record.slot).expect("every record has an NPC");
        wire::Npc {
            npc_id: id,
            position: Some(convert::to_wire(npc.body.feet)),
            velocity: Some(convert::to_wire(npc.body.velocity)),
            yaw: npc.body.yaw,
            status: self.status(record).into(),
            goal: record.goal.map(convert::to_wire),
            waypoint: record.waypoint.map(convert::to_wire),
            last_outcome: convert::outcome(record.last_outcome).into(),
            attempts: record.attempts,
            worker_id: record.worker.map_or(0, |worker| worker.0),
        }
    }

    fn stats(&self) -> wire::WorldStats {
        let [reached, fell, burnt, drowned, no_progress] = self.counters.ends;
        wire::WorldStats {
            tick_us_p50: self.times.quantile_us(0.5),
            tick_us_p99: self.times.quantile_us(0.99),
            ticks_dropped: self.counters.ticks_dropped,
            decisions_asked: self.counters.asked,
            decisions_answered: self.counters.answered,
            decisions_missed: self.counters.missed,
            reached,
            fell,
            burnt,
            drowned,
            no_progress,
            ticks_late: self.counters.ticks_late,
            tick_histogram: self.times.counts().to_vec(),
            answers_stale: self.counters.stale,
            npcs_without_worker: self.tally().without_worker,
        }
    }
}

/// NPCs of a world by what they do.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    /// Without a goal.
    pub idle: u32,
    /// On their way.
    pub seeking: u32,
    /// Fell, burnt or drowned.
    pub down: u32,
    /// Whatever they do: not carried by a worker.
    pub without_worker: u32,
}
