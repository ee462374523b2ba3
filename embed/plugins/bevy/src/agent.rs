//! The components through which an app and its agents talk.

use crate::mind::Mind;
use crate::motion::AgentLocomotion;
use bevy_ecs::prelude::*;
use bevy_math::Vec3;
use std::fmt;
use surefoot_planner::{AbilitySet, Caution, NoPath, Plan};
use surefoot_rollout::DEFAULT_NOISE_SHARE;
use surefoot_world::arrival::{LINE_COUNT, Line};
use surefoot_world::mesh::Surface;
use surefoot_world::sense::RAY_COUNT;
use surefoot_world::{Ability, Action, CharacterProfile};

/// A character that the policy moves.
#[derive(Component, Debug, Clone)]
#[require(AgentState, AgentAction, AgentPlan, AgentLocomotion, Sight, GoalSight, Mind)]
pub struct SurefootAgent {
    /// Its body; a graph is proved for one.
    pub body: CharacterProfile,
    /// How much plans do to avoid that it dies.
    pub caution: Caution,
    /// Abilities that plans do without: zip lines and jetpacks by default, which take a controller of the app's own.
    pub without: AbilitySet,
    /// Share of the policy's exploration noise, 0 to 1. Noise frees agents from places where the most likely action
    /// runs in circles.
    pub noise_share: f32,
    /// Where its randomness comes from; the entity's index is mixed in.
    pub seed: u64,
}

impl Default for SurefootAgent {
    fn default() -> Self {
        Self {
            body: CharacterProfile::default(),
            caution: Caution::CAREFUL,
            without: [Ability::ZIP_LINE, Ability::JETPACK, Ability::CLIMB].into_iter().collect(),
            noise_share: DEFAULT_NOISE_SHARE,
            seed: 0,
        }
    }
}

impl SurefootAgent {
    /// Seed of the noise of the agent `agent`.
    pub(crate) fn seed_of(&self, agent: Entity) -> u64 {
        self.seed ^ agent.to_bits()
    }
}

/// Where an agent is to go: the place for its feet, m. Inserting or changing it begins an attempt; removing it ends the
/// attempt. Near the goal of an attempt under way, within 4 m or a quarter of the agent's distance, a change moves that
/// goal, and the plan stays until the goal has drifted far. So a target that moves may be written in every tick.
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct Goal(pub Vec3);

/// Distance from its goal within which an agent must stand, m; 1 m without this component.
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct GoalRadius(pub f32);

/// The state of an agent's body. The controller writes it in
/// [`SurefootSystems::Sense`](crate::SurefootSystems::Sense).
#[derive(Component, Debug, Clone, Copy, PartialEq, Default)]
pub struct AgentState {
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
    /// Whether it rides a zip line.
    pub rides: bool,
    /// Seconds of jetpack thrust left.
    pub fuel: f32,
    /// Whether it is in water.
    pub is_in_water: bool,
}

impl AgentState {
    pub(crate) fn is_finite(&self) -> bool {
        self.feet.is_finite() && self.velocity.is_finite() && self.yaw.is_finite() && self.fuel.is_finite()
    }
}

/// What an agent does until it decides again, 1/6 s later. The controller carries it out. It is all zeros without an
/// attempt.
#[derive(Component, Debug, Clone, Copy, PartialEq, Default)]
pub struct AgentAction {
    /// Forward and strafe (positive to the right) as shares of the top speed; turn (positive as yaw grows) as a share
    /// of the turning speed; a jump if above 0.
    pub action: Action,
    /// Whether this tick is the first of the decision. If `action.jump` is above 0, the agent jumps once during the
    /// decision, as soon as it can.
    pub is_first: bool,
}

