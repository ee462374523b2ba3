//! The journal of a world in a fleet: NPCs that were added or removed, routes that were set, and attempts that began or
//! ended, since the last save. The server that takes the world over applies it to the save, so that no attempt is lost
//! or ends twice.
//!
//! Events that only describe motion and stands are left out, and are lost with the server.

use super::commands::MAX_BODIES;
use super::events::{EventKind, EventLog, NpcEvent};
use super::itinerary::{Itinerary, Route, RouteKind};
use super::pursuit::{Pursuit, Target};
use super::saved::{SavedError, WorldSave};
use super::world::{HostedWorld, NpcRecord};
use crate::ids::NpcId;
use crate::quota::Quota;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use std::time::SystemTime;
use surefoot_planner::Tags;
use surefoot_world::sealed::{self, SealError};
use surefoot_world::{CharacterProfile, End, Gait, Seconds, Tick, Vec3};

const MAGIC: &[u8; 8] = b"SFKEPT\n\0";
/// Changed whenever [`FleetSave`] or anything inside it is.
const VERSION: u32 = 7;
/// Most events that are saved with a world, so that readers can resume on the server that takes it over.
const SAVED_EVENTS: usize = 4096;

/// The save of a world in a fleet, with its latest events.
#[derive(Debug, Clone, PartialEq)]
pub struct FleetSave {
    /// Fencing token of the server that saved it.
    pub token: i64,
    /// The world.
    pub world: WorldSave,
    /// Its events.
    pub log: SavedLog,
}

/// The latest events of a saved world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SavedLog {
    written: u64,
    dropped: u64,
    entries: Vec<Entry>,
}

/// Changes of a world, up to an event.
#[derive(Debug, Clone, PartialEq)]
pub struct Journal {
    /// Sequence number of that event.
    pub through: u64,
    entries: Vec<Entry>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Entry {
    sequence: u64,
    tick: Tick,
    time: SystemTime,
    npc: NpcId,
    change: Change,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
enum Change {
    Spawned {
        position: Vec3,
        newcomer: Option<Newcomer>,
    },
    Began {
        attempt: u32,
        goal: Vec3,
        pursuit: Pursuit,
    },
    Ended {
        attempt: u32,
        end: Option<End>,
        goal: Option<Vec3>,
        distance_m: f32,
        seconds: Seconds,
    },
    /// The route is absent if it was cleared, or if the save contains it.
    Routed {
        kind: Option<RouteKind>,
        route: Option<Route>,
    },
    Teleported {
        position: Vec3,
        yaw: f32,
    },
    Removed,
}

/// Data for adding an NPC again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Newcomer {
    yaw: f32,
    body: CharacterProfile,
    owner: String,
    tags: Tags,
    gait: Gait,
    looks_at: Option<Target>,
}

impl FleetSave {
    /// Encodes the world as the content of a blob.
    pub fn encode(&self) -> Vec<u8> {
        let content = postcard::to_stdvec(&(self.token, &self.world, &self.log)).expect("plain data");
        sealed::seal(MAGIC, VERSION, &content)
    }

    /// Decodes what [`encode`](Self::encode) returned.
    pub fn decode(bytes: &[u8], place: &Path) -> Result<Self, SavedError> {
        let damaged = |_| SavedError::Damaged(place.to_owned());
        let content = sealed::open(MAGIC, VERSION, bytes).map_err(|error| SavedError::sealed(error, place, VERSION))?;
        let (token, world, log): (i64, WorldSave, SavedLog) = postcard::from_bytes(content).map_err(damaged)?;
        let is_ascending = log.entries.is_sorted_by(|a, b| a.sequence < b.sequence);
        let ends = log.entries.last().map_or(0, |entry| entry.sequence);
        if !world.is_consistent() || !is_ascending || ends > log.written || log.dropped > log.written {
            return Err(SavedError::Damaged(place.to_owned()));
        }
        Ok(Self { token, world, log })
    }
}

impl SavedLog {
    /// Sequence number of the latest event when the world was saved.
    pub fn written(&self) -> u64 {
        self.written
    }
}

impl Journal {
    /// Encodes the journal.
    pub fn encode(&self) -> Vec<u8> {
        postcard::to_stdvec(&self.entries).expect("plain data")
    }

