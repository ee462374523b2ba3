//! Calls of clients to a world: spawn, despawn, teleport, read state. `goals` has those about goals.

use super::events::EventKind;
use super::motion::Motion;
use super::snapshot::{
    BodyId, BodyPose, EndedAttempt, NpcPlan, NpcState, NpcStatus, Poses, Snapshot, Support, Tally, WorldStats,
};
use super::world::{HostedWorld, NpcRecord};
use crate::ids::{NpcId, WorldId};
use crate::quota::Ticket;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::Arc;
use std::time::SystemTime;
use surefoot_planner::Tags;
use surefoot_world::arrival::{NoFooting, SNAP_M};
use surefoot_world::character::{self, Body};
use surefoot_world::map::Liquid;
use surefoot_world::sense::Sight;
use surefoot_world::{CharacterProfile, Gait, Map, ProfileIdx, Seed, Vec3, navigable};

/// Why a world cannot carry out a request about an NPC.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the texts say what the variants mean")]
pub enum NpcError {
    #[error("npc {0} does not exist")]
    Unknown(NpcId),
    #[error("world {world} already has {limit} NPCs, the most allowed (--max-npcs)")]
    Full { world: WorldId, limit: usize },
    #[error("world {0} has used all {max} numbers for its NPCs: create another world", max = NpcId::MAX_SERIAL)]
    OutOfNumbers(WorldId),
    #[error("world {0} has NPCs of {MAX_BODIES} bodies, the most allowed: create another world")]
    TooManyBodies(WorldId),
    #[error("{field} lies outside the map, which spans {span}")]
    Outside { field: String, span: String },
    #[error("npc {0} is down: teleport it first")]
    Down(NpcId),
    #[error("{}", no_footing(*.0, *.1))]
    NoFooting(NoFooting, f32),
    #[error("{field}: {}", no_room(*.why))]
    NoRoom { field: String, why: NoFooting },
    #[error("world {0} has no zone `{1}`: ListZones names them")]
    NoZone(WorldId, String),
    #[error("npc {0} has no goal to move: set one first")]
    NoGoal(NpcId),
    #[error("npc {0} cannot be its own target")]
    OwnTarget(NpcId),
    #[error("npc {0} is not in the world of its leader, npc {1}")]
    OtherWorld(NpcId, NpcId),
    #[error("npc {0} follows another leader: clear its goal first")]
    Follows(NpcId),
    #[error("spacing is {spacing} m, but these bodies need at least {least} m")]
    TooDense { spacing: f32, least: f32 },
    #[error("world {0} has no player {1}")]
    NoPlayer(WorldId, u32),
    #[error("npc {0} belongs to another client")]
    NotOwner(NpcId),
    #[error(transparent)]
    NoGround(#[from] navigable::NoGround),
}

fn no_footing(why: NoFooting, snap: f32) -> String {
    match why {
        NoFooting::InSolid => format!(
            "the goal lies in solid ground or too close to it, and the NPC cannot stand anywhere within {snap} m: move \
             the goal or raise snap"
        ),
        NoFooting::InAir => format!("there is no ground within {snap} m of the goal: move the goal or raise snap"),
    }
}

fn no_room(why: NoFooting) -> String {
    match why {
        NoFooting::InSolid => {
            format!("the NPC cannot stand in or so close to solid ground, nor within {SNAP_M} m of it")
        }
        NoFooting::InAir => format!("there is no ground within {SNAP_M} m"),
    }
}

/// Most bodies of one world.
pub const MAX_BODIES: usize = 64;

/// An NPC to spawn.
#[derive(Debug, Clone, PartialEq)]
pub struct SpawnOrder {
    /// Position of the feet, m.
    pub position: Vec3,
    /// Heading, rad.
    pub yaw: f32,
    /// Goal of the first attempt, m; `None`: the NPC is idle.
    pub goal: Option<Vec3>,
    /// Body of the NPC; `None`: the default body of the world.
    pub body: Option<CharacterProfile>,
    /// Its tags, for zones that ask for them.
    pub tags: Tags,
    /// How it goes where it can walk.
    pub gait: Gait,
}

impl HostedWorld {
    /// Adds an NPC and sets its goal, if there is one. On an error, no NPC is added.
    pub fn spawn_to(&mut self, order: SpawnOrder, limit: usize, ticket: Ticket) -> Result<NpcId, NpcError> {
        if let Some(goal) = order.goal {
            self.check_inside(goal, "goal")?;
        }
        let body = match order.body {
            Some(body) => self.world.profile_idx(&body, MAX_BODIES).ok_or(NpcError::TooManyBodies(self.id))?,
            None => ProfileIdx::default(),
        };
        let id = self.spawn_as(body, order.position, order.yaw, limit, ticket)?;
        if !order.tags.is_empty() {
            self.set_tags(id, order.tags)?;
        }
        self.set_gait(id, order.gait)?;
        if let Some(goal) = order.goal
            && let Err(error) = self.set_goal(id, goal)
        {
            self.despawn(id)?;
            return Err(error);
        }
        Ok(id)
    }

