//! Sends NPCs of a game to goals, straight or by plan, as evaluations do in simulated worlds.
//!
//! The game itself moves on from waypoint to waypoint and gets a new route only where a leg fails. Rehearsals are not
//! possible in a game, so its NPCs move freely.

use super::drive::{Deciding, Drive};
use super::link::{EnvState, Game, GameError, Level};
use std::time::Instant;
use surefoot_planner::Router;
use surefoot_policy::Policy;
use surefoot_rollout::attempts::Measured;
use surefoot_rollout::env::Route;
use surefoot_rollout::follow::Step;
use surefoot_rollout::rehearse::NoiseStream;
use surefoot_rollout::{AttemptResult, FollowConfig, Follower, Goal, Style};
use surefoot_world::{End, Episode, TaskConfig, Vec3};

/// Rules of attempts.
#[derive(Debug, Clone, Copy)]
pub struct Rules {
    /// Rules of following plans; their patience holds for NPCs that head straight for goals as well.
    pub follow: FollowConfig,
    /// Share of the policy's exploration noise with which NPCs act, 0 or more.
    pub noise_share: f32,
    /// Seed of the noise.
    pub seed: u64,
}

/// Runs one attempt for each goal, all together, following plans of `router`, if there is one. Returns the attempts in
/// the order of the goals, and the duration of every search, us.
///
/// # Errors
/// If the game refuses, does not answer, or breaks the contract.
pub fn attempt(
    game: &Game,
    level: &Level,
    policy: &Policy,
    router: Option<&Router>,
    (goals, rules): (&[Goal], Rules),
) -> Result<(Vec<AttemptResult>, Vec<f64>), GameError> {
    if goals.is_empty() {
        return Ok(Default::default());
    }
    let mut guide = router.map(|router| Guide { router, search_us: Vec::new() });
    let mut walkers: Vec<Walker> =
        (0..).zip(goals).map(|(idx, goal)| Walker::start(idx, goal, rules, guide.as_mut())).collect();
    let starts: Vec<Goal> = goals.iter().zip(&walkers).map(|(goal, walker)| walker.first_leg(goal)).collect();
    let mut drive = Drive::new(game.open(level, &starts)?, policy, &level.body);
    while walkers.iter().any(|walker| walker.measured.end.is_none()) {
        let (mut deciding, mut noise, mut routes) = (Vec::new(), Vec::new(), Vec::new());
        for walker in walkers.iter_mut().filter(|walker| walker.measured.end.is_none()) {
            deciding.push(Deciding { npc_idx: walker.npc_idx, style: Style::Free });
            noise.extend(walker.noise.draw(Style::Free));
            routes.extend(walker.route.take());
        }
        let state = drive.decide(&deciding, noise, &routes)?;
        for walker in walkers.iter_mut().filter(|walker| walker.measured.end.is_none()) {
            walker.settle(state, rules, guide.as_mut());
        }
    }
    let search_us = guide.map_or(Vec::new(), |guide| guide.search_us);
    Ok((walkers.into_iter().map(Walker::finish).collect(), search_us))
}

/// Where plans come from.
struct Guide<'a> {
    router: &'a Router,
    search_us: Vec<f64>,
}

impl Guide<'_> {
    /// Plans from `feet`, m.
    fn plan(&mut self, follower: &mut Follower, feet: Vec3) {
        let Self { router, search_us } = self;
        follower.plan(feet, |query| {
            let started = Instant::now();
            let plan = router.find_path(query);
            search_us.push(started.elapsed().as_secs_f64() * 1.0e6);
            plan
        });
    }
}

/// One NPC with its running attempt.
struct Walker {
    npc_idx: usize,
    goal: Vec3,
    noise: NoiseStream,
    follower: Option<Follower>,
    measured: Measured,
    /// The whole way to the goal.
    episode: Episode,
    /// Sent with the next step.
    route: Option<Route>,
    /// Places of its route that it had passed before the last step.
    passed: u32,
}

impl Walker {
    fn start(npc_idx: usize, goal: &Goal, rules: Rules, guide: Option<&mut Guide<'_>>) -> Self {
        let mut walker = Self {
            npc_idx,
            goal: goal.goal,
            noise: NoiseStream::new(rules.noise_share, rules.seed, npc_idx as u64),
            follower: None,
            measured: Measured::begin(goal.start),
            episode: Episode::new(goal.goal, goal.start),
            route: None,
            passed: 0,
        };
        if let Some(guide) = guide {
            let mut follower = Follower::new(goal.goal, rules.follow);
            guide.plan(&mut follower, goal.start);
            walker.measured.record_first_plan(&follower);
            walker.follower = Some(follower);
            walker.send_route();
        }
        walker
    }

    /// Where the NPC heads in the first step to `goal`: its route begins when that step ends.
    fn first_leg(&self, goal: &Goal) -> Goal {
        let waypoint = self.follower.as_ref().and_then(Follower::waypoint);
        Goal { goal: waypoint.unwrap_or(goal.goal), ..*goal }
    }

    /// Heads for the waypoints ahead when the next step ends.
    fn send_route(&mut self) {
        let waypoints = self.follower.as_ref().map_or(&[][..], Follower::waypoints_ahead).to_vec();
        self.route = (!waypoints.is_empty()).then_some(Route { npc_idx: self.npc_idx, start: None, waypoints });
    }

    /// Processes one decision.
    fn settle(&mut self, state: &EnvState, rules: Rules, guide: Option<&mut Guide<'_>>) {
        let task = TaskConfig::default();
        let feet = state.positions[self.npc_idx];
        self.measured.record_decision(feet);
        self.episode.note_tick(feet, &task);
        self.episode.close_decision(&task);
        let ended = state.ended[self.npc_idx];
        match guide {
            None => {
                let is_out_of_patience = self.episode.stalled_decisions >= rules.follow.patience;
                self.measured.end = ended.or(is_out_of_patience.then_some(End::NoProgress));
            }
            Some(guide) => self.follow(state, ended, guide),
        }
    }

    /// Processes one decision of an NPC that follows a plan. `ended` is how the way along its route ended, if it did.
    fn follow(&mut self, state: &EnvState, ended: Option<End>, guide: &mut Guide<'_>) {
        let (passed, feet) = (state.passed[self.npc_idx], self.measured.feet);
        let passes = passed.saturating_sub(std::mem::replace(&mut self.passed, passed));
        let follower = self.follower.as_mut().expect("an NPC with a guide follows plans");
        let is_at_goal = feet.distance(self.goal) <= TaskConfig::default().goal_radius;
        if ended == Some(End::Reached) && is_at_goal {
            self.measured.end = ended;
            return;
        }
        // The game itself heads on from a place that an NPC has passed, and lets it rest where the route ended.
        let mut needs_route = ended.is_some();
        for pass in 0..passes.max(1) {
            let has_passed = passes > pass && !ended.is_some_and(End::is_harm);
            let leg_end = if has_passed { Some(End::Reached) } else { ended };
            match follower.record_decision(feet, leg_end) {
                Step::Keep => {}
                Step::HeadFor(_) => needs_route |= passes == 0,
                Step::Plan => {
                    guide.plan(follower, feet);
                    needs_route = true;
                    break;
                }
                Step::End(end) => self.measured.end = Some(end),
            }
        }
        if needs_route && self.measured.end.is_none() {
            self.send_route();
        }
    }

    fn finish(self) -> AttemptResult {
        self.measured.result(self.follower.as_ref())
    }
}
