//! What an agent wants and remembers.

use crate::agent::AgentState;
use crate::graph::SurefootGraph;
use bevy_ecs::prelude::*;
use bevy_math::Vec3;
use surefoot_policy::noise::of_action;
use surefoot_rollout::{FollowConfig, Follower};
use surefoot_world::character::{ACTION_LEN, Ride, Support};
use surefoot_world::sense::LastDecision;
use surefoot_world::{Body, Episode};

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
    /// Whether the agent has decided in this attempt since it heads for its waypoint.
    pub has_decided: bool,
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
        Self { goal, episode: Episode::new(goal, feet), route, has_reached: false, has_decided: false }
    }

    pub fn head_for(&mut self, waypoint: Vec3, feet: Vec3) {
        (self.episode, self.has_decided) = (Episode::new(waypoint, feet), false);
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