    /// Changes how an NPC goes, from its next decision on.
    pub fn set_gait(&mut self, id: NpcId, gait: Gait) -> Result<(), NpcError> {
        self.records.get_mut(&id).ok_or(NpcError::Unknown(id))?.gait = gait;
        Ok(())
    }

    /// Adds an NPC with the default body for the client of `ticket`, and returns its id.
    pub fn spawn(&mut self, position: Vec3, yaw: f32, limit: usize, ticket: Ticket) -> Result<NpcId, NpcError> {
        self.spawn_as(ProfileIdx::default(), position, yaw, limit, ticket)
    }

    fn spawn_as(
        &mut self,
        body: ProfileIdx,
        position: Vec3,
        yaw: f32,
        limit: usize,
        ticket: Ticket,
    ) -> Result<NpcId, NpcError> {
        self.check_inside(position, "position")?;
        if self.records.len() >= limit {
            return Err(NpcError::Full { world: self.id, limit });
        }
        if self.last_serial >= NpcId::MAX_SERIAL {
            return Err(NpcError::OutOfNumbers(self.id));
        }
        self.last_serial += 1;
        let id = NpcId::new(self.id, self.last_serial);
        let slot = self.world.spawn_as(body, position, yaw);
        self.add_record(id, NpcRecord::new(slot, ticket));
        self.log_event(id, EventKind::Spawned { position });
        self.assign_workers();
        Ok(id)
    }

    /// Removes an NPC.
    pub fn despawn(&mut self, id: NpcId) -> Result<(), NpcError> {
        self.log_replaced_attempt(id);
        self.lose_leader(id);
        self.leave_worker(id);
        let record = self.records.remove(&id).ok_or(NpcError::Unknown(id))?;
        self.gatherings.release(id);
        self.unassigned.remove(&id);
        self.log_event(id, EventKind::Removed);
        self.world.despawn(record.slot);
        Ok(())
    }

    /// Places an NPC at `position` (m) with heading `yaw` (rad), at rest and without a goal. Revives an NPC that is
    /// down.
    pub fn teleport(&mut self, id: NpcId, position: Vec3, yaw: f32) -> Result<(), NpcError> {
        self.check_inside(position, "position")?;
        self.log_replaced_attempt(id);
        let record = self.records.get_mut(&id).ok_or(NpcError::Unknown(id))?;
        record.clear_goal();
        record.motion = Motion::default();
        self.gatherings.release(id);
        self.world.teleport(record.slot, position, yaw);
        self.log_event(id, EventKind::Teleported { position });
        self.disband(id)
    }

    /// The client that spawned an NPC.
    pub fn owner_of(&self, id: NpcId) -> Result<&str, NpcError> {
        self.records.get(&id).map(|record| record.ticket.client()).ok_or(NpcError::Unknown(id))
    }

    /// State of one NPC.
    pub fn npc(&self, id: NpcId) -> Result<NpcState, NpcError> {
        let record = self.records.get(&id).ok_or(NpcError::Unknown(id))?;
        Ok(self.describe(id, record))
    }

    /// Returns the plan that an NPC follows; `None` if it follows none.
    pub fn plan(&self, id: NpcId) -> Result<Option<Arc<NpcPlan>>, NpcError> {
        Ok(self.records.get(&id).ok_or(NpcError::Unknown(id))?.plan.clone())
    }

    /// Returns the last attempts of an NPC that ended with an outcome, at most 32, the latest last.
    pub fn history(&self, id: NpcId) -> Result<Vec<EndedAttempt>, NpcError> {
        Ok(self.records.get(&id).ok_or(NpcError::Unknown(id))?.history.iter().cloned().collect())
    }

