//! A hosted world: the world itself, and what the server knows of its NPCs beyond the world's own state.

use super::events::{EventKind, EventLog};
use super::mode::TimeMode;
use super::motion::Motion;
use super::outbox::Outbox;
use super::snapshot::{Counters, EndedAttempt, NpcPlan};
use crate::ids::WorkerId;
use crate::ids::{NpcId, WorldId};
use crate::messages::ObservationBatch;
use crate::quota::Ticket;
use crate::registry::Registry;
use crate::times::TickTimes;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use surefoot_world::{
    CharacterProfile, End, Map, NpcSlot, OBSERVATION_LEN, Seconds, TICKS_PER_SECOND, TaskConfig, Tick, Vec3, World,
};

/// What the server knows of an NPC beyond the world's own state.
#[derive(Debug)]
pub(super) struct Record {
    pub slot: NpcSlot,
    pub goal: Option<Vec3>,
    pub waypoint: Option<Vec3>,
    pub last_outcome: Option<End>,
    /// Attempts that began.
    pub attempts: u32,
    /// Attempts that ended with an outcome.
    pub attempts_ended: u32,
    pub motion: Motion,
    pub worker: Option<WorkerId>,
    /// The worker that takes it over at its next decision.
    pub next_worker: Option<WorkerId>,
    /// Tick of the observation that has not been answered yet.
    pub awaiting: Option<Tick>,
    pub misses: u8,
    /// The plan it follows, as its worker told.
    pub plan: Option<Arc<NpcPlan>>,
    /// Its last attempts that ended, the latest last.
    pub history: VecDeque<EndedAttempt>,
    /// Tick at which its attempt began.
    pub began: Tick,
    /// Its place in its client's quota.
    pub ticket: Ticket,
}

/// Attempts of an NPC that are remembered; the oldest is forgotten first.
const MAX_HISTORY: usize = 32;

impl Record {
    pub fn new(slot: NpcSlot, ticket: Ticket) -> Self {
        Self {
            slot,
            goal: None,
            waypoint: None,
            last_outcome: None,
            attempts: 0,
            attempts_ended: 0,
            motion: Motion::default(),
            worker: None,
            next_worker: None,
            awaiting: None,
            misses: 0,
            plan: None,
            history: VecDeque::new(),
            began: Tick(0),
            ticket,
        }
    }

    /// Remembers how the attempt that is going on ended at `tick`.
    pub fn note_end(&mut self, end: End, tick: Tick) {
        if self.history.len() == MAX_HISTORY {
            self.history.pop_front();
        }
        self.history.push_back(EndedAttempt {
            attempt: self.attempts,
            end,
            goal: self.goal,
            seconds: self.lasted(tick),
        });
        self.last_outcome = Some(end);
        self.attempts_ended += 1;
    }

    /// How long its attempt has taken.
    pub fn lasted(&self, tick: Tick) -> Seconds {
        Seconds(tick.since(self.began) as f32 / TICKS_PER_SECOND as f32)
    }

    /// Forgets where it was going.
    pub fn clear_goal(&mut self) {
        self.goal = None;
        self.waypoint = None;
        self.awaiting = None;
        self.plan = None;
    }
}

/// A world with its NPCs and their decisions.
#[derive(Debug)]
pub struct HostedWorld {
    pub(super) id: WorldId,
    pub(super) world: World,
    pub(super) mode: TimeMode,
    pub(super) records: BTreeMap<NpcId, Record>,
    pub(super) last_serial: u32,
    pub(super) counters: Counters,
    pub(super) events: EventLog,
    pub(super) times: TickTimes,
    pub(super) registry: Arc<Registry>,
    pub(super) outbox: BTreeMap<WorkerId, Outbox>,
    pub(super) batches: BTreeMap<WorkerId, ObservationBatch>,
    pub(super) row: Vec<f32>,
    /// The tick that has been asked for but not stepped yet (lockstep).
    pub(super) asked_tick: Option<Tick>,
    /// For workers that owe answers: the tick of the first observation since their last answer in time.
    pub(super) unanswered_since: BTreeMap<WorkerId, Tick>,
    /// Workers that know of this world, and must learn of its end.
    pub(super) notified: BTreeSet<WorkerId>,
    /// Time for which the step has waited for answers (lockstep).
    pub(super) waited: Duration,
}

impl HostedWorld {
    /// An empty world.
    pub fn new(id: WorldId, map: Arc<Map>, mode: TimeMode, registry: Arc<Registry>) -> Self {
        Self {
            id,
            world: World::new(map, CharacterProfile::default(), TaskConfig::default()),
            mode,
            records: BTreeMap::new(),
            last_serial: 0,
            counters: Counters::default(),
            events: EventLog::default(),
            times: TickTimes::default(),
            registry,
            outbox: BTreeMap::new(),
            batches: BTreeMap::new(),
            row: vec![0.0; OBSERVATION_LEN],
            asked_tick: None,
            unanswered_since: BTreeMap::new(),
            notified: BTreeSet::new(),
            waited: Duration::ZERO,
        }
    }

    /// Its id on the server.
    pub fn id(&self) -> WorldId {
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

    /// What happened lately.
    pub fn events(&self) -> &EventLog {
        &self.events
    }

    pub(super) fn tell(&mut self, npc: NpcId, kind: EventKind) {
        self.events.push(self.tick(), SystemTime::now(), npc, kind);
    }

    /// From when ticks were due until they were done.
    pub fn times(&self) -> &TickTimes {
        &self.times
    }

    /// Ticks stepped.
    pub fn tick(&self) -> Tick {
        Tick(self.world.current_tick())
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
}
