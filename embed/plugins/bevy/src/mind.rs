//! What an agent wants and remembers.

use crate::agent::{AgentPlan, AgentState};
use crate::graph::SurefootGraph;
use bevy_ecs::prelude::*;
use bevy_math::Vec3;
use std::sync::Arc;
use surefoot_rollout::game::{GameAttempt, Rehearsals};
use surefoot_rollout::rehearse::NoiseStream;
use surefoot_rollout::{FollowConfig, Follower, Style};
use surefoot_world::character::{Ride, Support};
use surefoot_world::sense::LastDecision;
use surefoot_world::{Body, CharacterProfile, Episode, Npc};

/// How far a place is from the goal at most to be near it: in metres, and as a share of the agent's distance from the
/// goal.
const NEAR_M: f32 = 4.0;
const NEAR_SHARE: f32 = 0.25;

/// The state of an agent that concerns nobody else.
#[derive(Component, Debug, Default)]
pub(crate) struct Mind {
    /// The attempt that it is making.
    pub attempt: Option<Attempt>,
    /// What it did before.
    pub last: LastDecision,
    /// The policy's memory; empty before the first decision.
    pub memory: Vec<f32>,
    /// Its noise; `None` before the first decision.
    noise: Option<NoiseStream>,
    /// How it carries out its next decision, with its NPC on the map, if it rehearses.
    pub prepared: Option<(Style, Npc)>,
}

/// An attempt at a goal. Places are those of the scene, but in the follower, where they are on the map.
#[derive(Debug)]
pub(crate) struct Attempt {
    pub goal: Vec3,
    /// The way to the current waypoint, as the policy sees it.
    pub episode: Episode,
    pub route: Option<Route>,
    /// Whether the waypoint was reached since the last decision.
    pub has_reached: bool,
    /// The place to which [`GoalSight`](crate::GoalSight) has lines in this tick.
    pub arriving: Option<Arriving>,
    /// Where the agent stood, m, and decisions since it was farther away from there than waypoints reach.
    pub stood_at: Vec3,
    pub standing: u32,
    /// Whether the agent has decided in this attempt since it heads for its waypoint.
    pub has_decided: bool,
}

/// A place at which an agent must stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Arriving {
    Goal,
    /// The last waypoint of a plan that leads elsewhere: to the nearest place, or to where the goal was a moment ago.
    Waypoint,
}

/// A plan, and how it is followed.
#[derive(Debug)]
pub(crate) struct Route {
    pub graph: SurefootGraph,
    pub attempt: GameAttempt,
    pub rehearsals: Option<Arc<Rehearsals>>,
}

impl Attempt {
    pub fn new(goal: Vec3, feet: Vec3, route: Option<(SurefootGraph, Option<Arc<Rehearsals>>)>) -> Self {
        let route = route.map(|(graph, rehearsals)| {
            let config = FollowConfig { composes: rehearsals.is_some(), ..FollowConfig::default() };
            Route { attempt: GameAttempt::new(Follower::new(goal + graph.origin(), config)), graph, rehearsals }
        });
        Self {
            goal,
            episode: Episode::new(goal, feet),
            route,
            has_reached: false,
            arriving: None,
            stood_at: feet,
            standing: 0,
            has_decided: false,
        }
    }

    /// Whether another goal of an agent at `feet` moves this attempt's, m: it is near, and the plans are of the same
    /// graph.
    pub fn goes_on_to(&self, goal: Vec3, feet: Vec3, graph: Option<&SurefootGraph>) -> bool {
        let has_same_graph = match (&self.route, graph) {
            (Some(route), Some(graph)) => route.graph.is_clone_of(graph),
            (None, None) => true,
            _ => false,
        };
        has_same_graph && goal.distance(self.goal) <= NEAR_M.max(NEAR_SHARE * feet.distance(self.goal))
    }

