//! Worlds: the simulation inside a game, which steps, saves and restores it.

use crate::abi::{self, CAN_JUMP, GROUNDED, RAY_COUNT, RIDES};
use crate::error::{Fault, Status, chain};
use std::sync::Arc;
use surefoot_levels::{ImportOptions, NoFiles};
use surefoot_world::map::{Device, LevelFrame};
use surefoot_world::sense::{RAY_RANGE_M, RayCone, observation_len};
use surefoot_world::{Action, CharacterProfile, End, Npc, NpcSlot, TICKS_PER_DECISION, TaskConfig, Vec3, WorldState};

/// Most NPCs of a world.
const MAX_NPCS: usize = 65_536;

/// `sf_map`: a level.
#[derive(Debug)]
pub struct Map {
    map: Arc<surefoot_world::Map>,
}

impl Map {
    /// Reads a level: a saved map, a binary glTF, a glTF with embedded buffers, an OBJ, or a `.zip` of a level and its
    /// files, by its first bytes.
    pub fn read(bytes: &[u8]) -> Result<Self, Fault> {
        let imported = surefoot_levels::read_level(bytes, None, &ImportOptions::default(), &NoFiles);
        let imported = imported.map_err(|error| Fault::file(chain(&error)))?;
        Ok(Self { map: Arc::new(imported.map) })
    }

    /// Devices of the level.
    pub fn devices(&self) -> Vec<abi::Device> {
        let device = |it: Device| abi::Device {
            kind: abi::surface_number(it.kind.surface()),
            two_way: it.two_way.into(),
            from: it.from.into(),
            to: it.to.unwrap_or(it.from).into(),
        };
        self.map.placed().devices().map(device).collect()
    }

    /// The map itself.
    pub fn inner(&self) -> &Arc<surefoot_world::Map> {
        &self.map
    }

    /// The map's extent, m.
    pub fn extent(&self) -> Vec3 {
        self.map.extent()
    }

    /// How the level's own coordinates relate to the map's.
    pub fn frame(&self) -> &LevelFrame {
        self.map.frame()
    }
}

/// `sf_snapshot`: the state of a world at one moment.
#[derive(Debug, Default)]
pub struct Snapshot {
    state: Option<WorldState>,
}

/// `sf_world`: a map with NPCs on it.
#[derive(Debug)]
pub struct World {
    world: surefoot_world::World,
    cone: RayCone,
}

impl World {
    /// A world on a map, for NPCs of one body.
    pub fn new(map: &Map, profile: CharacterProfile) -> Self {
        let world = surefoot_world::World::new(Arc::clone(&map.map), profile, TaskConfig::default());
        Self { world, cone: RayCone::default() }
    }

    fn npc(&self, npc: u32) -> Result<(NpcSlot, &Npc), Fault> {
        let missing = || Fault::new(Status::NotFound, format!("the world has no NPC {npc}"));
        self.world.npc(NpcSlot(npc)).map(|state| (NpcSlot(npc), state)).ok_or_else(missing)
    }

    fn npc_with_goal(&self, npc: u32) -> Result<NpcSlot, Fault> {
        let (slot, state) = self.npc(npc)?;
        let missing = || Fault::new(Status::BadState, format!("NPC {npc} has no goal: call sf_world_set_goal first"));
        state.episode.map(|_| slot).ok_or_else(missing)
    }

    /// Adds an NPC and returns its number.
    pub fn spawn(&mut self, feet: Vec3, yaw: f32) -> Result<u32, Fault> {
        if !yaw.is_finite() {
            return Err(Fault::argument(format!("yaw is {yaw}, but must be finite")));
        }
        if self.world.npcs().count() >= MAX_NPCS {
            return Err(Fault::new(Status::BadState, format!("the world has {MAX_NPCS} NPCs: despawn some first")));
        }
        Ok(self.world.spawn(feet, yaw).0)
    }

    /// Removes an NPC.
    pub fn despawn(&mut self, npc: u32) -> Result<(), Fault> {
        let (slot, _) = self.npc(npc)?;
        self.world.despawn(slot);
        Ok(())
    }

    /// Gives an NPC a goal, m.
    pub fn set_goal(&mut self, npc: u32, goal: Vec3) -> Result<(), Fault> {
        let (slot, _) = self.npc(npc)?;
        self.world.set_waypoint(slot, goal);
        Ok(())
    }

    /// Begins a decision.
    pub fn decide(&mut self, npc: u32, action: Action) -> Result<(), Fault> {
        let (slot, _) = self.npc(npc)?;
        self.world.decide(slot, action);
        Ok(())
    }

    /// Advances the world by one tick.
    pub fn tick(&mut self) {
        self.world.tick();
    }