    /// Decodes what [`encode`](Self::encode) returned.
    pub fn decode(through: u64, bytes: &[u8]) -> Result<Self, SealError> {
        let entries: Vec<Entry> = postcard::from_bytes(bytes).map_err(|_| SealError::Damaged)?;
        let is_sound = entries.is_sorted_by(|a, b| a.sequence < b.sequence)
            && entries.last().is_none_or(|entry| entry.sequence <= through);
        if is_sound { Ok(Self { through, entries }) } else { Err(SealError::Damaged) }
    }
}

impl Entry {
    /// The entry of an event; `None` if it only describes motion or a stand.
    fn of(event: &NpcEvent, change_of: impl FnOnce(EventKind) -> Option<Change>) -> Option<Self> {
        let &NpcEvent { sequence, tick, time, npc, ref kind } = event;
        Some(Self { sequence, tick, time, npc, change: change_of(kind.clone())? })
    }

    fn to_event(&self) -> NpcEvent {
        let kind = match self.change {
            Change::Spawned { position, .. } => EventKind::Spawned { position },
            Change::Began { attempt, goal, pursuit } => EventKind::AttemptBegan { attempt, goal, pursuit },
            Change::Ended { attempt, end, goal, distance_m, seconds } => {
                EventKind::AttemptEnded { attempt, end, goal, distance_m, seconds, no_path: Arc::default() }
            }
            Change::Routed { kind, .. } => EventKind::RouteSet { kind },
            Change::Teleported { position, .. } => EventKind::Teleported { position },
            Change::Removed => EventKind::Removed,
        };
        NpcEvent { sequence: self.sequence, tick: self.tick, time: self.time, npc: self.npc, kind }
    }
}

impl HostedWorld {
    /// Hides events from readers until [`confirm`](Self::confirm) is called.
    pub fn await_confirmation(&mut self) {
        self.events.await_confirmation();
    }

    /// Lets readers see hidden events up to the number `through`.
    pub fn confirm(&mut self, through: u64) {
        self.events.confirm(through);
    }

    /// The journal of unconfirmed events; `None` if there are none.
    pub fn unconfirmed(&self) -> Option<Journal> {
        let (known, through) = (self.events.latest(), self.events.written());
        let entries = || self.events.since(known).filter_map(|event| Entry::of(event, |it| self.change(event.npc, it)));
        (through > known).then(|| Journal { through, entries: entries().collect() })
    }

    /// Copies the latest events.
    pub fn save_log(&self) -> SavedLog {
        let entries = self.events.since(0).filter_map(|event| Entry::of(event, |it| self.change(event.npc, it)));
        let mut entries: Vec<Entry> = entries.collect();
        let surplus = entries.len().saturating_sub(SAVED_EVENTS);
        let dropped = entries.drain(..surplus).next_back().map_or(self.events.dropped(), |entry| entry.sequence);
        for entry in &mut entries {
            // The save contains NPCs and routes.
            match &mut entry.change {
                Change::Spawned { newcomer, .. } => *newcomer = None,
                Change::Routed { route, .. } => *route = None,
                _ => {}
            }
        }
        SavedLog { written: self.events.written(), dropped, entries }
    }