/// Which rays an agent needs before it decides, and what they hit. A back end fills it in
/// [`SurefootSystems::Look`](crate::SurefootSystems::Look).
#[derive(Component, Debug, Clone)]
pub struct Sight {
    /// Whether the agent decides in this tick; the rest is out of date otherwise.
    pub is_wanted: bool,
    /// Where all rays begin, m.
    pub origin: Vec3,
    /// Unit directions. Rays are [`RAY_RANGE_M`](crate::RAY_RANGE_M) long and pass through all agents.
    pub directions: [Vec3; RAY_COUNT],
    /// To be written: the distance, m, of what each ray hit, and its surface.
    pub hits: [Option<(f32, Surface)>; RAY_COUNT],
}

impl Default for Sight {
    fn default() -> Self {
        let directions = [Vec3::Z; RAY_COUNT];
        Self { is_wanted: false, origin: Vec3::ZERO, directions, hits: [None; RAY_COUNT] }
    }
}

/// The lines between an agent and its goal, where nothing solid may lie. A back end checks them in
/// [`SurefootSystems::Look`](crate::SurefootSystems::Look); without one, agents arrive also behind walls.
#[derive(Component, Debug, Clone, Default)]
pub struct GoalSight {
    /// To be checked in this tick, with rays that pass through all agents and sensors; `None` while the agent is not
    /// near its goal, or in the air.
    pub lines: Option<[Line; LINE_COUNT]>,
    /// To be written: whether a ray met a solid surface within the length of its line.
    pub is_blocked: bool,
}

/// How an agent gets on.
#[derive(Component, Debug, Clone, Default)]
pub struct AgentPlan {
    /// What it is doing.
    pub status: AgentStatus,
    /// Where it heads for now, m; `None` without an attempt.
    pub waypoint: Option<Vec3>,
    /// The plan that it follows, in the coordinates of the scene; `None` without a graph.
    pub plan: Option<Plan>,
    /// Index of the current leg.
    pub leg: usize,
    /// Plans made in this attempt.
    pub plan_count: u32,
}

/// What an agent is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AgentStatus {
    /// It has no goal.
    #[default]
    Idle,
    /// It heads straight for its goal, without a graph.
    Heading,
    /// It follows a plan to its goal.
    Following,
    /// It follows a plan to the place nearest to its goal, to which no path leads.
    Nearing(NoPath),
    /// It stands near its goal, with nothing solid between.
    Reached,
    /// It has ended its attempt elsewhere.
    Failed(Failure),
}

/// Why an attempt failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Failure {
    /// No path leads to the goal; the agent is as near as paths lead. Without a reason, every path there was tried.
    Unreachable(Option<NoPath>),
    /// Its patience or its plans ran out.
    GaveUp,
    /// Without a graph: it came no nearer for 300 decisions (50 s).
    NoProgress,
    /// The app said that it died.
    Died,
    /// The graph was proved for another body than [`SurefootAgent::body`].
    OtherBody,
    /// The goal has a coordinate that is not a finite number.
    BadGoal,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unreachable(Some(NoPath::StartOffGraph)) => {
                "unreachable: no vertex of the graph is near the agent; \
                 is it the graph of this level, with its origin set?"
            }
            Self::Unreachable(Some(NoPath::GoalOffGraph)) => {
                "unreachable: no vertex of the graph that can be reached is near the goal"
            }
            Self::Unreachable(Some(NoPath::DifferentIslands)) => {
                "unreachable: no path joins the islands of start and goal"
            }
            Self::Unreachable(Some(NoPath::OneWay)) => {
                "unreachable: paths lead from the goal to the agent, but none leads there"
            }
            Self::Unreachable(Some(NoPath::GoalInZone)) => "unreachable: the goal is in a zone that is closed",
            Self::Unreachable(None) => "unreachable: every path to the goal was tried",
            Self::GaveUp => "gave up: its patience or its plans ran out",
            Self::NoProgress => "no progress: give the agent a graph for goals that are further away",
            Self::Died => "died",
            Self::OtherBody => {
                "the graph was proved for another body: export it with --body and the values of SurefootAgent::body"
            }
            Self::BadGoal => "the goal has a coordinate that is not a finite number",
        })
    }
}
