//! A hosted world: the world itself, and the server's data about its NPCs.

use super::events::{EventKind, EventLog};
use super::gathering::{Gatherings, Reserved};
use super::itinerary::Itinerary;
use super::motion::Motion;
use super::outbox::Outbox;
use super::pursuit::{Group, NoWay, Pursuit, Retry, Target};
use super::snapshot::{Counters, EndedAttempt, NpcPlan, Standing};
use super::standing::{Shortage, Stand};
use crate::ids::WorkerId;
use crate::ids::{NpcId, WorldId};
use crate::messages::{ObservationBatch, TimeMode};
use crate::quota::Ticket;
use crate::registry::Registry;
use crate::times::TickTimes;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use surefoot_planner::{Tags, Zone};
use surefoot_world::{
    CharacterProfile, End, Gait, Map, Npc, NpcSlot, Seconds, TICKS_PER_SECOND, TaskConfig, Tick, Trajectory, Vec3,
    World, WorldConfig,
};

/// The server's data about an NPC, in addition to the world's state.
#[derive(Debug)]
pub(super) struct NpcRecord {
    pub slot: NpcSlot,
    /// Where the goal of the attempt under way is now, m.
    pub goal: Option<Vec3>,
    pub pursuit: Pursuit,
    /// The NPC's place at a goal that others share; kept while it stands there.
    pub reserved: Option<Reserved>,
    /// Whether an NPC that keeps to its target is there.
    pub is_at_target: bool,
    /// Why there is no way to the target to which the NPC keeps, if clients have heard of it.
    pub no_way: Option<NoWay>,
    /// Whether the NPC leads a group and waits for its followers.
    pub awaits_group: bool,
    /// The attempt that follows one that failed, of an NPC that keeps to its target.
    pub retry: Option<Retry>,
    /// Its route.
    pub itinerary: Option<Itinerary>,
    /// What it looks at while it rests.
    pub looks_at: Option<Target>,
    /// Heading to which the body turns at rest, rad.
    pub turns_to: Option<f32>,
    pub waypoint: Option<Vec3>,
    pub last_outcome: Option<End>,
    /// Attempts that began.
    pub attempts: u32,
    /// Attempts that ended with an outcome.
    pub attempts_ended: u32,
    pub motion: Motion,
    pub stand: Stand,
    pub worker: Option<WorkerId>,
    /// The worker that the NPC is handed over to at its next decision.
    pub next_worker: Option<WorkerId>,
    /// Tick of the observation that has not been answered yet.
    pub awaiting: Option<Tick>,
    /// The worker that observes the NPC itself.
    pub observer: Option<WorkerId>,
    pub misses: u8,
    /// The plan of the NPC, as its worker reported it.
    pub plan: Option<Arc<NpcPlan>>,
    /// What its worker predicted last, and the tick of the observation.
    pub prediction: Option<(Tick, Trajectory)>,
    /// The last attempts that ended, the latest last.
    pub history: VecDeque<EndedAttempt>,
    /// Tick at which the current attempt began.
    pub began: Tick,
    /// The NPC's place in its client's quota.
    pub ticket: Ticket,
    /// Its tags, for zones that ask for them.
    pub tags: Tags,
    /// How it goes where it can walk.
    pub gait: Gait,
}

/// Misses in a row after which an NPC takes the neutral action instead of repeating its last one.
pub(super) const MISSES_UNTIL_NEUTRAL: u8 = 2;
/// Most attempts in an NPC's history; the oldest is dropped first.
const MAX_HISTORY: usize = 32;

impl NpcRecord {
    pub fn new(slot: NpcSlot, ticket: Ticket) -> Self {
        Self {
            slot,
            goal: None,
            pursuit: Pursuit::default(),
            reserved: None,
            is_at_target: false,
            no_way: None,
            awaits_group: false,
            retry: None,
            itinerary: None,
            looks_at: None,
            turns_to: None,
            waypoint: None,
            last_outcome: None,
            attempts: 0,
            attempts_ended: 0,
            motion: Motion::default(),
            stand: Stand::default(),
            worker: None,
            next_worker: None,
            awaiting: None,
            observer: None,
            misses: 0,
            plan: None,
            prediction: None,
            history: VecDeque::new(),
            began: Tick(0),
            ticket,
            tags: Tags::new(),
            gait: Gait::default(),
        }
    }

