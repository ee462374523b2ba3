//! What a follower asks of a planner, and how it takes the answers.

use super::review::Review;
use super::scene::MoverResponse;
use super::{Approach, Follower};
use surefoot_planner::{Plan, Query};
use surefoot_world::{Ability, Vec3};

/// How far a goal moves before the NPC heads for its new place, and before another plan is made: in metres, and as a
/// share of the NPC's distance from it.
const AIM_M: f32 = 0.5;
const AIM_SHARE: f32 = 0.15;
const DRIFT_M: f32 = 1.0;
const DRIFT_SHARE: f32 = 0.25;

impl Follower {
    /// The query for a plan from `feet`, m, that avoids the failed legs, and jumps if the gait does.
    pub fn query(&mut self, feet: Vec3) -> Query {
        self.planned_goal = self.goal;
        let avoid = [self.failures.keys(), self.review.leaps.clone()].concat();
        let stops = self.movers.stops.clone();
        let without = Ability::JUMPS.into_iter().filter(|_| self.excludes_jumps()).collect();
        Query { avoid, stops, without, attach: self.config.attach, ..Query::new(feet, self.goal) }
    }

    /// Whether to plan again instead of taking `plan`, which leads elsewhere than to the goal: with jumps that the NPC
    /// avoids, or with legs without progress, which get another chance, since other noise may help.
    pub fn reconsiders(&mut self, plan: &Plan) -> bool {
        let is_open = plan.no_path.is_some() && !self.review.is_under_way();
        self.reconsiders_jumps(plan) || is_open && self.failures.give_another_chance()
    }

    /// Whether to plan again, with jumps, instead of taking `plan`, which leads elsewhere than to the goal.
    pub fn reconsiders_jumps(&mut self, plan: &Plan) -> bool {
        let was_excluded = plan.no_path.is_some() && !self.review.is_under_way() && self.excludes_jumps();
        self.accepts_jumps |= was_excluded;
        was_excluded
    }

    /// Whether plans must not use jumps.
    fn excludes_jumps(&self) -> bool {
        self.config.gait.avoids_jumps && !self.accepts_jumps && !self.review.jumps()
    }

    /// Plans from `feet`, m, with `search`, starts to follow the plan, and returns its first waypoint, m.
    pub fn plan(&mut self, feet: Vec3, mut search: impl FnMut(&Query) -> Plan) -> Vec3 {
        loop {
            let plan = search(&self.query(feet));
            if !self.reconsiders(&plan) {
                return self.take_plan(plan);
            }
        }
    }

    /// Starts to follow a plan and returns its first waypoint, m.
    pub fn take_plan(&mut self, mut plan: Plan) -> Vec3 {
        // The goal may have moved since the plan was requested.
        self.lead_to_goal(&mut plan);
        let first = plan.waypoints[0];
        self.plan = Some(plan);
        self.accepts_jumps = false;
        if !self.review.is_under_way() {
            self.plans = self.plans.saturating_add(1);
            self.review = Review::default();
        }
        (self.free_until, self.unsteered_until, self.exact_until) = (0, 0, 0);
        self.from_rest.clear();
        self.doubtful.clear();
        (self.shortcuts, self.clearance, self.steered_moves) = Default::default();
        self.start_leg(0);
        first
    }

    /// Lets a plan that leads to the goal end where the goal is now.
    pub(super) fn lead_to_goal(&self, plan: &mut Plan) {
        if let Some(last) = plan.waypoints.last_mut().filter(|_| plan.nearest.is_none()) {
            *last = self.goal;
        }
    }

    /// The goal, m.
    pub fn goal(&self) -> Vec3 {
        self.goal
    }

    /// Moves the goal of an NPC at `feet`, m. The plan stays, and its last leg leads to the new goal. Returns the
    /// waypoint, m, if it has changed; small changes wait until they matter, or until the NPC `has_arrived`.
    pub fn move_goal(&mut self, goal: Vec3, feet: Vec3, has_arrived: bool) -> Option<Vec3> {
        if goal != self.goal {
            self.goal = goal;
            // A target that runs away is no want of progress, but an NPC that stands still is.
            let moves = feet.distance(self.moved_from) >= AIM_M;
            let stalled = if moves { 0 } else { self.to_goal.stalled };
            self.to_goal = Approach { best_m: feet.distance(goal), stalled };
            if moves {
                (self.moved_from, self.replans) = (feet, 0);
            }
        }
        let plan = self.plan.as_mut().filter(|plan| plan.nearest.is_none())?;
        let last = plan.waypoints.last_mut()?;
        let slack = if has_arrived { 0.0 } else { AIM_M.max(AIM_SHARE * feet.distance(goal)) };
        if last.distance(goal) <= slack {
            return None;
        }
        *last = goal;
        plan.legs.last().into_iter().for_each(|leg| self.steered_moves.forget(leg.key));
        if !self.is_last_leg() {
            return None;
        }
        self.to_waypoint = Approach { best_m: feet.distance(goal), stalled: self.to_goal.stalled };
        Some(goal)
    }

    /// Whether the goal has moved so far since the plan was made that an NPC at `feet`, m, needs another.
    pub fn has_goal_drifted(&self, feet: Vec3) -> bool {
        let slack = DRIFT_M.max(DRIFT_SHARE * feet.distance(self.goal));
        self.plan.is_some() && self.planned_goal.distance(self.goal) > slack
    }

    /// Drops the plan because its graph has changed; the leg does not count as failed.
    pub fn drop_plan(&mut self) {
        self.plan = None;
        self.detour.end();
        self.movers.response = MoverResponse::Go;
    }
}
