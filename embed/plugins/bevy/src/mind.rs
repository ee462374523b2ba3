//! What an agent wants and remembers.

use crate::agent::{AgentPlan, AgentState};
use crate::graph::SurefootGraph;
use bevy_ecs::prelude::*;
use bevy_math::Vec3;
use surefoot_policy::noise::of_action;
use surefoot_rollout::{FollowConfig, Follower};
use surefoot_world::character::{ACTION_LEN, Ride, Support};
use surefoot_world::sense::LastDecision;
use surefoot_world::{Body, Episode};

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
    /// Actions drawn so far.
    drawn: u64,
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
    pub follower: Follower,
}

impl Attempt {
    pub fn new(goal: Vec3, feet: Vec3, graph: Option<SurefootGraph>) -> Self {
        let config = FollowConfig { composes: false, ..FollowConfig::default() };
        let route = graph.map(|graph| Route { follower: Follower::new(goal + graph.origin(), config), graph });
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
        let Some(Route { graph, follower }) = &mut self.route else {
            if goal != self.episode.goal {
                self.head_for(goal, feet);
            }
            return;
        };
        let origin = graph.origin();
        let waypoint = follower.move_goal(goal + origin, feet + origin, self.has_reached);
        let last = follower.current_plan().and_then(|plan| plan.waypoints.last());
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
        *self = Self { drawn: self.drawn, ..Self::default() };
    }

    /// Draws the noise of an action.
    pub fn draw(&mut self, seed: u64, share: f32, noise: &mut [f32; ACTION_LEN]) {
        *noise = of_action((seed, 0), self.drawn, share);
        self.drawn += 1;
    }
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
