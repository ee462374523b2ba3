//! A world of a game as the physics of an environment: episodes, and what NPCs sense.

use std::fmt;
use surefoot_rollout::env::{Physics, Standing};
use surefoot_world::character::{Ride, Support, TickEvents};
use surefoot_world::map::Placed;
use surefoot_world::mesh::Surface;
use surefoot_world::sense::observe_found;
use surefoot_world::sense::{Found, LastDecision, OBSERVATION_LEN, RAY_COUNT, RAY_RANGE_M, RayCone, SenseContext};
use surefoot_world::{
    Ability, Action, Body, CharacterProfile, DecisionOutcome, End, Episode, TICKS_PER_DECISION, TaskConfig, Vec3,
};

/// What a ray hit: the distance, m, and the surface.
pub type Hit = Option<(f32, Surface)>;

/// A character of a game.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BodyState {
    /// Lowest point of the body, m; y is up.
    pub feet: Vec3,
    /// Velocity, m/s.
    pub velocity: Vec3,
    /// Heading, rad: at 0 the body faces +z, at pi/2 it faces +x.
    pub yaw: f32,
    /// Whether it stands on ground on which it can walk.
    pub is_grounded: bool,
    /// Whether a jump wanted now would be made, from the ground or in the air.
    pub can_jump: bool,
    /// Whether it hangs on a zip line.
    pub rides: bool,
    /// Seconds of jetpack thrust left.
    pub fuel: f32,
    /// Whether it is in water.
    pub is_in_water: bool,
    /// How it came to harm, if it did: fell out of the level, burnt or drowned. It is then left alone until it is placed anew.
    pub harm: Option<End>,
    /// What it did in the last tick.
    pub events: TickEvents,
}

/// What a character does in a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// Forward, strafe (positive to the right), turn (positive as yaw grows) and jump, each -1 to 1.
    pub action: Action,
    /// Whether this is the first of the ten ticks for which the action holds: one jump is wanted in them if `action.jump` is above 0, as
    /// soon as it can be made.
    pub is_first: bool,
}

/// A level of a game with its characters, which count from 0 and do not get in each other's way.
pub trait GameWorld: Send {
    /// Puts a character there, at rest, unharmed and with nothing left of what it did; `feet` is in m, `yaw` in rad.
    fn place(&mut self, character: usize, feet: Vec3, yaw: f32);

    /// Advances the world by a tick of 1/60 s. The characters of `commands`, ascending, do as they are told; all others may be left alone.
    fn tick(&mut self, commands: &[(usize, Command)]);

    /// The state of a character.
    fn state(&self, character: usize) -> BodyState;

    /// Casts rays of at most `range` m from `origin`, m, in these unit directions. Characters are not in the way of rays.
    fn cast(&self, origin: Vec3, directions: &[Vec3; RAY_COUNT], range: f32) -> [Hit; RAY_COUNT];
}

/// The physics of a game, with the episodes of its NPCs.
pub(crate) struct GamePhysics {
    world: Box<dyn GameWorld>,
    profile: CharacterProfile,
    task: TaskConfig,
    cone: RayCone,
    placed: Placed,
    minds: Vec<Mind>,
}

/// What is known of an NPC besides its body.
#[derive(Debug, Clone, Copy, Default)]
struct Mind {
    episode: Option<Episode>,
    last: LastDecision,
    events: TickEvents,
}

impl fmt::Debug for GamePhysics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("GamePhysics").field("minds", &self.minds).finish_non_exhaustive()
    }
}

impl GamePhysics {
    pub fn new(world: Box<dyn GameWorld>, profile: CharacterProfile, placed: Placed, npc_count: usize) -> Self {
        let minds = vec![Mind::default(); npc_count];
        Self { world, profile, task: TaskConfig::default(), cone: RayCone::default(), placed, minds }
    }

