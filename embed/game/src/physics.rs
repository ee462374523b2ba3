//! A world of a game as the physics of an environment: episodes, and what NPCs sense.

use crate::decide::{Bodies, Decided, Decision, Sighting};
use crate::world::BodyState;
use std::fmt;
use surefoot_rollout::env::{Physics, Placement, Standing};
use surefoot_world::character::{Ride, Support};
use surefoot_world::map::Placed;
use surefoot_world::sense::observe_found;
use surefoot_world::sense::{Found, LastDecision, OBSERVATION_LEN, RAY_COUNT, SenseContext};
use surefoot_world::{AbilitySet, Action, Body, CharacterProfile, DecisionOutcome, End, Episode, TaskConfig, Vec3};

/// The physics of a game, with the episodes of its NPCs.
pub(crate) struct GamePhysics {
    bodies: Box<dyn Bodies>,
    profile: CharacterProfile,
    task: TaskConfig,
    placed: Placed,
    npcs: Vec<Npc>,
    /// Placements that go to the game with the next decision.
    announced: Vec<Placement>,
    /// Placements that the game has made, and which are not yet asked for here.
    made: Vec<(Placement, Sighting)>,
    failure: Option<String>,
}

/// An NPC: where its body is, and what is known besides.
#[derive(Debug, Clone, Copy)]
struct Npc {
    body: Sighting,
    mind: Mind,
}

/// What is known of an NPC besides its body.
#[derive(Debug, Clone, Copy, Default)]
struct Mind {
    episode: Option<Episode>,
    last: LastDecision,
    used_abilities: AbilitySet,
}

impl fmt::Debug for GamePhysics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("GamePhysics").field("npcs", &self.npcs).finish_non_exhaustive()
    }
}

impl GamePhysics {
    pub fn new(bodies: Box<dyn Bodies>, profile: CharacterProfile, placed: Placed, npc_count: usize) -> Self {
        let body = Sighting { state: BodyState::default(), hits: [None; RAY_COUNT] };
        let npcs = vec![Npc { body, mind: Mind::default() }; npc_count];
        let task = TaskConfig::default();
        Self { bodies, profile, task, placed, npcs, announced: Vec::new(), made: Vec::new(), failure: None }
    }

    /// Lets the game carry out a decision; `None` once it cannot go on.
    fn decide(&mut self, actions: &[(usize, Action)], placements: &[Placement]) -> Option<Decided> {
        if self.failure.is_some() {
            return None;
        }
        if actions.is_empty() && placements.is_empty() {
            return Some(Decided::default());
        }
        let placements: Vec<(usize, Vec3, f32)> =
            placements.iter().map(|Placement { npc_idx, feet, yaw }| (*npc_idx, *feet, *yaw)).collect();
        match self.bodies.decide(Decision { actions, placements: &placements }) {
            Ok(decided) => Some(decided),
            Err(reason) => {
                self.failure = Some(reason);
                None
            }
        }
    }
}

impl Npc {
    /// Records a tick: how far the NPC came, and whether its attempt ended.
    fn note_tick(&mut self, state: &BodyState, task: &TaskConfig) {
        self.body.state = *state;
        let Mind { episode, last, used_abilities } = &mut self.mind;
        *used_abilities = used_abilities.union(state.used_abilities);
        let wet = last.ticks_in_water;
        last.ticks_in_water = if state.is_in_water { wet + 1 } else { wet.saturating_sub(1) };
        let drowned = (last.ticks_in_water >= task.drown_ticks).then_some(End::Drowned);
        if let Some(episode) = episode.as_mut().filter(|episode| episode.end.is_none()) {
            episode.note_tick(state.feet, task);
            episode.end = episode.end.or(state.harm).or(drowned);
        }
    }

    /// Records the ticks of a decision, up to where the NPC came to harm.
    fn note_ticks(&mut self, states: &[BodyState], task: &TaskConfig) {
        for state in states {
            if self.body.state.harm.is_some() {
                return;
            }
            self.note_tick(state, task);
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

    fn place(&mut self, placements: &[Placement]) {
        let (mut wanted, mut found) = (Vec::new(), Vec::new());
        for placement in placements {
            let made = self.made.iter().position(|(made, _)| made.npc_idx == placement.npc_idx);
            match made.map(|idx| self.made.swap_remove(idx)) {
                Some((made, body)) if made == *placement => found.push((made.npc_idx, body)),
                // Where the game has put it is not where it is to be.
                _ => wanted.push(*placement),
            }
        }
        if let Some(decided) = self.decide(&[], &wanted) {
            found.extend(wanted.iter().map(|placement| placement.npc_idx).zip(decided.placed));
        }
        for (npc_idx, body) in found {
            self.npcs[npc_idx] = Npc { body, mind: Mind::default() };
        }
    }

    fn announce(&mut self, placements: &[Placement]) {
        self.announced = placements.to_vec();
    }

    fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }

    fn set_goal(&mut self, npc_idx: usize, goal: Vec3) {
        let Npc { body, mind } = &mut self.npcs[npc_idx];
        mind.episode = Some(Episode::new(goal, body.state.feet));
    }

    fn clear_goal(&mut self, npc_idx: usize) {
        self.npcs[npc_idx].mind.episode = None;
    }

    fn advance(&mut self, npcs: &[usize], actions: &[Action]) -> Vec<DecisionOutcome> {
        for (&npc_idx, action) in npcs.iter().zip(actions) {
            let Npc { body, mind } = &mut self.npcs[npc_idx];
            (mind.last.velocity, mind.last.action) = (body.state.velocity, action.to_array());
            mind.used_abilities = AbilitySet::default();
        }
        let actions: Vec<(usize, Action)> = npcs.iter().copied().zip(actions.iter().copied()).collect();
        let placements = std::mem::take(&mut self.announced);
        if let Some(Decided { acted, placed }) = self.decide(&actions, &placements) {
            for (&npc_idx, acted) in npcs.iter().zip(acted) {
                self.npcs[npc_idx].note_ticks(&acted.ticks, &self.task);
                self.npcs[npc_idx].body.hits = acted.hits;
            }
            self.made = placements.into_iter().zip(placed).collect();
        }
        let close = |&npc_idx: &usize| {
            let episode = self.npcs[npc_idx].mind.episode.as_mut().expect("an NPC that decides has an episode");
            let reward = episode.close_decision(&self.task);
            DecisionOutcome { reward, end: episode.end }
        };
        npcs.iter().map(close).collect()
    }

    fn observe(&mut self, npc_idx: usize, row: &mut [f32]) {
        let Npc { body: Sighting { state, hits }, mind: Mind { episode, last, .. } } = &self.npcs[npc_idx];
        let episode = episode.as_ref().expect("an NPC that observes has an episode");
        let found = Found { hits, body_hits: &[f32::INFINITY; RAY_COUNT], others: &[] };
        let context = SenseContext { placed: &self.placed, profile: &self.profile, task: &self.task };
        observe_found(context, found, (&body_of(state), episode, last), row);
    }

    fn stand(&self, npc_idx: usize) -> Standing {
        let Npc { body, mind } = &self.npcs[npc_idx];
        let is_drowned = mind.last.ticks_in_water >= self.task.drown_ticks;
        Standing {
            feet: body.state.feet,
            ability: mind.used_abilities.most_demanding(),
            is_harmed: body.state.harm.is_some() || is_drowned,
        }
    }
}
