//! Sends NPCs of a game to goals, straight or by plan, as evaluations do in simulated worlds.
//!
//! The game itself leads an NPC from waypoint to waypoint. It gets a new route when a review, a rehearsal or a failure
//! changes the plan. Rehearsals run in a copy of the level, with the body that stands for the game's character.

use super::drive::{Deciding, Drive, body_at, seen};
use super::link::{Game, GameError, Level};
use std::time::Instant;
use surefoot_planner::Router;
use surefoot_policy::Policy;
use surefoot_rollout::attempts::{Figures, Measured};
use surefoot_rollout::env::Route;
use surefoot_rollout::follow::Step;
use surefoot_rollout::game::{GameAttempt, Prepared, Rehearsals};
use surefoot_rollout::motion::{Sample, Trace};
use surefoot_rollout::rehearse::NoiseStream;
use surefoot_rollout::{AttemptResult, FollowConfig, Follower, Goal, Motion, Style};
use surefoot_world::{Body, DECISION_SECONDS, End, Episode, Npc, TaskConfig, Vec3};

/// Rules of attempts.
#[derive(Debug, Clone, Copy)]
pub struct Rules {
    /// Rules of following plans; their patience holds for NPCs that head straight for goals as well.
    pub follow: FollowConfig,
    /// Whether NPCs that follow plans rehearse the next legs; otherwise they move freely.
    pub rehearses: bool,
    /// Share of the policy's exploration noise with which NPCs act, 0 or more.
    pub noise_share: f32,
    /// Seed of the noise.
    pub seed: u64,
}

/// Runs one attempt for each goal, all together, following plans of `router`, if there is one. Returns the attempts in
/// the order of the goals, and what was measured.
///
/// # Errors
/// If the game refuses, does not answer, or breaks the contract.
pub fn attempt(
    game: &Game,
    level: &Level,
    policy: &Policy,
    router: Option<&Router>,
    (goals, rules): (&[Goal], Rules),
) -> Result<(Vec<AttemptResult>, Figures), GameError> {
    let mut figures = Figures::default();
    if goals.is_empty() {
        return Ok((Vec::new(), figures));
    }
    let rehearsals = rules.rehearses.then(|| Rehearsals::new(level.map.clone(), level.body.clone(), policy, 0));
    let mut guide = router.map(|router| Guide { router, rehearsals, figures: &mut figures });
    let hidden = vec![0.0; policy.memory_len()];
    let mut walkers: Vec<Walker> = (0..)
        .zip(goals)
        .map(|(idx, goal)| Walker::start(idx, goal, rules, guide.as_mut().map(|guide| (guide, &hidden[..]))))
        .collect();
    let starts: Vec<Goal> = goals.iter().zip(&walkers).map(|(goal, walker)| walker.first_leg(goal)).collect();
    let mut drive = Drive::new(game.open(level, &starts)?, policy, &level.body);
    let mut motion = Motion::default();
    while walkers.iter().any(|walker| walker.measured.end.is_none()) {
        let (mut deciding, mut noise, mut routes) = (Vec::new(), Vec::new(), Vec::new());
        for walker in walkers.iter_mut().filter(|walker| walker.measured.end.is_none()) {
            deciding.push(Deciding { npc_idx: walker.npc_idx, style: walker.style, npc: Some(walker.npc) });
            noise.extend(walker.noise.draw(walker.style));
            routes.extend(walker.route.take());
        }
        drive.decide(&deciding, noise, &routes)?;
        for walker in walkers.iter_mut().filter(|walker| walker.measured.end.is_none()) {
            walker.settle(&drive, rules, guide.as_mut(), &mut motion);
        }
    }
    figures.motion = motion;
    Ok((walkers.into_iter().map(Walker::finish).collect(), figures))
}

/// The source of plans, and their rehearsals.
struct Guide<'a> {
    router: &'a Router,
    rehearsals: Option<Rehearsals>,
    figures: &'a mut Figures,
}

