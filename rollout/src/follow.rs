//! Follows a plan waypoint by waypoint and asks for another when a leg does not work out.
//!
//! Pure state: it neither senses nor searches. Workers feed it from the network, evaluation from a world.

use serde::{Deserialize, Serialize};
use surefoot_planner::live::Traversal;
use surefoot_planner::{LegKey, Plan, Query};
use surefoot_world::Vec3;

/// Constants of plan following.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FollowConfig {
    /// Decisions without coming closer to the waypoint until a re-plan (paper: 50).
    pub replan_after: u32,
    /// Decisions without any progress until the attempt is given up (paper: 300).
    pub patience: u32,
    /// Re-plans until the attempt is given up.
    pub max_replans: u32,
}

impl Default for FollowConfig {
    fn default() -> Self {
        Self { replan_after: 50, patience: 300, max_replans: 16 }
    }
}

/// What to do next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// Keep heading for the same waypoint.
    Keep,
    /// Head for this point from now on, m.
    Head(Vec3),
    /// Ask for a plan with [`Follower::query`] and hand it to [`Follower::take_plan`].
    Plan,
    /// Nothing works any more.
    GiveUp,
}

/// What an attempt that failed was doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// The graph knew no path, so it headed straight for the goal.
    Unreachable,
    /// It was on the unproved leg to the first vertex or from the last.
    Attachment,
    /// It had just turned to another waypoint.
    WaypointSwitch,
    /// It was on a proved edge.
    Edge,
    /// It came to no harm, but ran out of patience or re-plans.
    Timeout,
}

impl Fault {
    /// All faults, in a fixed order.
    pub const ALL: [Fault; 5] =
        [Fault::Unreachable, Fault::Attachment, Fault::WaypointSwitch, Fault::Edge, Fault::Timeout];

    /// Lower-case name as used in reports.
    pub fn name(self) -> &'static str {
        match self {
            Fault::Unreachable => "unreachable",
            Fault::Attachment => "attachment",
            Fault::WaypointSwitch => "waypoint_switch",
            Fault::Edge => "edge",
            Fault::Timeout => "timeout",
        }
    }
}

/// One NPC's way to one goal.
#[derive(Debug, Clone)]
pub struct Follower {
    config: FollowConfig,
    goal: Vec3,
    plan: Option<Plan>,
    leg: usize,
    /// Smallest distance to the current waypoint, m.
    best_leg_distance: f32,
    /// Smallest distance to the goal, m.
    best_goal_distance: f32,
    stalled_on_leg: u32,
    stalled: u32,
    replans: u32,
    failed_legs: Vec<LegKey>,
    decisions_on_leg: u32,
    traversals: Vec<Traversal>,
}

/// Decisions after a waypoint within which harm is laid to the turn towards the next.
const SWITCH_DECISIONS: u32 = 3;
/// Failed legs remembered per attempt; the oldest is forgotten first.
const MAX_FAILED_LEGS: usize = 12;

impl Follower {
    /// An attempt at `goal` that has no plan yet.
    pub fn new(goal: Vec3, config: FollowConfig) -> Self {
        Self {
            config,
            goal,
            plan: None,
            leg: 0,
            best_leg_distance: f32::INFINITY,
            best_goal_distance: f32::INFINITY,
            stalled_on_leg: 0,
            stalled: 0,
            replans: 0,
            failed_legs: Vec::new(),
            decisions_on_leg: 0,
            traversals: Vec::new(),
        }
    }

    /// Takes the traversals along proved edges that ended since the last call.
    pub fn take_traversals(&mut self) -> Vec<Traversal> {
        std::mem::take(&mut self.traversals)
    }

    /// Notes that the NPC came to harm, which ends its attempt.
    pub fn note_harm(&mut self) {
        self.end_leg(false);
    }

    /// What the attempt was doing, should it have failed just now; by harm or by running out of patience.
    pub fn fault(&self, by_harm: bool) -> Fault {
        let Some(plan) = &self.plan else { return Fault::Timeout };
        let leg = plan.legs[self.leg];
        if plan.no_path.is_some() {
            Fault::Unreachable
        } else if !by_harm {
            Fault::Timeout
        } else if self.decisions_on_leg <= SWITCH_DECISIONS && self.leg > 0 {
            Fault::WaypointSwitch
        } else if leg.key.edge().is_none() {
            Fault::Attachment
        } else {
            Fault::Edge
        }
    }

    fn end_leg(&mut self, reached: bool) {
        let Some(plan) = &self.plan else { return };
        if let Some(edge) = plan.legs[self.leg].key.edge() {
            self.traversals.push(Traversal { edge, reached, decisions: self.decisions_on_leg });
        }
    }

    /// The point to head for, once there is a plan, m.
    pub fn waypoint(&self) -> Option<Vec3> {
        self.plan.as_ref().map(|plan| plan.waypoints[self.leg])
    }

    /// Whether the current waypoint is the goal itself.
    pub fn is_last_leg(&self) -> bool {
        self.plan.as_ref().is_some_and(|plan| self.leg + 1 == plan.waypoints.len())
    }

    /// Plans asked for beyond the first.
    pub fn replans(&self) -> u32 {
        self.replans
    }

    /// The query to ask a planner from `feet`.
    pub fn query(&self, feet: Vec3) -> Query {
        Query { start: feet, goal: self.goal, avoid: self.failed_legs.clone() }
    }

    /// Starts on a plan; returns its first waypoint.
    pub fn take_plan(&mut self, plan: Plan) -> Vec3 {
        let first = plan.waypoints[0];
        self.plan = Some(plan);
        self.start_leg(0);
        first
    }

    /// Forgets the plan, because the graph is no longer what it was made on; the leg does not count as failed.
    pub fn forget_plan(&mut self) {
        self.plan = None;
    }

    fn start_leg(&mut self, leg: usize) {
        self.leg = leg;
        self.best_leg_distance = f32::INFINITY;
        self.stalled_on_leg = 0;
        self.decisions_on_leg = 0;
    }

    /// Takes note of one decision: where the feet are and whether the waypoint was touched during it.
    pub fn note(&mut self, feet: Vec3, waypoint_reached: bool) -> Step {
        let Some(plan) = &self.plan else { return Step::Plan };
        let goal_distance = feet.distance(self.goal);
        self.stalled += 1;
        self.stalled_on_leg += 1;
        self.decisions_on_leg += 1;
        if goal_distance < self.best_goal_distance {
            self.best_goal_distance = goal_distance;
            self.stalled = 0;
        }
        let last_leg = plan.waypoints.len() - 1;
        if waypoint_reached && self.leg < last_leg {
            let next = plan.waypoints[self.leg + 1];
            self.end_leg(true);
            self.start_leg(self.leg + 1);
            self.stalled = 0;
            return Step::Head(next);
        }
        let leg_distance = feet.distance(plan.waypoints[self.leg]);
        if leg_distance < self.best_leg_distance {
            self.best_leg_distance = leg_distance;
            self.stalled_on_leg = 0;
        }
        if self.stalled >= self.config.patience {
            return Step::GiveUp;
        }
        if self.stalled_on_leg < self.config.replan_after {
            return Step::Keep;
        }
        if self.replans >= self.config.max_replans {
            return Step::GiveUp;
        }
        let failed = plan.legs[self.leg];
        self.end_leg(false);
        self.failed_legs.push(failed.key);
        if self.failed_legs.len() > MAX_FAILED_LEGS {
            self.failed_legs.remove(0);
        }
        self.replans += 1;
        self.plan = None;
        Step::Plan
    }
}