    /// Records how the attempt under way ended at `tick`, with the feet so far from the goal, m, and why the goal is
    /// unreachable.
    pub fn note_end(&mut self, end: End, tick: Tick, distance_m: f32, no_path: Arc<str>) {
        if self.history.len() == MAX_HISTORY {
            self.history.pop_front();
        }
        self.history.push_back(EndedAttempt {
            attempt: self.attempts,
            end,
            goal: self.goal,
            distance_m,
            seconds: self.lasted(tick),
            no_path,
        });
        self.last_outcome = Some(end);
        self.attempts_ended += 1;
    }

    /// Duration of the attempt from its start to `tick`.
    pub fn lasted(&self, tick: Tick) -> Seconds {
        Seconds(tick.since(self.began) as f32 / TICKS_PER_SECOND as f32)
    }

    /// Why `npc` stands at `tick`; `None` if it moves, is idle or down.
    pub fn standing(&self, npc: &Npc, tick: Tick) -> Option<Standing> {
        if npc.harm.is_some() {
            None
        } else if self.goal.is_none() {
            self.rest()
        } else if self.is_at_target {
            Some(if self.pursuit.is_of_route { Standing::Holds } else { Standing::AtTarget })
        } else if self.awaits_group {
            Some(Standing::AwaitsGroup)
        } else if self.worker.is_none() {
            Some(Standing::NoWorker)
        } else if self.misses >= MISSES_UNTIL_NEUTRAL {
            Some(Standing::SilentWorker)
        } else {
            self.stand.reported.or(self.stand.is_long(tick).then_some(Standing::Blocked))
        }
    }

    /// Follows where `npc` stands, and returns the event about it, if one is due.
    pub fn note_standing(&mut self, npc: &Npc, tick: Tick) -> Option<EventKind> {
        if self.goal.is_none() || self.is_at_target {
            self.stand = Stand::default();
            return None;
        }
        self.stand.follow(npc.body.feet, tick);
        let reason = self.standing(npc, tick)?;
        self.stand.event(reason, tick)
    }

    /// Why the goal of an attempt that ends with `end` is unreachable, for people; empty for other ends.
    pub fn why_unreachable(&self, end: End) -> Arc<str> {
        let reason = self.plan.as_ref().map_or("", |plan| &plan.no_path);
        match end {
            End::Unreachable if reason.is_empty() => "all ways that were tried have failed".into(),
            End::Unreachable => reason.into(),
            _ => Arc::default(),
        }
    }

    /// Whether the latest plan found no path to where the NPC heads.
    pub fn has_no_path(&self) -> bool {
        self.plan.as_ref().is_some_and(|plan| !plan.no_path.is_empty())
    }

    /// Clears the goal with the waypoint, the plan and the pending decision; the route stays.
    pub fn clear_goal(&mut self) {
        self.goal = None;
        self.pursuit.facing = None;
        self.reserved = None;
        self.is_at_target = false;
        self.awaits_group = false;
        self.retry = None;
        self.turns_to = None;
        self.waypoint = None;
        self.awaiting = None;
        self.plan = None;
        self.prediction = None;
    }
}

/// A world with its NPCs and their decisions.
#[derive(Debug)]
pub struct HostedWorld {
    pub(super) id: WorldId,
    pub(super) world: World,
    pub(super) mode: TimeMode,
    pub(super) records: BTreeMap<NpcId, NpcRecord>,
    /// All NPCs without a worker. It may also contain NPCs that have one or were removed, until workers are assigned.
    pub(super) unassigned: BTreeSet<NpcId>,
    pub(super) last_serial: u32,
    pub(super) counters: Counters,
    pub(super) events: EventLog,
    pub(super) times: TickTimes,
    pub(super) registry: Arc<Registry>,
    pub(super) outbox: BTreeMap<WorkerId, Outbox>,
    /// Observations by worker and body.
    pub(super) batches: BTreeMap<(WorkerId, u8), ObservationBatch>,
    /// The tick whose decisions were requested and that has not been stepped yet (lockstep).
    pub(super) requested_tick: Option<Tick>,
    /// Workers with unanswered observations: the tick of the first one since their last answer in time.
    pub(super) unanswered_since: BTreeMap<WorkerId, Tick>,
    /// Workers that were notified of this world, and must be notified of its end.
    pub(super) notified: BTreeSet<WorkerId>,
    /// Time for which the step has waited for answers (lockstep).
    pub(super) waited: Duration,
    pub(super) map_revision: u64,
    pub(super) gatherings: Gatherings,
    /// Groups under way, by their leaders.
    pub(super) groups: BTreeMap<NpcId, Group>,
    pub(super) shortage: Shortage,
    /// By name.
    pub(super) zones: BTreeMap<String, Zone>,
}

