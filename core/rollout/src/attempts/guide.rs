//! Plans and rehearsals of NPCs whose attempts run together.

use super::walker::Walker;
use crate::attempt::{AfterRehearsal, Attempt};
use crate::decision::DecisionLoop;
use crate::follow::scene::Scene;
use crate::follow::{Follower, Step};
use crate::rehearse::Rehearsal;
use std::time::Instant;
use surefoot_planner::{EdgeCosts, Router, Traffic};
use surefoot_policy::Policy;
use surefoot_world::{End, Vec3, World};

/// How long the parts of guiding NPCs took.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GuideTimes {
    /// Duration of every search, us.
    pub search_us: Vec<f64>,
    /// Duration of all reviews of plans, with the searches that they asked for, s.
    pub review_s: f64,
    /// Duration of all rehearsals, s.
    pub rehearsal_s: f64,
}

/// Plans for NPCs, and rehearses their plans.
pub(super) struct Guide<'a> {
    pub router: &'a Router,
    pub policy: &'a Policy,
    pub rehearsal: Rehearsal,
    pub rehearses: bool,
    /// Predicted places of the NPCs; `None` if they do not get in each other's way.
    pub traffic: Option<Traffic>,
    pub times: &'a mut GuideTimes,
}

impl Guide<'_> {
    /// Begins the attempt of an NPC with its first plan.
    pub fn begin(&mut self, world: &mut World, walker: &mut Walker) {
        self.plan(world, walker, walker.measured.feet);
        let Walker { attempt, measured, .. } = walker;
        measured.record_first_plan(&attempt_of(attempt).follower);
    }

    /// Prepares the next decision of all NPCs.
    pub fn prepare(&mut self, world: &mut World, walkers: &mut [Walker], decisions: &DecisionLoop) {
        self.count_traffic(walkers);
        if !world.movers().is_empty() {
            walkers.iter_mut().for_each(|walker| self.watch_movers(world, walker));
        }
        if self.rehearses {
            self.rehearse(world, walkers, decisions);
        }
    }

    fn count_traffic(&mut self, walkers: &[Walker]) {
        let Some(traffic) = &mut self.traffic else { return };
        *traffic = Traffic::default();
        for walker in walkers.iter().filter(|walker| walker.measured.end.is_none()) {
            if let Some(follower) = walker.follower() {
                follower.add_to(traffic, walker.measured.feet);
            }
        }
    }

    /// Processes one decision of an NPC. `leg_end` is how the way to the current waypoint ended, if it did.
    pub fn follow(&mut self, world: &mut World, walker: &mut Walker, leg_end: Option<End>) {
        let slot = walker.deciding.slot;
        let body = world.npc(slot).expect("a running NPC").body;
        let attempt = attempt_of(&mut walker.attempt);
        let is_as_forecast = attempt.check_forecast(&body);
        let mut step = attempt.follower.record_decision(body.feet, leg_end);
        let is_pushed = world.config().npc_collision && !is_as_forecast && body.is_grounded();
        if is_pushed && matches!(step, Step::Keep | Step::HeadFor(_)) {
            let waypoint = attempt.follower.return_to_way(world.map(), &world.config().profiles[0], body.feet);
            step = waypoint.map_or(step, Step::HeadFor);
        }
        match step {
            Step::Keep => {}
            Step::HeadFor(waypoint) => {
                attempt.extend_forecast();
                world.head_for(slot, waypoint, attempt.follower.arrival());
            }
            Step::Plan => self.plan(world, walker, body.feet),
            // The target may get away again.
            Step::End(End::Reached) if walker.keeps => {}
            Step::End(end) => walker.measured.end = Some(end),
        }
    }

    /// Lets an NPC follow its goal, m: it heads for the new place on the last leg of its plan, and plans again once the
    /// goal has moved far.
    pub fn follow_goal(&mut self, world: &mut World, walker: &mut Walker, goal: Vec3) {
        let slot = walker.deciding.slot;
        let npc = world.npc(slot).expect("a running NPC");
        let (body, has_arrived) = (npc.body, npc.episode.and_then(|episode| episode.end) == Some(End::Reached));
        let attempt = attempt_of(&mut walker.attempt);
        if let Some(waypoint) = attempt.follow_goal(goal, body.feet, has_arrived) {
            world.head_for(slot, waypoint, attempt.follower.arrival());
        }
        // An NPC in the air cannot turn back.
        if attempt.follower.has_goal_drifted(body.feet) && body.is_grounded() {
            self.plan(world, walker, body.feet);
        }
    }

    /// Plans for an NPC from `feet`, m; it heads for the first waypoint.
    pub fn plan(&mut self, world: &mut World, walker: &mut Walker, feet: Vec3) {
        let Self { router, traffic, times, .. } = self;
        let waypoint = attempt_of(&mut walker.attempt).plan(feet, |query| {
            let started = Instant::now();
            let plan = match traffic {
                Some(traffic) => router.find_path_in(traffic, query, &EdgeCosts::new()),
                None => router.find_path(query),
            };
            times.search_us.push(started.elapsed().as_secs_f64() * 1.0e6);
            plan
        });
        let arrival = attempt_of(&mut walker.attempt).follower.arrival();
        world.head_for(walker.deciding.slot, waypoint, arrival);
    }

    /// Reviews a new plan of an NPC, and makes the further ones that the review asks for.
    fn review(&mut self, world: &mut World, walker: &mut Walker) {
        loop {
            let npc = world.npc(walker.deciding.slot).expect("a running NPC");
            let (feet, attempt) = (npc.body.feet, attempt_of(&mut walker.attempt));
            if !attempt.review(world.map(), world.profile_of(npc), &npc.body, |_, _| true) {
                return;
            }
            self.plan(world, walker, feet);
        }
    }

    /// Lets an NPC watch the movers, call those that it needs, and plan again if they bar its plan.
    fn watch_movers(&mut self, world: &mut World, walker: &mut Walker) {
        if !walker.acts() {
            return;
        }
        let body = world.npc(walker.deciding.slot).expect("a running NPC").body;
        let watch = |world: &World, attempt: &mut Attempt| {
            let scene = Scene { map: world.map(), states: world.movers() };
            attempt.follower.watch_movers(scene, body.feet, body.is_grounded());
        };
        let attempt = attempt_of(&mut walker.attempt);
        watch(world, attempt);
        if attempt.follower.has_used_up_replans() {
            walker.measured.end = Some(End::NoProgress);
            return;
        }
        if attempt.follower.waypoint().is_none() && !attempt.follower.is_barred() {
            self.plan(world, walker, body.feet);
            watch(world, attempt_of(&mut walker.attempt));
        }
        if let Some(call) = walker.follower().and_then(Follower::call) {
            world.call(call);
        }
    }

    /// Rehearses the next legs of all NPCs that are due, until nothing goes wrong any more.
    fn rehearse(&mut self, world: &mut World, walkers: &mut [Walker], decisions: &DecisionLoop) {
        let hidden_len = self.policy.memory_len();
        let started = Instant::now();
        for walker in walkers.iter_mut().filter(|walker| walker.acts()) {
            self.review(world, walker);
            let npc = world.npc(walker.deciding.slot).expect("a running NPC");
            attempt_of(&mut walker.attempt).skip_plain_rehearsal(world.map(), world.profile_of(npc), &npc.body);
        }
        self.times.review_s += started.elapsed().as_secs_f64();
        let is_due = |walker: &Walker| walker.acts() && walker.attempt.as_ref().is_some_and(Attempt::is_due);
        let mut due: Vec<usize> = (0..walkers.len()).filter(|idx| is_due(&walkers[*idx])).collect();
        due.iter().for_each(|idx| attempt_of(&mut walkers[*idx].attempt).begin_rehearsals());
        let rehearsed = due.clone();
        while !due.is_empty() {
            let starts = due.iter().map(|idx| {
                let Walker { deciding, attempt, noise, .. } = &mut walkers[*idx];
                let npc = *world.npc(deciding.slot).expect("a running NPC");
                let hidden = decisions.hidden()[deciding.row_idx * hidden_len..][..hidden_len].to_vec();
                attempt_of(attempt).rehearsal(npc, hidden, *noise)
            });
            let starts = starts.collect();
            let started = Instant::now();
            let mut results = self.rehearsal.run(self.policy, starts, world.movers()).into_iter();
            self.times.rehearsal_s += started.elapsed().as_secs_f64();
            due.retain(|idx| {
                let walker = &mut walkers[*idx];
                let result = results.next().expect("a result for each rehearsal");
                match attempt_of(&mut walker.attempt).record_rehearsal(result, &mut walker.noise) {
                    AfterRehearsal::Act => false,
                    AfterRehearsal::Rehearse => true,
                    AfterRehearsal::Plan => {
                        let feet = world.npc(walker.deciding.slot).expect("a running NPC").body.feet;
                        self.plan(world, walker, feet);
                        self.review(world, walker);
                        true
                    }
                    AfterRehearsal::End => {
                        walker.measured.end = Some(End::Unreachable);
                        false
                    }
                }
            });
        }
        for idx in rehearsed {
            let Walker { deciding, attempt, .. } = &mut walkers[idx];
            let attempt = attempt_of(attempt);
            let npc = world.npc(deciding.slot).expect("a running NPC");
            if let Some(waypoint) = attempt.changed_waypoint(npc) {
                world.head_for(deciding.slot, waypoint, attempt.follower.arrival());
            }
        }
    }
}

/// The attempt of an NPC with a guide.
fn attempt_of(attempt: &mut Option<Attempt>) -> &mut Attempt {
    attempt.as_mut().expect("NPCs with a guide follow plans")
}