impl Guide<'_> {
    /// Plans from `feet`, m.
    fn plan(&mut self, attempt: &mut GameAttempt, feet: Vec3) {
        let Self { router, figures, .. } = self;
        attempt.plan(feet, |query| {
            let started = Instant::now();
            let plan = router.find_path(query);
            figures.times.search_us.push(started.elapsed().as_secs_f64() * 1.0e6);
            plan
        });
    }
}

/// One NPC with its running attempt.
struct Walker {
    npc_idx: usize,
    goal: Vec3,
    noise: NoiseStream,
    attempt: Option<GameAttempt>,
    measured: Measured,
    /// The NPC as far as the game shows it. If it follows a plan, its episode leads to its waypoint, otherwise to the
    /// goal.
    npc: Npc,
    /// How it moves in the next decision.
    style: Style,
    trace: Trace,
    /// Sent with the next step.
    route: Option<Route>,
    /// The waypoints of the last route that was sent, m.
    sent: Vec<Vec3>,
    /// Places of its route that it had passed before the last step.
    passed: u32,
}

impl Walker {
    fn start(npc_idx: usize, goal: &Goal, rules: Rules, guide: Option<(&mut Guide<'_>, &[f32])>) -> Self {
        let npc = Npc::outside(Body::at(goal.start, goal.yaw), Episode::new(goal.goal, goal.start));
        let mut walker = Self {
            npc_idx,
            goal: goal.goal,
            noise: NoiseStream::new(rules.noise_share, rules.seed, npc_idx as u64),
            attempt: None,
            measured: Measured::begin(goal.start),
            npc,
            style: Style::Free,
            trace: Trace::begin(Sample::of(&npc)),
            route: None,
            sent: Vec::new(),
            passed: 0,
        };
        if let Some((guide, hidden)) = guide {
            let mut attempt = GameAttempt::new(Follower::new(goal.goal, rules.follow));
            guide.plan(&mut attempt, goal.start);
            walker.measured.record_first_plan(attempt.follower());
            walker.attempt = Some(attempt);
            walker.prepare(guide, hidden);
            walker.send_route(walker.way_ahead());
        }
        walker
    }

    /// Where the NPC heads in the first step to `goal`: its route begins when that step ends.
    fn first_leg(&self, goal: &Goal) -> Goal {
        let waypoint = self.attempt.as_ref().and_then(|attempt| attempt.follower().waypoint());
        Goal { goal: waypoint.unwrap_or(goal.goal), ..*goal }
    }

    /// The places for which it heads, m; none without a plan.
    fn way_ahead(&self) -> Vec<Vec3> {
        self.attempt.as_ref().map_or(Vec::new(), |attempt| attempt.follower().way_ahead())
    }

    /// Lets the game lead the NPC along these places, m, when the next step ends.
    fn send_route(&mut self, waypoints: Vec<Vec3>) {
        self.sent.clone_from(&waypoints);
        self.route = (!waypoints.is_empty()).then_some(Route { npc_idx: self.npc_idx, start: None, waypoints });
    }

    /// Processes one decision.
    fn settle(&mut self, drive: &Drive<'_>, rules: Rules, guide: Option<&mut Guide<'_>>, motion: &mut Motion) {
        self.see(drive);
        let ability = self.attempt.as_ref().and_then(|attempt| attempt.follower().ability());
        motion.note(&mut self.trace, &Sample::of(&self.npc), ability);
        self.measured.record_decision(self.npc.body.feet);
        let ended = drive.state().ended[self.npc_idx];
        match guide {
            None => {
                let stalled = self.npc.episode.map_or(0, |episode| episode.stalled_decisions);
                let is_out_of_patience = stalled >= rules.follow.patience;
                self.measured.end = ended.or(is_out_of_patience.then_some(End::NoProgress));
            }
            Some(guide) => self.follow(drive, ended, guide),
        }
    }

    /// Reads what the game shows of the NPC after a decision.
    fn see(&mut self, drive: &Drive<'_>) {
        let (state, profile, task) = (drive.state(), drive.profile(), TaskConfig::default());
        let feet = state.positions[self.npc_idx];
        let (before, action) = (self.npc.body, drive.action(self.npc_idx));
        let turned = before.yaw + action.turn * profile.turn_speed * DECISION_SECONDS;
        let passed = state.passed[self.npc_idx] as usize;
        let next = self.sent.get(passed).or(self.sent.first()).copied();
        let aims = next.into_iter().chain(self.npc.episode.map(|episode| episode.goal)).chain([self.goal]);
        self.npc.body = body_at(seen(state, self.npc_idx), feet, aims, turned, profile);
        (self.npc.last.velocity, self.npc.last.action) = (before.velocity, action.to_array());
        self.npc.used_abilities = [state.abilities[self.npc_idx]].into_iter().collect();
        if let Some(episode) = &mut self.npc.episode {
            episode.note_tick(feet, &task);
            episode.close_decision(&task);
        }
    }

    /// Processes one decision of an NPC that follows a plan. `ended` is how the way along its route ended, if it did.
    fn follow(&mut self, drive: &Drive<'_>, ended: Option<End>, guide: &mut Guide<'_>) {
        let (passed, feet) = (drive.state().passed[self.npc_idx], self.measured.feet);
        let passes = passed.saturating_sub(std::mem::replace(&mut self.passed, passed));
        let attempt = self.attempt.as_mut().expect("an NPC with a guide follows plans");
        let is_at_goal = feet.distance(self.goal) <= TaskConfig::default().goal_radius;
        if ended == Some(End::Reached) && is_at_goal {
            self.measured.end = ended;
            return;
        }
        // The game itself heads on from a place that an NPC has passed, and lets it rest where the route ended.
        for pass in 0..passes.max(1) {
            let has_passed = passes > pass && !ended.is_some_and(End::is_harm);
            let leg_end = if has_passed { Some(End::Reached) } else { ended };
            match attempt.record_decision(feet, leg_end) {
                Step::Keep | Step::HeadFor(_) => {}
                Step::Plan => {
                    guide.plan(attempt, feet);
                    break;
                }
                Step::End(end) => self.measured.end = Some(end),
            }
        }
        if self.measured.end.is_some() {
            return;
        }
        self.prepare(guide, drive.memory(self.npc_idx));
        let way = self.way_ahead();
        if ended.is_some() || self.sent.get(passed as usize..) != Some(&way[..]) {
            self.send_route(way);
        }
    }

    /// Rehearses the next legs, and chooses how the NPC moves in the next decision.
    fn prepare(&mut self, guide: &mut Guide<'_>, hidden: &[f32]) {
        let attempt = self.attempt.as_mut().expect("an NPC with a guide follows plans");
        let feet = self.npc.body.feet;
        let npc = &mut self.npc;
        loop {
            let follower = attempt.follower();
            let heads_for = npc.episode.map(|episode| (episode.goal, episode.arrival));
            let way = follower.waypoint().map(|waypoint| (waypoint, follower.arrival()));
            if let Some((waypoint, arrival)) = way.filter(|way| heads_for != Some(*way)) {
                npc.episode = Some(Episode::new(waypoint, feet).arriving(arrival));
            }
            let Some(rehearsals) = &guide.rehearsals else { return };
            let started = Instant::now();
            let prepared = attempt.prepare(rehearsals, npc, hidden, &mut self.noise);
            guide.figures.times.rehearsal_s += started.elapsed().as_secs_f64();
            match prepared {
                Prepared::Act(style) => {
                    self.style = style;
                    return;
                }
                Prepared::HeadFor(_) => {}
                Prepared::Plan => guide.plan(attempt, feet),
            }
        }
    }

    fn finish(self) -> AttemptResult {
        self.measured.result(self.attempt.as_ref().map(GameAttempt::follower))
    }
}