    /// Ends a decision.
    pub fn close_decision(&mut self, npc: u32) -> Result<abi::Outcome, Fault> {
        let slot = self.npc_with_goal(npc)?;
        let outcome = self.world.close_decision(slot).expect("an NPC with a goal");
        Ok(abi::Outcome { reward: outcome.reward, end: end_number(outcome.end) })
    }

    /// Runs a whole decision of some NPCs; all others keep their action.
    pub fn step(&mut self, npcs: &[u32], actions: &[Action], outcomes: &mut [abi::Outcome]) -> Result<(), Fault> {
        npcs.iter().try_for_each(|npc| self.npc_with_goal(*npc).map(drop))?;
        for (&npc, action) in npcs.iter().zip(actions) {
            self.decide(npc, *action)?;
        }
        (0..TICKS_PER_DECISION).for_each(|_| self.world.tick());
        for (&npc, outcome) in npcs.iter().zip(outcomes) {
            *outcome = self.close_decision(npc)?;
        }
        Ok(())
    }

    /// The state of an NPC, as an agent observes it.
    pub fn state(&self, npc: u32) -> Result<abi::State, Fault> {
        let (_, npc) = self.npc(npc)?;
        let (body, profile, task) = (&npc.body, self.world.profile_of(npc), self.world.task());
        let flag = |on: bool, flag: u32| if on { flag } else { 0 };
        Ok(abi::State {
            struct_size: 0,
            flags: flag(body.is_grounded(), GROUNDED)
                | flag(body.can_jump(profile), CAN_JUMP)
                | flag(body.ride.is_some(), RIDES),
            feet: body.feet.into(),
            velocity: body.velocity.into(),
            yaw: body.yaw,
            breath_used: (npc.last.ticks_in_water as f32 / task.drown_ticks as f32).min(1.0),
            jetpack_seconds: body.fuel,
            other_count: 0,
            others: std::ptr::null(),
        })
    }

    /// The hits of the rays of an NPC.
    pub fn look(&self, npc: u32, hits: &mut [abi::Hit]) -> Result<(), Fault> {
        let (_, npc) = self.npc(npc)?;
        hits.fill(abi::Hit::default());
        self.cone.cast(self.world.map(), self.world.profile_of(npc), &npc.body, |idx, distance, surface| {
            hits[idx] = abi::Hit { distance, body_distance: 0.0, surface: abi::surface_number(surface) };
        });
        Ok(())
    }

    /// Casts rays at the map.
    pub fn cast(&self, rays: &[abi::Ray], hits: &mut [abi::Hit]) -> Result<(), Fault> {
        for (idx, (ray, hit)) in rays.iter().zip(hits).enumerate() {
            let origin = ray.origin.checked(format_args!("rays[{idx}].origin"))?;
            let direction = ray.direction.checked(format_args!("rays[{idx}].direction"))?;
            let Some(direction) = direction.try_normalize() else {
                return Err(Fault::argument(format!("rays[{idx}].direction has no length")));
            };
            let found = self.world.map().mesh().cast_ray(origin, direction, RAY_RANGE_M);
            *hit = found.map_or(abi::Hit::default(), |found| abi::Hit {
                distance: found.distance,
                body_distance: 0.0,
                surface: abi::surface_number(found.surface),
            });
        }
        Ok(())
    }

    /// The observation of an NPC for policies that do not see others.
    pub fn observation(&self, npc: u32) -> Result<Vec<f32>, Fault> {
        let slot = self.npc_with_goal(npc)?;
        let mut row = vec![0.0; observation_len(false)];
        self.world.observe(slot, &mut row);
        Ok(row)
    }

    /// Saves the world into a snapshot.
    pub fn save(&self, snapshot: &mut Snapshot) {
        snapshot.state = Some(self.world.save());
    }

    /// Restores a snapshot of this world, or of another world with the same map and body.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), Fault> {
        let empty = || Fault::new(Status::BadState, "the snapshot is empty: call sf_world_save first");
        let state = snapshot.state.clone().ok_or_else(empty)?;
        if !state.fits(self.world.config().profiles.len(), self.world.map()) {
            return Err(Fault::argument("the snapshot is of a world on another map: restore it there"));
        }
        self.world.restore(state);
        Ok(())
    }

    /// Ticks so far.
    pub fn current_tick(&self) -> u64 {
        self.world.current_tick().0
    }
}

fn end_number(end: Option<End>) -> i32 {
    match end {
        None => 0,
        Some(End::Reached) => 1,
        Some(End::Fell) => 2,
        Some(End::Burnt) => 3,
        Some(End::Drowned) => 4,
        Some(End::NoProgress) => 5,
        Some(End::Unreachable) => 6,
        Some(End::ReachedNear) => 7,
    }
}

const _: () = assert!(RAY_COUNT == 64);
