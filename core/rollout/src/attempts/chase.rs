//! NPCs that keep to goals which move, as in a world server.

use super::guide::GuideTimes;
use super::run::{Rollout, Run};
use super::walker::Walker;
use crate::attempt::Attempt;
use crate::follow::Follower;
use crate::goals::Goal;
use crate::motion::Motion;
use surefoot_planner::Router;
use surefoot_policy::Policy;
use surefoot_world::arrival::{KEEP_SLACK_M, RETRY_TICKS};
use surefoot_world::{Action, Arrival, End, Gait, TICKS_PER_DECISION, Vec3, World};

/// Decisions from an attempt that did not reach the goal to the next one.
const RETRY_DECISIONS: u32 = RETRY_TICKS as u32 / TICKS_PER_DECISION;

/// A chase: NPCs follow goals that move, and stand while they are there.
#[derive(Debug)]
pub struct Chase<'a> {
    /// How NPCs move and plan.
    pub rollout: &'a Rollout,
    /// What NPCs decide with.
    pub policy: &'a Policy,
    /// Plans.
    pub router: &'a Router,
    /// Distance from the goal within which an NPC stands, m.
    pub radius: f32,
    /// Length of the chase, decisions.
    pub decisions: u32,
}

/// The result of a chase.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chased {
    /// How each NPC came to harm, if it did.
    pub harm: Vec<Option<End>>,
    /// Decisions that NPCs took; while they stand at their goals, they take none.
    pub decided: u64,
}

/// What an NPC of a chase is to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Errand {
    /// Its goal, m.
    pub goal: Vec3,
    /// Whether it stands where it is.
    pub waits: bool,
    /// How it goes.
    pub gait: Gait,
}

impl Chase<'_> {
    /// Runs the chase. `before_each_decision` gets the world, the number of the decision, and the errand of each NPC,
    /// which it may change; slots of NPCs are in the order of `starts`.
    pub fn run(&self, starts: &[Goal], mut before_each_decision: impl FnMut(&mut World, u32, &mut [Errand])) -> Chased {
        let mut run = Run::prepare(self.rollout, self.policy);
        let mut errands: Vec<Errand> =
            starts.iter().map(|start| Errand { goal: start.goal, waits: false, gait: Gait::default() }).collect();
        before_each_decision(&mut run.worlds[0], 0, &mut errands);
        let mut times = GuideTimes::default();
        run.begin(Some(self.router), starts, &mut times);
        run.walkers.iter_mut().for_each(|walker| walker.keeps = true);
        let mut retries = vec![None; starts.len()];
        let mut decided = 0;
        for decision in 1..=self.decisions {
            before_each_decision(&mut run.worlds[0], decision, &mut errands);
            for (idx, errand) in errands.iter().enumerate() {
                if may_act(&mut run.walkers[idx], &mut retries[idx], decision) {
                    self.follow(&mut run, idx, *errand);
                } else {
                    run.worlds[0].decide(run.walkers[idx].deciding.slot, Action::default());
                }
            }
            run.guide();
            let acting = run.walkers.iter().filter(|walker| walker.acts());
            let mut npcs: Vec<_> = acting.map(|walker| walker.deciding).collect();
            decided += npcs.len() as u64;
            run.decide(&mut npcs, &mut Motion::default());
        }
        let harm = run.walkers.iter().map(|walker| walker.measured.end.filter(|end| end.is_harm())).collect();
        Chased { harm, decided }
    }

    /// Lets an NPC follow its goal, or stand if it is there or waits. While the target is in the air, the goal stays.
    fn follow(&self, run: &mut Run<'_>, idx: usize, Errand { goal: place, waits, gait }: Errand) {
        let Run { worlds: [world], walkers, guide, .. } = run;
        let (walker, guide) = (&mut walkers[idx], guide.as_mut().expect("NPCs of a chase follow plans"));
        let slot = walker.deciding.slot;
        let former = walker.follower().expect("an attempt by plan").goal();
        let goal = world.footing_below(slot, place).unwrap_or(former);
        if walker.measured.end.take().is_some() {
            walker.attempt = Some(Attempt::new(Follower::new(goal, self.rollout.follow)));
            guide.begin(world, walker);
        }
        if walker.attempt.as_mut().expect("an attempt by plan").set_gait(gait) {
            guide.plan(world, walker, walker.measured.feet);
        }
        let slack = if walker.rests { KEEP_SLACK_M } else { 0.0 };
        let rests = waits || world.has_arrived(slot, goal, self.radius + slack, Arrival::Stand);
        let rested = std::mem::replace(&mut walker.rests, rests);
        if walker.rests {
            world.decide(slot, Action::default());
            return;
        }
        if rested {
            walker.attempt.as_mut().expect("an attempt by plan").forget_forecast();
        }
        walker.measured.feet = world.npc(slot).expect("a running NPC").body.feet;
        guide.follow_goal(world, walker, goal);
    }
}

/// Whether an NPC is unharmed and does not wait for its next attempt; `retry` is the decision at which that begins.
fn may_act(walker: &mut Walker, retry: &mut Option<u32>, decision: u32) -> bool {
    match walker.measured.end {
        None => {
            *retry = None;
            true
        }
        Some(end) if end.is_harm() => false,
        Some(_) => decision >= *retry.get_or_insert(decision + RETRY_DECISIONS),
    }
}
