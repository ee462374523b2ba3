//! Followers: attempts of NPCs at goals by plan, with the rules of the server's NPCs.

use crate::abi;
use crate::error::{Fault, Status};
use crate::graphs::{self, Graph};
use surefoot_planner::evidence::TryEnd;
use surefoot_planner::{AbilitySet, Caution, Plan, Query};
use surefoot_rollout::follow;
use surefoot_rollout::{FollowConfig, Follower as Rules};
use surefoot_world::Vec3;

/// `sf_follower`: an attempt at a goal.
#[derive(Debug)]
pub struct Follower {
    rules: Rules,
    /// The plan that is followed.
    plan: Option<Plan>,
    /// Traversals that the caller has not taken.
    traversals: Vec<abi::Traversal>,
    /// How the attempt ended; it then stays so.
    end: Option<follow::Step>,
}

impl Follower {
    /// Begins an attempt at `goal`, m.
    pub fn new(goal: Vec3) -> Self {
        let config = FollowConfig { composes: false, ..FollowConfig::default() };
        Self { rules: Rules::new(goal, config), plan: None, traversals: Vec::new(), end: None }
    }

    /// Takes note of a decision: where the feet are, m, and whether the NPC came to its waypoint meanwhile.
    pub fn advance(&mut self, feet: Vec3, reached: bool) -> abi::Step {
        let step = self.end.unwrap_or_else(|| self.rules.note(feet, reached));
        self.collect();
        if matches!(step, follow::Step::GiveUp | follow::Step::Unreachable) {
            self.end = Some(step);
        }
        if step == follow::Step::Plan {
            self.plan = None;
        }
        self.step(step)
    }

    /// Plans from `feet`, m, and follows that plan.
    pub fn plan(
        &mut self,
        graph: &Graph,
        feet: Vec3,
        caution: Caution,
        without: AbilitySet,
    ) -> Result<abi::Step, Fault> {
        if let Some(end) = self.end {
            return Ok(self.step(end));
        }
        self.rules.forget_plan();
        loop {
            let query = Query { caution, without, ..self.rules.query(feet) };
            let plan = graph.find(&query);
            if !self.rules.reconsiders(&plan) {
                self.plan = Some(plan.clone());
                let waypoint = self.rules.take_plan(plan);
                return Ok(self.step(follow::Step::Head(waypoint)));
            }
        }
    }

    /// Takes note that the NPC died.
    pub fn note_harm(&mut self) {
        if self.end.is_none() {
            self.rules.note_harm();
            self.collect();
            self.end = Some(follow::Step::GiveUp);
        }
    }

    /// The legs of the plan that is followed.
    pub fn legs(&self) -> Result<Vec<abi::Leg>, Fault> {
        let missing = || Fault::new(Status::BadState, "the follower has no plan: call sf_follower_plan first");
        self.plan.as_ref().map(|plan| graphs::legs(plan).collect()).ok_or_else(missing)
    }

    /// Traversals that have not been taken.
    pub fn traversals(&self) -> &[abi::Traversal] {
        &self.traversals
    }

    /// Forgets the first traversals, which were taken.
    pub fn forget_traversals(&mut self) {
        self.traversals.clear();
    }

    fn collect(&mut self) {
        self.traversals.extend(self.rules.take_traversals().into_iter().map(|traversal| abi::Traversal {
            key: abi::LegKey { from: traversal.edge.from.0, to: traversal.edge.to.0 },
            decisions: traversal.decisions,
            end: match traversal.end {
                TryEnd::Arrived => 0,
                TryEnd::Failed => 1,
                TryEnd::Died => 2,
            },
        }));
    }

    fn step(&self, step: follow::Step) -> abi::Step {
        let kind = match step {
            follow::Step::Keep => 0,
            follow::Step::Head(_) => 1,
            follow::Step::Plan => 2,
            follow::Step::GiveUp => 3,
            follow::Step::Unreachable => 4,
        };
        abi::Step {
            struct_size: 0,
            kind,
            waypoint: self.rules.waypoint().unwrap_or_default().into(),
            leg: self.plan.as_ref().map_or(0, |_| self.rules.leg_idx() as u32),
            leg_count: self.plan.as_ref().map_or(0, |plan| plan.legs.len() as u32),
            plans: self.rules.plans(),
        }
    }
}