    /// Records the tick of an NPC: how far it came, and whether its attempt ended.
    fn note_tick(&mut self, npc_idx: usize) {
        let state = self.world.state(npc_idx);
        let mind = &mut self.minds[npc_idx];
        mind.events.merge(state.events);
        let wet = mind.last.ticks_in_water;
        mind.last.ticks_in_water = if state.is_in_water { wet + 1 } else { wet.saturating_sub(1) };
        let drowned = (mind.last.ticks_in_water >= self.task.drown_ticks).then_some(End::Drowned);
        if let Some(episode) = mind.episode.as_mut().filter(|episode| episode.end.is_none()) {
            episode.note_tick(state.feet, &self.task);
            episode.end = episode.end.or(state.harm).or(drowned);
        }
    }
}

/// The body of which an observation tells.
fn body_of(state: &BodyState) -> Body {
    let mut body = Body::at(state.feet, state.yaw);
    body.velocity = state.velocity;
    body.support = if state.is_grounded { Support::Ground } else { Support::Air };
    body.air_jumps_left = state.can_jump.into();
    body.ticks_in_air = if state.is_grounded { 0 } else { u8::MAX };
    body.ride = state.rides.then_some(Ride { line_idx: 0, distance: 0.0 });
    body.fuel = state.fuel;
    body
}

impl Physics for GamePhysics {
    fn observation_len(&self) -> usize {
        OBSERVATION_LEN
    }

    fn place(&mut self, npc_idx: usize, feet: Vec3, yaw: f32) {
        self.minds[npc_idx] = Mind::default();
        self.world.place(npc_idx, feet, yaw);
    }

    fn set_goal(&mut self, npc_idx: usize, goal: Vec3) {
        let feet = self.world.state(npc_idx).feet;
        self.minds[npc_idx].episode = Some(Episode::new(goal, feet));
    }

    fn clear_goal(&mut self, npc_idx: usize) {
        self.minds[npc_idx].episode = None;
    }

    fn advance(&mut self, npcs: &[usize], actions: &[Action]) -> Vec<DecisionOutcome> {
        for (&npc_idx, action) in npcs.iter().zip(actions) {
            let velocity = self.world.state(npc_idx).velocity;
            let mind = &mut self.minds[npc_idx];
            (mind.last.velocity, mind.last.action, mind.events) = (velocity, action.to_array(), TickEvents::default());
        }
        for tick in 0..TICKS_PER_DECISION {
            let is_harmed = |npc_idx: usize| self.world.state(npc_idx).harm.is_some();
            let commands = npcs.iter().zip(actions).filter(|(npc_idx, _)| !is_harmed(**npc_idx));
            let commands: Vec<(usize, Command)> = commands
                .map(|(npc_idx, action)| (*npc_idx, Command { action: *action, is_first: tick == 0 }))
                .collect();
            self.world.tick(&commands);
            commands.iter().for_each(|(npc_idx, _)| self.note_tick(*npc_idx));
        }
        let close = |&npc_idx: &usize| {
            let episode = self.minds[npc_idx].episode.as_mut().expect("an NPC that decides has an episode");
            let reward = episode.close_decision(&self.task);
            DecisionOutcome { reward, end: episode.end }
        };
        npcs.iter().map(close).collect()
    }

    fn observe(&mut self, npc_idx: usize, row: &mut [f32]) {
        let body = body_of(&self.world.state(npc_idx));
        let Mind { episode, last, .. } = &self.minds[npc_idx];
        let episode = episode.as_ref().expect("an NPC that observes has an episode");
        let origin = RayCone::eye(&self.profile, &body);
        let hits = self.world.cast(origin, &self.cone.directions_of(&body), RAY_RANGE_M);
        let found = Found { hits: &hits, body_hits: &[f32::INFINITY; RAY_COUNT], others: &[] };
        let context = SenseContext { placed: &self.placed, profile: &self.profile, task: &self.task };
        observe_found(context, found, (&body, episode, last), row);
    }

    fn stand(&self, npc_idx: usize) -> Standing {
        let state = self.world.state(npc_idx);
        let mind = &self.minds[npc_idx];
        let is_drowned = mind.last.ticks_in_water >= self.task.drown_ticks;
        Standing {
            feet: state.feet,
            ability: Ability::used(mind.events),
            is_harmed: state.harm.is_some() || is_drowned,
        }
    }
}
