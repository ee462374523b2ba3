//! Attempts: when they begin and end, and where agents head meanwhile.

use crate::agent::{AgentAction, AgentPlan, AgentState, AgentStatus, Failure, Goal, Sight, SurefootAgent};
use crate::events::{AgentDied, GoalFailed, GoalReached, LegFailed};
use crate::graph::SurefootGraph;
use crate::mind::{Attempt, Mind, Route, body_of};
use bevy_ecs::prelude::*;
use bevy_time::{Fixed, Time};
use surefoot_planner::{Leg, NoPath};
use surefoot_rollout::follow::Step;
use surefoot_world::sense::RayCone;
use surefoot_world::{CharacterProfile, DECISION_SECONDS, End, TaskConfig};

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
        Option<Ref<'static, Goal>>,
        Option<&'static SurefootGraph>,
        &'static mut Mind,
        &'static mut AgentPlan,
        &'static mut AgentAction,
        &'static mut Sight,
    ),
>;

/// Begins and ends attempts, follows plans, and says which rays are needed.
pub(crate) fn aim(
    clock: Res<'_, Clock>,
    mut agents: Agents<'_, '_>,
    cone: Local<'_, RayCone>,
    mut commands: Commands<'_, '_>,
) {
    let task = TaskConfig::default();
    for (agent, settings, state, goal, graph, mut mind, mut plan, mut action, mut sight) in &mut agents {
        action.is_first = false;
        sight.is_wanted = false;
        let wet = mind.last.ticks_in_water;
        mind.last.ticks_in_water = if state.is_in_water { wet.saturating_add(1) } else { wet.saturating_sub(1) };
        let mut outcome = match &goal {
            Some(goal) if goal.is_changed() => {
                *plan = AgentPlan::default();
                begin(&mut mind, settings, state, goal, graph)
            }
            None if mind.attempt.is_some() || plan.status != AgentStatus::Idle => {
                mind.attempt = None;
                *plan = AgentPlan::default();
                None
            }
            _ => None,
        };
        if let Some(attempt) = &mut mind.attempt {
            let mut course = Course { agent, settings, state, attempt, plan: &mut plan, commands: &mut commands };
            outcome = outcome.or_else(|| course.note(&task));
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

/// Begins an attempt, or returns how it has ended.
fn begin(
    mind: &mut Mind,
    settings: &SurefootAgent,
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
    mind.attempt = Some(Attempt::new(goal.0, state.feet, graph.cloned()));
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
    if let Some(Attempt { route: Some(Route { graph, follower }), .. }) = &mut mind.attempt {
        follower.take_traversals().iter().for_each(|traversal| graph.note(traversal));
    }
    mind.attempt = None;
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
    state: &'a AgentState,
    attempt: &'a mut Attempt,
    plan: &'a mut AgentPlan,
    commands: &'a mut Commands<'w, 's>,
}

impl Course<'_, '_, '_> {
    /// Records a tick. Returns how the attempt has ended, if it has.
    fn note(&mut self, task: &TaskConfig) -> Option<AgentStatus> {
        let (attempt, feet) = (&mut *self.attempt, self.state.feet);
        if feet.distance(attempt.goal) <= task.goal_radius {
            return Some(AgentStatus::Reached);
        }
        if attempt.episode.end.is_none() {
            attempt.episode.note_tick(feet, task);
        }
        attempt.has_reached |= feet.distance(attempt.episode.goal) <= task.goal_radius;
        None
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
        let is_hopeless = self.attempt.episode.end == Some(End::NoProgress);
        is_hopeless.then_some(AgentStatus::Failed(Failure::NoProgress))
    }

    fn follow(&mut self) -> Option<AgentStatus> {
        let feet = self.state.feet;
        let has_reached = std::mem::take(&mut self.attempt.has_reached);
        let Route { graph, follower } = self.attempt.route.as_mut()?;
        let on_map = feet + graph.origin();
        let leg = self.plan.plan.as_ref().filter(|_| follower.leg_key().is_some()).map(|plan| plan.legs[self.plan.leg]);
        let mut step = follower.record_decision(on_map, has_reached.then_some(End::Reached));
        follower.take_traversals().iter().for_each(|traversal| graph.note(traversal));
        if let (Some(leg), Step::Plan | Step::End(End::NoProgress)) = (leg, step) {
            self.commands.trigger(LegFailed { agent: self.agent, leg, died: false });
        }
        if step == Step::Plan {
            let SurefootAgent { caution, without, .. } = *self.settings;
            let mut made = None;
            let waypoint = follower.plan(on_map, |query| {
                let plan = graph.find(&surefoot_planner::Query { caution, without, ..query.clone() });
                made = Some(plan.clone());
                plan
            });
            self.plan.plan = made.map(|plan| graph.in_scene(plan));
            step = Step::HeadFor(waypoint);
        }
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
        if let Some(Route { follower, .. }) = &mut attempt.route {
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
