//! Attempts: when they begin and end, and where agents head meanwhile.

use crate::agent::{
    AgentAction, AgentPlan, AgentState, AgentStatus, Failure, Goal, GoalRadius, GoalSight, Sight, SurefootAgent,
};
use crate::events::{AgentDied, GoalFailed, GoalReached, LegFailed};
use crate::graph::SurefootGraph;
use crate::mind::{Arriving, Attempt, Memory, Mind, Route, body_of, npc_of};
use crate::policy::{DefaultPolicy, SurefootPolicy};
use bevy_ecs::prelude::*;
use bevy_math::Vec3;
use bevy_time::{Fixed, Time};
use surefoot_planner::{Leg, NoPath};
use surefoot_rollout::follow::Step;
use surefoot_rollout::game::Prepared;
use surefoot_world::arrival::{LINE_COUNT, Line, lines_to_goal};
use surefoot_world::sense::RayCone;
use surefoot_world::{Arrival, CharacterProfile, DECISION_SECONDS, End, TaskConfig};

/// A waypoint this near to the goal is the goal: places are rounded on their way to the map and back, m.
const SAME_M: f32 = 0.01;

/// When agents decide.
#[derive(Resource, Debug, Default)]
pub(crate) struct Clock {
    tick: u32,
    /// Whether they do in this tick.
    is_due: bool,
}

/// Counts fixed ticks: a decision takes 1/6 s, rounded to whole ticks.
pub(crate) fn wind(mut clock: ResMut<'_, Clock>, time: Res<'_, Time<Fixed>>) {
    let ticks = (DECISION_SECONDS / time.timestep().as_secs_f32()).round().max(1.0) as u32;
    clock.is_due = clock.tick == 0;
    clock.tick = (clock.tick + 1) % ticks;
}

type Agents<'w, 's> = Query<
    'w,
    's,
    (
        Entity,
        &'static SurefootAgent,
        &'static AgentState,
        (Option<Ref<'static, Goal>>, Option<&'static GoalRadius>),
        (Option<&'static SurefootGraph>, Option<&'static SurefootPolicy>),
        &'static mut Mind,
        &'static mut AgentPlan,
        &'static mut AgentAction,
        (&'static mut Sight, &'static mut GoalSight),
    ),
>;

/// Begins and ends attempts, follows plans, and says which rays are needed.
pub(crate) fn aim(
    clock: Res<'_, Clock>,
    policy: Res<'_, DefaultPolicy>,
    mut agents: Agents<'_, '_>,
    cone: Local<'_, RayCone>,
    mut commands: Commands<'_, '_>,
) {
    let task = TaskConfig::default();
    for (agent, settings, state, (goal, radius), (graph, own), mut mind, mut plan, mut action, sights) in &mut agents {
        let policy = own.unwrap_or(&policy.0);
        let (mut sight, mut goal_sight) = sights;
        action.is_first = false;
        sight.is_wanted = false;
        (goal_sight.lines, goal_sight.is_blocked) = (None, false);
        let wet = mind.last.ticks_in_water;
        mind.last.ticks_in_water = if state.is_in_water { wet.saturating_add(1) } else { wet.saturating_sub(1) };
        let mut outcome = match &goal {
            Some(goal) if goal.is_changed() && goes_on(&mind, goal.0, state.feet, graph) => {
                mind.attempt.as_mut().expect("an attempt that goes on").move_goal(goal.0, state.feet, &mut plan);
                None
            }
            Some(goal) if goal.is_changed() => {
                *plan = AgentPlan::default();
                begin(&mut mind, (settings, policy), state, goal, graph)
            }
            None if mind.attempt.is_some() || plan.status != AgentStatus::Idle => {
                mind.attempt = None;
                *plan = AgentPlan::default();
                None
            }
            _ => None,
        };
        if let Some((attempt, memory)) = mind.parts() {
            let (plan, commands) = (&mut *plan, &mut commands);
            let mut course = Course { agent, settings, policy, state, attempt, memory, plan, commands };
            if outcome.is_none() {
                goal_sight.lines = course.note(radius.map_or(task.goal_radius, |radius| radius.0), &task);
            }
            if outcome.is_none() && clock.is_due && state.is_finite() {
                outcome = course.choose(&task);
                sight.is_wanted = outcome.is_none();
            }
        }
        if let Some(status) = outcome {
            end(agent, status, (&mut mind, &mut plan), &mut commands);
        }
        if mind.attempt.is_none() {
            *action = AgentAction::default();
        }
        if sight.is_wanted {
            let body = body_of(state);
            sight.origin = RayCone::eye(&settings.body, &body);
            sight.directions = cone.directions_of(&body);
        }
    }
}

