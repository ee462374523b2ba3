//! What observers hear of: `app.add_observer(|event: On<GoalReached>| ...)`, or `.observe(...)` on one agent.

use crate::agent::Failure;
use bevy_ecs::prelude::*;
use surefoot_planner::Leg;

/// An agent stands within 1 m of its goal, or its [`GoalRadius`](crate::GoalRadius), with nothing solid between.
#[derive(EntityEvent, Debug, Clone, Copy, PartialEq)]
pub struct GoalReached {
    /// The agent.
    #[event_target]
    pub agent: Entity,
}

/// An agent has ended its attempt elsewhere.
#[derive(EntityEvent, Debug, Clone, Copy, PartialEq)]
pub struct GoalFailed {
    /// The agent.
    #[event_target]
    pub agent: Entity,
    /// Why.
    pub failure: Failure,
}

/// An agent made no progress on a leg of its plan, or died on it. Unless the attempt ends, it makes another plan.
#[derive(EntityEvent, Debug, Clone, Copy, PartialEq)]
pub struct LegFailed {
    /// The agent.
    #[event_target]
    pub agent: Entity,
    /// The leg.
    pub leg: Leg,
    /// Whether it died.
    pub died: bool,
}

/// The app triggers this when an agent dies or is moved elsewhere: its attempt ends, and its memory is cleared. A
/// [`Goal`](crate::Goal) that is inserted afterwards begins another attempt.
#[derive(EntityEvent, Debug, Clone, Copy, PartialEq, Eq)]
pub struct AgentDied {
    /// The agent.
    #[event_target]
    pub agent: Entity,
}
