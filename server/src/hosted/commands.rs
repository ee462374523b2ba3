//! What clients ask of a world: spawn, send, teleport, look.

use super::events::EventKind;
use super::motion::Motion;
use super::snapshot::{EndedAttempt, NpcPlan, NpcState, NpcStatus, Snapshot, Support, Tally, WorldStats};
use super::world::{HostedWorld, Record};
use crate::ids::{NpcId, WorldId};
use crate::quota::Ticket;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::Arc;
use std::time::SystemTime;
use surefoot_world::character::{self, Body};
use surefoot_world::map::Liquid;
use surefoot_world::sense::Sight;
use surefoot_world::{Ability, CharacterProfile, Map, Seed, Vec3, navigable};

/// Something a client asked for that this world cannot do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NpcError {
    /// No such NPC.
    #[error("npc {0} does not exist")]
    Unknown(NpcId),
    /// The world is full.
    #[error("world {world} already has {limit} NPCs, the most it may have (--max-npcs)")]
    Full {
        /// Its id.
        world: WorldId,
        /// The limit.
        limit: usize,
    },
    /// The world has given its NPCs all numbers that there are.
    #[error("world {0} has had {max} NPCs, the most in its time: create another world", max = NpcId::MAX_SERIAL)]
    OutOfNumbers(WorldId),
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
    Down(NpcId),
    /// The NPC and its world belong to other clients.
    #[error("npc {0} belongs to another client")]
    NotOwner(NpcId),
    /// The map has nowhere to stand.
    #[error(transparent)]
    NoGround(#[from] navigable::NoGround),
}

/// An NPC that a client wants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpawnOrder {
    /// Where its feet are to be, m.
    pub position: Vec3,
    /// Heading, rad.
    pub yaw: f32,
    /// Where it is sent at once, m.
    pub goal: Option<Vec3>,
}

impl HostedWorld {
    /// Adds an NPC with its goal, as [`spawn`](Self::spawn) and [`set_goal`](Self::set_goal) do; with an error there is none.
    ///
    /// # Errors
    /// As theirs.
    pub fn spawn_to(&mut self, order: SpawnOrder, limit: usize, ticket: Ticket) -> Result<NpcId, NpcError> {
        if let Some(goal) = order.goal {
            self.check_inside(goal, "goal")?;
        }
        let id = self.spawn(order.position, order.yaw, limit, ticket)?;
        if let Some(goal) = order.goal {
            self.set_goal(id, goal)?;
        }
        Ok(id)
    }

    /// Adds an NPC for the client that holds `ticket` and returns its id.
    ///
    /// # Errors
    /// If the world is full or the position lies outside the map.
    pub fn spawn(&mut self, position: Vec3, yaw: f32, limit: usize, ticket: Ticket) -> Result<NpcId, NpcError> {
        self.check_inside(position, "position")?;
        if self.records.len() >= limit {
            return Err(NpcError::Full { world: self.id, limit });
        }
        if self.last_serial >= NpcId::MAX_SERIAL {
            return Err(NpcError::OutOfNumbers(self.id));
        }
        self.last_serial += 1;
        let id = NpcId::new(self.id, self.last_serial);
        let slot = self.world.spawn(position, yaw);
        self.records.insert(id, Record::new(slot, ticket));
        self.tell(id, EventKind::Spawned { position });
        self.assign_workers();
        Ok(id)
    }