/// Whether another goal moves the goal of the attempt under way, m.
fn goes_on(mind: &Mind, goal: Vec3, feet: Vec3, graph: Option<&SurefootGraph>) -> bool {
    mind.attempt.as_ref().is_some_and(|attempt| attempt.goes_on_to(goal, feet, graph))
}

type Nearing<'w, 's> = Query<
    'w,
    's,
    (
        Entity,
        &'static GoalSight,
        &'static mut Mind,
        &'static mut AgentPlan,
        &'static mut AgentAction,
        &'static mut Sight,
    ),
>;

/// Ends the attempts of agents that stand at their goals, with nothing solid between.
pub(crate) fn arrive(mut agents: Nearing<'_, '_>, mut commands: Commands<'_, '_>) {
    for (agent, goal_sight, mut mind, mut plan, mut action, mut sight) in &mut agents {
        if goal_sight.lines.is_none() || goal_sight.is_blocked {
            continue;
        }
        let Some(attempt) = &mut mind.attempt else { continue };
        match attempt.arriving.take() {
            Some(Arriving::Goal) => {
                end(agent, AgentStatus::Reached, (&mut mind, &mut plan), &mut commands);
                (*action, sight.is_wanted) = (AgentAction::default(), false);
            }
            Some(Arriving::Waypoint) => attempt.has_reached = true,
            None => {}
        }
    }
}

/// Begins an attempt, or returns how it has ended.
fn begin(
    mind: &mut Mind,
    (settings, policy): (&SurefootAgent, &SurefootPolicy),
    state: &AgentState,
    goal: &Goal,
    graph: Option<&SurefootGraph>,
) -> Option<AgentStatus> {
    mind.attempt = None;
    if !goal.0.is_finite() {
        return Some(AgentStatus::Failed(Failure::BadGoal));
    }
    if graph.and_then(SurefootGraph::body).is_some_and(|proved| !moves_alike(proved, &settings.body)) {
        return Some(AgentStatus::Failed(Failure::OtherBody));
    }
    let route = graph.map(|graph| (graph.clone(), graph.rehearsals(policy, &settings.body)));
    mind.attempt = Some(Attempt::new(goal.0, state.feet, route));
    None
}

/// Whether two bodies move alike, where there are neither zip lines nor jetpacks.
fn moves_alike(one: &CharacterProfile, other: &CharacterProfile) -> bool {
    /// Relative difference that no policy notices, but rounding makes.
    const ROUNDING: f32 = 1.0e-3;
    let values = |body: &CharacterProfile| {
        [
            body.height,
            body.radius,
            body.forward_speed,
            body.side_speed_share,
            body.turn_speed,
            body.jump_speed,
            body.gravity,
            f32::from(body.extra_jumps),
            body.max_slope,
            body.step_height,
            body.ground_acceleration,
            body.air_acceleration,
        ]
    };
    values(one).into_iter().zip(values(other)).all(|(one, other)| (one - other).abs() <= ROUNDING * one.abs())
}

/// Ends an attempt, and lets the app and later plans know how it went.
fn end(agent: Entity, status: AgentStatus, (mind, plan): (&mut Mind, &mut AgentPlan), commands: &mut Commands<'_, '_>) {
    if let Some(Attempt { route: Some(Route { graph, attempt, .. }), .. }) = &mut mind.attempt {
        attempt.follower_mut().take_traversals().iter().for_each(|traversal| graph.note(traversal));
    }
    (mind.attempt, mind.prepared) = (None, None);
    (plan.status, plan.waypoint) = (status, None);
    match status {
        AgentStatus::Failed(failure) => {
            if matches!(failure, Failure::OtherBody | Failure::BadGoal) {
                tracing::error!("agent {agent}: {failure}");
            }
            commands.trigger(GoalFailed { agent, failure });
        }
        _ => commands.trigger(GoalReached { agent }),
    }
}