    /// Moves the goal of an agent at `feet`, m. The plan stays, and its last leg leads to the new goal.
    pub fn move_goal(&mut self, goal: Vec3, feet: Vec3, plan: &mut AgentPlan) {
        self.goal = goal;
        let Some(Route { graph, attempt, .. }) = &mut self.route else {
            if goal != self.episode.goal {
                self.head_for(goal, feet);
            }
            return;
        };
        let origin = graph.origin();
        let waypoint = attempt.follow_goal(goal + origin, feet + origin, self.has_reached);
        let last = attempt.follower().current_plan().and_then(|plan| plan.waypoints.last());
        if let (Some(last), Some(shown)) = (last, plan.plan.as_mut().and_then(|plan| plan.waypoints.last_mut())) {
            *shown = *last - origin;
        }
        if let Some(waypoint) = waypoint.map(|waypoint| waypoint - origin) {
            plan.waypoint = Some(waypoint);
            self.head_for(waypoint, feet);
        }
    }

    pub fn head_for(&mut self, waypoint: Vec3, feet: Vec3) {
        (self.episode, self.has_decided) = (Episode::new(waypoint, feet), false);
        (self.has_reached, self.arriving) = (false, None);
    }

    /// Counts a decision of an agent at `feet`, m, and returns for how many it has stood within `radius` metres.
    pub fn count_standing(&mut self, feet: Vec3, radius: f32) -> u32 {
        self.standing += 1;
        if feet.distance(self.stood_at) > radius {
            (self.stood_at, self.standing) = (feet, 0);
        }
        self.standing
    }
}

impl Mind {
    /// Forgets all but how much randomness was drawn.
    pub fn forget(&mut self) {
        *self = Self { noise: self.noise, ..Self::default() };
    }

    /// The noise under `seed`, with this share of the policy's exploration noise; a share that is not a number is 0.
    pub fn noise(noise: &mut Option<NoiseStream>, seed: u64, share: f32) -> &mut NoiseStream {
        let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
        let noise = noise.get_or_insert_with(|| NoiseStream::new(share, seed, 0));
        *noise = noise.with_share(share);
        noise
    }

    /// Draws the noise of the next action.
    pub fn draw(&mut self, seed: u64, share: f32) -> impl Iterator<Item = f32> + use<> {
        let style = self.prepared.map_or(Style::Free, |(style, _)| style);
        Self::noise(&mut self.noise, seed, share).draw(style)
    }

    /// The attempt, if there is one, and what else its rehearsals need.
    pub fn parts(&mut self) -> Option<(&mut Attempt, Memory<'_>)> {
        let Self { attempt, last, memory, noise, prepared } = self;
        attempt.as_mut().map(|attempt| (attempt, Memory { last, memory, noise, prepared }))
    }
}

/// What an agent remembers beside its attempt.
#[derive(Debug)]
pub(crate) struct Memory<'a> {
    pub last: &'a LastDecision,
    pub memory: &'a mut Vec<f32>,
    pub noise: &'a mut Option<NoiseStream>,
    pub prepared: &'a mut Option<(Style, Npc)>,
}

/// The NPC on the map for which an agent stands whose scene has its origin at `origin` there, m.
pub(crate) fn npc_of(
    state: &AgentState,
    origin: Vec3,
    (episode, last): (&Episode, &LastDecision),
    profile: &CharacterProfile,
) -> Npc {
    let mut body = body_of(state);
    body.feet += origin;
    body.air_jumps_left =
        if state.is_grounded { profile.extra_jumps } else { profile.extra_jumps.min(state.can_jump.into()) };
    let mut episode = *episode;
    episode.goal += origin;
    Npc { last: *last, ..Npc::outside(body, episode) }
}

/// The body of which an observation tells.
pub(crate) fn body_of(state: &AgentState) -> Body {
    let mut body = Body::at(state.feet, state.yaw);
    body.velocity = state.velocity;
    body.support = if state.is_grounded { Support::Ground } else { Support::Air };
    body.air_jumps_left = state.can_jump.into();
    body.ticks_in_air = if state.is_grounded { 0 } else { u8::MAX };
    body.ride = state.rides.then_some(Ride { line_idx: 0, distance: 0.0 });
    body.fuel = state.fuel;
    body
}