    /// Casts the rays of an NPC and returns their hits.
    pub fn sight(&self, id: NpcId) -> Result<Sight, NpcError> {
        Ok(self.world.sight(self.records.get(&id).ok_or(NpcError::Unknown(id))?.slot))
    }

    /// Returns the states of all NPCs, ordered by id.
    pub fn npcs(&self) -> impl Iterator<Item = NpcState> {
        self.records.iter().map(|(&id, record)| self.describe(id, record))
    }

    /// Copies the states of all NPCs, movers and players.
    pub fn snapshot(&self) -> Snapshot {
        let movers = self.movers().iter().zip(self.mover_states());
        Snapshot {
            map_revision: self.map_revision(),
            tick: self.tick(),
            time: SystemTime::now(),
            npcs: self.npcs().collect(),
            movers: movers.map(|(mover, state)| (*state, state.pose(mover))).collect(),
            players: self.world.players().map(|(slot, player)| (slot, *player)).collect(),
        }
    }

    /// Copies where all bodies are.
    pub fn poses(&self) -> Poses {
        let npcs = self.records.iter().filter_map(|(&id, record)| {
            let npc = self.world.npc(record.slot)?;
            Some(BodyPose { id: BodyId::Npc(id), feet: npc.body.feet, yaw: npc.body.yaw })
        });
        let players = self.world.players();
        let players = players.map(|(slot, it)| BodyPose { id: BodyId::Player(slot), feet: it.feet, yaw: 0.0 });
        Poses { tick: self.tick(), bodies: npcs.chain(players).collect() }
    }

    /// Copies the statistics of the world.
    pub fn stats(&self) -> WorldStats {
        WorldStats {
            counters: self.counters.clone(),
            times: self.times.clone(),
            without_worker: self.tally().without_worker,
        }
    }

    /// Counts the NPCs that are idle, seeking and down, those without a worker, and those that stand.
    pub fn tally(&self) -> Tally {
        let mut tally = Tally::default();
        for record in self.records.values() {
            match self.status(record) {
                NpcStatus::Down => tally.down += 1,
                NpcStatus::Seeking => tally.seeking += 1,
                NpcStatus::Idle => tally.idle += 1,
            }
            tally.without_worker += u32::from(record.worker.is_none());
            if let Some(reason) = self.world.npc(record.slot).and_then(|npc| record.standing(npc, self.tick())) {
                tally.standing[reason as usize] += 1;
            }
        }
        tally
    }

    /// Samples `count` random places where a character with this body can stand.
    pub fn sample_ground(
        map: &Map,
        body: &CharacterProfile,
        count: usize,
        Seed(seed): Seed,
    ) -> Result<Vec<Vec3>, NpcError> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        Ok(navigable::sample_many(map, body, count, &mut rng)?)
    }

    /// Checks that a point is on the map; `Err` describes the span of the map.
    pub(super) fn within_map(&self, point: Vec3) -> Result<(), String> {
        let (map, extent) = (self.world.map(), self.world.map().extent());
        let is_outside = map.is_outside(point) || point.y > extent.y;
        if is_outside { Err(map.frame().describe_span(extent)) } else { Ok(()) }
    }

    pub(super) fn check_inside(&self, point: Vec3, field: &str) -> Result<(), NpcError> {
        self.within_map(point).map_err(|span| NpcError::Outside { field: field.to_owned(), span })
    }

    fn status(&self, record: &NpcRecord) -> NpcStatus {
        if self.world.npc(record.slot).is_some_and(|npc| npc.harm.is_some()) {
            NpcStatus::Down
        } else if record.goal.is_some() {
            NpcStatus::Seeking
        } else {
            NpcStatus::Idle
        }
    }

    fn describe(&self, id: NpcId, record: &NpcRecord) -> NpcState {
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
            // Without a goal there are no decisions, so only the last tick counts.
            ability: if record.goal.is_some() { npc.used_abilities } else { self.world.used_in_tick(record.slot) }
                .most_demanding(),
            cause: npc.harm,
            body: npc.profile,
            standing: record.standing(npc, self.tick()),
            route: record.itinerary.as_ref().map(|itinerary| itinerary.route.kind()),
            route_stop: record.itinerary.as_ref().map_or(0, |itinerary| itinerary.stop),
            gait: record.gait,
            looks_at: record.looks_at,
            movement: Some(record.movement(npc, self.tick())),
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