    /// Removes an NPC.
    ///
    /// # Errors
    /// If it does not exist.
    pub fn despawn(&mut self, id: NpcId) -> Result<(), NpcError> {
        self.tell_replaced(id);
        let record = self.records.remove(&id).ok_or(NpcError::Unknown(id))?;
        self.tell(id, EventKind::Removed);
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

    /// Sends an NPC to a goal: the number of the attempt that begins.
    ///
    /// # Errors
    /// If it does not exist or is down, or the goal lies outside the map.
    pub fn set_goal(&mut self, id: NpcId, goal: Vec3) -> Result<u32, NpcError> {
        self.check_inside(goal, "goal")?;
        let record = self.records.get(&id).ok_or(NpcError::Unknown(id))?;
        if self.world.npc(record.slot).is_some_and(|npc| npc.harm.is_some()) {
            return Err(NpcError::Down(id));
        }
        self.tell_replaced(id);
        let tick = self.tick();
        let record = self.records.get_mut(&id).expect("just found");
        record.clear_goal();
        record.goal = Some(goal);
        record.attempts += 1;
        record.began = tick;
        let attempt = record.attempts;
        self.world.set_goal(record.slot, goal);
        self.tell(id, EventKind::AttemptBegan { attempt, goal });
        Ok(attempt)
    }

    /// Puts an NPC elsewhere, at rest.
    ///
    /// # Errors
    /// If it does not exist or the position lies outside the map.
    pub fn teleport(&mut self, id: NpcId, position: Vec3, yaw: f32) -> Result<(), NpcError> {
        self.check_inside(position, "position")?;
        self.tell_replaced(id);
        let record = self.records.get_mut(&id).ok_or(NpcError::Unknown(id))?;
        record.clear_goal();
        record.motion = Motion::default();
        self.world.teleport(record.slot, position, yaw);
        self.tell(id, EventKind::Teleported { position });
        Ok(())
    }

    /// The client that spawned an NPC.
    ///
    /// # Errors
    /// If it does not exist.
    pub fn owner_of(&self, id: NpcId) -> Result<&str, NpcError> {
        self.records.get(&id).map(|record| record.ticket.client()).ok_or(NpcError::Unknown(id))
    }

    /// State of one NPC.
    ///
    /// # Errors
    /// If it does not exist.
    pub fn npc(&self, id: NpcId) -> Result<NpcState, NpcError> {
        let record = self.records.get(&id).ok_or(NpcError::Unknown(id))?;
        Ok(self.describe(id, record))
    }

    /// The plan that an NPC follows.
    ///
    /// # Errors
    /// If it does not exist.
    pub fn plan(&self, id: NpcId) -> Result<Option<Arc<NpcPlan>>, NpcError> {
        Ok(self.records.get(&id).ok_or(NpcError::Unknown(id))?.plan.clone())
    }

    /// An NPC's last attempts that ended, the latest last.
    ///
    /// # Errors
    /// If it does not exist.
    pub fn history(&self, id: NpcId) -> Result<Vec<EndedAttempt>, NpcError> {
        Ok(self.records.get(&id).ok_or(NpcError::Unknown(id))?.history.iter().copied().collect())
    }

    /// What an NPC sees.
    ///
    /// # Errors
    /// If it does not exist.
    pub fn sight(&self, id: NpcId) -> Result<Sight, NpcError> {
        Ok(self.world.sight(self.records.get(&id).ok_or(NpcError::Unknown(id))?.slot))
    }

    /// State of all NPCs, by id.
    pub fn npcs(&self) -> impl Iterator<Item = NpcState> {
        self.records.iter().map(|(&id, record)| self.describe(id, record))
    }

    /// State of all NPCs at this moment.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot { tick: self.tick(), time: SystemTime::now(), npcs: self.npcs().collect() }
    }

    /// Figures of the world.
    pub fn stats(&self) -> WorldStats {
        WorldStats {
            counters: self.counters.clone(),
            times: self.times.clone(),
            without_worker: self.tally().without_worker,
        }
    }

    /// How many NPCs are idle, seeking and down, and how many have no worker.
    pub fn tally(&self) -> Tally {
        let mut tally = Tally::default();
        for record in self.records.values() {
            match self.status(record) {
                NpcStatus::Down => tally.down += 1,
                NpcStatus::Seeking => tally.seeking += 1,
                NpcStatus::Idle => tally.idle += 1,
            }
            tally.without_worker += u32::from(record.worker.is_none());
        }
        tally
    }

    /// Places where a character can stand.
    ///
    /// # Errors
    /// If the map has none.
    pub fn sample_ground(map: &Map, count: usize, Seed(seed): Seed) -> Result<Vec<Vec3>, NpcError> {
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

    fn status(&self, record: &Record) -> NpcStatus {
        if self.world.npc(record.slot).is_some_and(|npc| npc.harm.is_some()) {
            NpcStatus::Down
        } else if record.goal.is_some() {
            NpcStatus::Seeking
        } else {
            NpcStatus::Idle
        }
    }

    fn describe(&self, id: NpcId, record: &Record) -> NpcState {
        let npc = self.world.npc(record.slot).expect("every record has an NPC");
        NpcState {
            id,
            position: npc.body.feet,
            velocity: npc.body.velocity,
            yaw: npc.body.yaw,
            status: self.status(record),
            goal: record.goal,
            waypoint: record.waypoint,
            last_outcome: record.last_outcome,
            attempts_begun: record.attempts,
            attempts_ended: record.attempts_ended,
            worker: record.worker,
            support: support_of(&npc.body),
            // Nobody decides for an NPC without a goal: what it did then is over.
            ability: Ability::used(if record.goal.is_some() {
                npc.events
            } else {
                self.world.tick_events(record.slot)
            }),
            cause: npc.harm,
        }
    }
}

fn support_of(body: &Body) -> Support {
    match body.support {
        _ if body.ride.is_some() => Support::ZipLine,
        character::Support::Ground if body.liquid == Some(Liquid::Water) => Support::Water,
        character::Support::Ground => Support::Ground,
        character::Support::Steep => Support::Steep,
        character::Support::Air => Support::Air,
    }
}