/// An attempt as it goes on.
struct Course<'a, 'w, 's> {
    agent: Entity,
    settings: &'a SurefootAgent,
    policy: &'a SurefootPolicy,
    state: &'a AgentState,
    attempt: &'a mut Attempt,
    memory: Memory<'a>,
    plan: &'a mut AgentPlan,
    commands: &'a mut Commands<'w, 's>,
}

impl Course<'_, '_, '_> {
    /// Records a tick. Returns the lines on which nothing solid may lie if the agent is to have arrived within `radius`
    /// metres of its goal, or at its last waypoint.
    fn note(&mut self, radius: f32, task: &TaskConfig) -> Option<[Line; LINE_COUNT]> {
        let (attempt, feet) = (&mut *self.attempt, self.state.feet);
        if attempt.episode.end.is_none() {
            attempt.episode.note_tick(feet, task);
        }
        let waypoint = attempt.episode.goal;
        let stands = attempt.route.as_ref().is_none_or(|route| route.attempt.follower().arrival() == Arrival::Stand);
        // Waypoints are passed on the run or in flight, but at some the agent stands.
        attempt.has_reached |= !stands && feet.distance(waypoint) <= task.goal_radius;
        let body = body_of(self.state);
        let lines_to = |place: Vec3, radius: f32| lines_to_goal(&self.settings.body, &body, place, radius);
        let to_goal = lines_to(attempt.goal, radius);
        let is_elsewhere = stands && waypoint.distance(attempt.goal) > SAME_M;
        let to_waypoint = || lines_to(waypoint, task.goal_radius).filter(|_| is_elsewhere);
        attempt.arriving = to_goal.map(|_| Arriving::Goal);
        to_goal.or_else(|| to_waypoint().inspect(|_| attempt.arriving = Some(Arriving::Waypoint)))
    }

    /// Chooses where to head before a decision. Returns how the attempt has ended, if it has.
    fn choose(&mut self, task: &TaskConfig) -> Option<AgentStatus> {
        if std::mem::take(&mut self.attempt.has_decided) {
            self.attempt.episode.close_decision(task);
        }
        if self.attempt.route.is_some() {
            return self.follow();
        }
        (self.plan.status, self.plan.waypoint) = (AgentStatus::Heading, Some(self.attempt.goal));
        // Progress starts again whenever the goal moves, so an agent that stands still gives up as well.
        let standing = self.attempt.count_standing(self.state.feet, task.goal_radius);
        let is_hopeless = self.attempt.episode.stalled_decisions.max(standing) >= task.patience;
        is_hopeless.then_some(AgentStatus::Failed(Failure::NoProgress))
    }

    fn follow(&mut self) -> Option<AgentStatus> {
        let feet = self.state.feet;
        let has_reached = std::mem::take(&mut self.attempt.has_reached);
        let Route { graph, attempt, .. } = self.attempt.route.as_mut()?;
        let follower = attempt.follower();
        let on_map = feet + graph.origin();
        let leg = self.plan.plan.as_ref().filter(|_| follower.leg_key().is_some()).map(|plan| plan.legs[self.plan.leg]);
        // The last waypoint may lag behind a goal that has moved a little: then the goal itself is next.
        let goal = follower.goal();
        let goal_ahead = if has_reached { attempt.follow_goal(goal, on_map, true) } else { None };
        let is_there = has_reached && goal_ahead.is_none();
        let mut step = match (attempt.record_decision(on_map, is_there.then_some(End::Reached)), goal_ahead) {
            (Step::Keep, Some(goal)) => Step::HeadFor(goal),
            (step, _) => step,
        };
        attempt.follower_mut().take_traversals().iter().for_each(|traversal| graph.note(traversal));
        if let (Some(leg), Step::Plan | Step::End(End::NoProgress)) = (leg, step) {
            self.commands.trigger(LegFailed { agent: self.agent, leg, died: false });
        }
        let goes_on = matches!(step, Step::Keep | Step::HeadFor(_));
        if step == Step::Plan || goes_on && attempt.follower().has_goal_drifted(on_map) {
            step = Step::HeadFor(self.make_plan());
        }
        if let Some(waypoint) = self.prepare().filter(|_| matches!(step, Step::Keep | Step::HeadFor(_))) {
            step = Step::HeadFor(waypoint);
        }
        let Route { graph, attempt, .. } = self.attempt.route.as_ref()?;
        let follower = attempt.follower();
        let no_path = self.plan.plan.as_ref().and_then(|plan| plan.no_path);
        let is_lost = self.plan.plan.as_ref().is_some_and(|plan| plan.no_path.is_some() && plan.nearest.is_none());
        (self.plan.leg, self.plan.plan_count) = (follower.leg_idx(), follower.plans());
        match step {
            // The plan would be the straight way to the goal, of which nothing is known.
            _ if is_lost => Some(unreachable(no_path)),
            Step::End(End::Unreachable) => Some(unreachable(no_path)),
            Step::End(End::Reached) => Some(AgentStatus::Reached),
            Step::End(_) | Step::Plan => Some(AgentStatus::Failed(Failure::GaveUp)),
            Step::Keep | Step::HeadFor(_) => {
                self.plan.status = no_path.map_or(AgentStatus::Following, AgentStatus::Nearing);
                if let Step::HeadFor(waypoint) = step {
                    let waypoint = waypoint - graph.origin();
                    self.plan.waypoint = Some(waypoint);
                    self.attempt.head_for(waypoint, feet);
                }
                None
            }
        }
    }

    /// Plans from where the agent is, and returns the first waypoint on the map, m.
    fn make_plan(&mut self) -> Vec3 {
        let Route { graph, attempt, .. } = self.attempt.route.as_mut().expect("an agent with a graph");
        let SurefootAgent { caution, without, .. } = *self.settings;
        let mut made = None;
        let waypoint = attempt.plan(self.state.feet + graph.origin(), |query| {
            let plan = graph.find(&surefoot_planner::Query { caution, without, ..query.clone() });
            made = Some(plan.clone());
            plan
        });
        self.plan.plan = made.map(|plan| graph.in_scene(plan));
        waypoint
    }

    /// Rehearses what lies ahead, and chooses how the agent carries out its next decision. Returns the waypoint on the
    /// map, m, if it has changed.
    fn prepare(&mut self) -> Option<Vec3> {
        let (mut aim, feet) = (None, self.state.feet);
        loop {
            let Route { graph, attempt, rehearsals } = self.attempt.route.as_mut()?;
            let rehearsals = rehearsals.clone()?;
            let Memory { last, memory, noise, prepared } = &mut self.memory;
            let origin = graph.origin();
            let npc = npc_of(self.state, origin, (&self.attempt.episode, last), &self.settings.body);
            memory.resize(self.policy.inner.memory_len(), 0.0);
            let noise = Mind::noise(noise, self.settings.seed_of(self.agent), self.settings.noise_share);
            let waypoint = match attempt.prepare(&rehearsals, &npc, memory, noise) {
                Prepared::Act(style) => {
                    **prepared = Some((style, npc));
                    self.plan.plan = attempt.follower().current_plan().cloned().map(|plan| graph.in_scene(plan));
                    return aim;
                }
                Prepared::HeadFor(waypoint) => waypoint,
                Prepared::Plan => self.make_plan(),
            };
            aim = Some(waypoint);
            self.attempt.head_for(waypoint - origin, feet);
        }
    }
}

fn unreachable(no_path: Option<NoPath>) -> AgentStatus {
    AgentStatus::Failed(Failure::Unreachable(no_path))
}

/// Ends the attempt of an agent that died, and makes it forget.
pub(crate) fn note_death(
    event: On<'_, '_, AgentDied>,
    mut agents: Query<'_, '_, (&mut Mind, &mut AgentPlan, &mut AgentAction)>,
    mut commands: Commands<'_, '_>,
) {
    let agent = event.agent;
    let Ok((mut mind, mut plan, mut action)) = agents.get_mut(agent) else { return };
    *action = AgentAction::default();
    if let Some(attempt) = &mut mind.attempt {
        if let Some(Route { attempt, .. }) = &mut attempt.route {
            let follower = attempt.follower_mut();
            let leg: Option<Leg> = follower.leg_key().and(plan.plan.as_ref()).map(|made| made.legs[plan.leg]);
            follower.record_harm();
            if let Some(leg) = leg {
                commands.trigger(LegFailed { agent, leg, died: true });
            }
        }
        end(agent, AgentStatus::Failed(Failure::Died), (&mut mind, &mut plan), &mut commands);
    }
    mind.forget();
}