    fn change(&self, npc: NpcId, kind: EventKind) -> Option<Change> {
        let record = self.records.get(&npc);
        let body = record.and_then(|record| self.world.npc(record.slot));
        Some(match kind {
            EventKind::Spawned { position } => {
                let newcomer = record.zip(body).map(|(record, npc)| Newcomer {
                    yaw: npc.body.yaw,
                    body: self.world.profile_of(npc).clone(),
                    owner: record.ticket.client().to_owned(),
                    tags: record.tags.clone(),
                    gait: record.gait,
                    looks_at: record.looks_at,
                });
                Change::Spawned { position, newcomer }
            }
            EventKind::AttemptBegan { attempt, goal, pursuit } => Change::Began { attempt, goal, pursuit },
            EventKind::AttemptEnded { attempt, end, goal, distance_m, seconds, no_path: _ } => {
                Change::Ended { attempt, end, goal, distance_m, seconds }
            }
            EventKind::RouteSet { kind } => {
                let itinerary = record.and_then(|record| record.itinerary.as_ref());
                Change::Routed { kind, route: itinerary.map(|it| it.route.clone()).filter(|_| kind.is_some()) }
            }
            EventKind::Teleported { position } => {
                Change::Teleported { position, yaw: body.map_or(0.0, |npc| npc.body.yaw) }
            }
            EventKind::Removed => Change::Removed,
            EventKind::TargetReached { .. }
            | EventKind::TargetLost { .. }
            | EventKind::TargetUnreachable { .. }
            | EventKind::TargetReachable { .. }
            | EventKind::StopReached { .. }
            | EventKind::Jumped { .. }
            | EventKind::Landed { .. }
            | EventKind::Rode { .. }
            | EventKind::Died { .. }
            | EventKind::Stands { .. } => return None,
        })
    }

    /// Applies journals to a restored world. Events continue with the number after the last one.
    pub fn resume(&mut self, log: SavedLog, journals: Vec<Journal>, npc_quota: &Arc<Quota>) {
        let SavedLog { mut written, dropped, mut entries } = log;
        for Journal { through, entries: later } in journals {
            for entry in later {
                // A journal may repeat entries of the previous one.
                if entry.sequence > written {
                    self.apply(&entry, npc_quota);
                    written = entry.sequence;
                    entries.push(entry);
                }
            }
            written = written.max(through);
        }
        self.events = EventLog::resumed(dropped, entries.iter().map(Entry::to_event), written);
        self.assign_workers();
    }

    /// Repeats a change. A change that is impossible, because the database was edited by hand, is left out.
    fn apply(&mut self, entry: &Entry, npc_quota: &Arc<Quota>) {
        if let Change::Spawned { position, newcomer: Some(newcomer) } = &entry.change {
            let is_new = entry.npc.world() == self.id && !self.records.contains_key(&entry.npc);
            if is_new
                && self.within_map(*position).is_ok()
                && let Some(body) = self.world.profile_idx(&newcomer.body, MAX_BODIES)
            {
                let slot = self.world.spawn_as(body, *position, newcomer.yaw);
                let mut record = NpcRecord::new(slot, npc_quota.grant(&newcomer.owner));
                record.tags = newcomer.tags.clone();
                record.gait = newcomer.gait;
                record.looks_at = newcomer.looks_at;
                self.add_record(entry.npc, record);
            }
            return;
        }
        let (tick, saved) = (entry.tick, self.tick());
        let Some(record) = self.records.get_mut(&entry.npc) else { return };
        let slot = record.slot;
        match entry.change {
            Change::Spawned { .. } => {}
            Change::Routed { ref route, .. } => {
                let itinerary = route.clone().map(|route| Itinerary::new(route, saved));
                record.itinerary = itinerary.filter(Itinerary::is_sound);
            }
            Change::Began { attempt, goal, pursuit } => {
                record.clear_goal();
                (record.goal, record.pursuit) = (Some(goal), pursuit);
                (record.attempts, record.began) = (attempt, saved);
                self.world.head_for(slot, goal, pursuit.arrival);
            }
            Change::Ended { attempt, end, distance_m, seconds, .. } => {
                if let Some(end) = end.filter(|_| record.goal.is_some() && record.attempts == attempt) {
                    record.note_end(end, tick, distance_m, Arc::default());
                    record.note_route(end, saved);
                    if let Some(last) = record.history.back_mut() {
                        last.seconds = seconds;
                    }
                    let at = End::ALL.iter().position(|other| *other == end).expect("all ends are listed");
                    self.counters.ends[at] += 1;
                }
                record.clear_goal();
                self.world.clear_waypoint(slot);
            }
            Change::Teleported { position, yaw } => {
                record.clear_goal();
                self.world.teleport(slot, position, yaw);
            }
            Change::Removed => {
                self.leave_worker(entry.npc);
                self.records.remove(&entry.npc);
                self.unassigned.remove(&entry.npc);
                self.world.despawn(slot);
            }
        }
    }
}