impl HostedWorld {
    /// Creates a world without NPCs. Its default body is the default profile.
    pub fn new(id: WorldId, map: Arc<Map>, mode: TimeMode, registry: Arc<Registry>) -> Self {
        Self {
            id,
            world: World::new(map, CharacterProfile::default(), TaskConfig::default()),
            mode,
            records: BTreeMap::new(),
            unassigned: BTreeSet::new(),
            last_serial: 0,
            counters: Counters::default(),
            events: EventLog::default(),
            times: TickTimes::default(),
            registry,
            outbox: BTreeMap::new(),
            batches: BTreeMap::new(),
            requested_tick: None,
            unanswered_since: BTreeMap::new(),
            notified: BTreeSet::new(),
            waited: Duration::ZERO,
            map_revision: 0,
            gatherings: Gatherings::default(),
            groups: BTreeMap::new(),
            shortage: Shortage::default(),
            zones: BTreeMap::new(),
        }
    }

    /// Sets the bodies of the world's NPCs, at least one; the first is the default. For a world without NPCs.
    #[must_use]
    pub fn with_bodies(self, profiles: Vec<CharacterProfile>) -> Self {
        let config = WorldConfig { profiles, ..self.world.config().clone() };
        self.with_config(config)
    }

    /// Sets whether NPCs collide with each other. For a world without NPCs.
    #[must_use]
    pub fn with_solid_npcs(self, npc_collision: bool) -> Self {
        let config = WorldConfig { npc_collision, ..self.world.config().clone() };
        self.with_config(config)
    }

    fn with_config(mut self, config: WorldConfig) -> Self {
        self.world = World::with_config(self.world.map().clone(), config);
        self
    }

    /// Whether NPCs collide with each other.
    pub fn has_solid_npcs(&self) -> bool {
        self.world.config().npc_collision
    }

    /// Bodies that NPCs of the world have or had, the default one first.
    pub fn bodies(&self) -> &[CharacterProfile] {
        &self.world.config().profiles
    }

    /// Returns the world's id on the server.
    pub fn id(&self) -> WorldId {
        self.id
    }

    /// The map, with its pieces.
    pub fn map(&self) -> &Arc<Map> {
        self.world.map()
    }

    /// How the world's time passes.
    pub fn mode(&self) -> TimeMode {
        self.mode
    }

    /// Counters since the world began.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// The latest events.
    pub fn events(&self) -> &EventLog {
        &self.events
    }

    /// Adds an NPC without a worker.
    pub(super) fn add_record(&mut self, id: NpcId, record: NpcRecord) {
        self.records.insert(id, record);
        self.unassigned.insert(id);
    }

    pub(super) fn log_event(&mut self, npc: NpcId, kind: EventKind) {
        self.events.push(self.tick(), SystemTime::now(), npc, kind);
    }

    /// Times from when ticks were due until they were done.
    pub fn times(&self) -> &TickTimes {
        &self.times
    }

    /// Number of ticks stepped.
    pub fn tick(&self) -> Tick {
        self.world.current_tick()
    }

    /// Number of NPCs.
    pub fn npc_count(&self) -> usize {
        self.records.len()
    }

    /// Counts a tick that ended `took` after it was due; `is_late` is whether the next tick was due by then.
    pub fn note_tick(&mut self, took: Duration, is_late: bool) {
        self.times.note(took);
        self.counters.ticks_late += u64::from(is_late);
    }

    /// Counts ticks that were dropped because the thread fell behind.
    pub fn note_dropped(&mut self, ticks: u64) {
        self.counters.ticks_dropped += ticks;
    }
}
