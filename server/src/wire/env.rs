//! Environments of remote trainers on the wire.

use super::each_once;
use crate::envs::{EnvSettings, StepResults};
use surefoot_net::levels::BaseMap;
use surefoot_net::status;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::world::v1 as wire;
use surefoot_rollout::Goal;
use surefoot_rollout::env::{Episodes, Route, actions_of};
use surefoot_world::Action;
use surefoot_world::character::ACTION_LEN;
use tonic::Status;

/// Most NPCs of one environment, whose observations must fit into one message.
const MAX_ENV_NPCS: f64 = 4096.0;
/// Most places of a route in an environment.
const MAX_ROUTE: usize = 256;
/// Greatest heading, rad: a full turn.
const MAX_YAW: f64 = std::f64::consts::TAU;
/// Greatest distance of goals in an environment, m: across the largest map.
const MAX_GOAL_M: f64 = 1500.0;

/// Reads the settings of a new environment on the map of `source`, or on a game's own level.
pub fn env_settings(request: &wire::CreateEnvRequest, source: Option<BaseMap>) -> Result<EnvSettings, FieldError> {
    let body = convert::body(request.body.as_ref())?;
    let episodes =
        if request.goals.is_empty() { endless(request)? } else { Episodes::Once(env_goals(&request.goals)?) };
    Ok(EnvSettings { source, body, solid_npcs: request.solid_npcs, episodes })
}

/// Reads endless episodes with goals at random.
fn endless(request: &wire::CreateEnvRequest) -> Result<Episodes, FieldError> {
    let npc_count = convert::in_range(f64::from(request.npc_count), 1.0, MAX_ENV_NPCS, "npc_count")? as usize;
    let nearest = convert::in_range(f64::from(request.goal_min_m), 0.0, MAX_GOAL_M, "goal_min_m")?;
    let farthest = match request.goal_max_m {
        0.0 => MAX_GOAL_M,
        farthest => convert::in_range(f64::from(farthest), nearest, MAX_GOAL_M, "goal_max_m")?,
    };
    Ok(Episodes::Endless { npc_count, band: (nearest as f32, farthest as f32), seed: request.seed })
}

/// Reads episodes with given starts and goals.
fn env_goals(goals: &[wire::EnvGoal]) -> Result<Vec<Goal>, FieldError> {
    convert::in_range(goals.len() as f64, 1.0, MAX_ENV_NPCS, "goals")?;
    let goal = |it: &wire::EnvGoal| {
        let yaw = convert::in_range(f64::from(it.yaw), -MAX_YAW, MAX_YAW, "goals.yaw")? as f32;
        Ok(Goal {
            start: convert::point(it.start.as_ref(), "goals.start")?,
            yaw,
            goal: convert::point(it.goal.as_ref(), "goals.goal")?,
        })
    };
    goals.iter().map(goal).collect()
}

/// Reads the actions and the routes of an environment's NPCs.
pub fn env_actions(actions: Option<wire::EnvActions>, npc_count: usize) -> Result<(Vec<Action>, Vec<Route>), Status> {
    let wire::EnvActions { actions, routes } = actions.ok_or(FieldError::Missing("actions"))?;
    let values = convert::unpack(&actions, npc_count * ACTION_LEN, "actions.actions")?;
    let actions =
        actions_of(&values, |idx| idx as u64).map_err(|message| status::invalid("actions.actions", message))?;
    let routes = env_routes(&routes, npc_count)?;
    each_once(routes.iter().map(|route| route.npc_idx as u64).collect(), "actions.routes.npc")?;
    Ok((actions, routes))
}

fn env_routes(routes: &[wire::EnvRoute], npc_count: usize) -> Result<Vec<Route>, FieldError> {
    at_most(npc_count, routes.len(), "actions.routes", "routes")?;
    let route = |it: &wire::EnvRoute| {
        let most = npc_count.saturating_sub(1) as f64;
        let npc_idx = convert::in_range(f64::from(it.npc), 0.0, most, "actions.routes.npc")? as usize;
        if it.waypoints.is_empty() {
            return Err(FieldError::Missing("actions.routes.waypoints"));
        }
        at_most(MAX_ROUTE, it.waypoints.len(), "actions.routes.waypoints", "places")?;
        let place = |place| convert::point(Some(place), "actions.routes.waypoints");
        let yaw = convert::in_range(f64::from(it.yaw), -MAX_YAW, MAX_YAW, "actions.routes.yaw")? as f32;
        let start = it.start.as_ref().map(|start| convert::point(Some(start), "actions.routes.start")).transpose()?;
        let waypoints = it.waypoints.iter().map(place).collect::<Result<_, FieldError>>()?;
        Ok(Route { npc_idx, start: start.map(|start| (start, yaw)), waypoints })
    };
    routes.iter().map(route).collect()
}

fn at_most(limit: usize, found: usize, field: &'static str, what: &'static str) -> Result<(), FieldError> {
    if found <= limit { Ok(()) } else { Err(FieldError::Count { field, what, found, limit }) }
}

pub fn results_to_wire(results: StepResults) -> wire::EnvResults {
    let ends = results.ended.iter().map(|ended| wire::EnvEnd {
        npc: ended.npc_idx as u32,
        outcome: convert::outcome(Some(ended.end)).into(),
        final_observation: convert::pack(ended.final_observation.iter().copied()),
    });
    wire::EnvResults {
        ends: ends.collect(),
        observations: convert::pack(results.observations),
        rewards: convert::pack(results.rewards),
        positions: convert::pack_points(results.positions),
        abilities: results.abilities.into_iter().map(|ability| convert::ability_to_wire(ability) as u8).collect(),
        passed: results.passed,
    }
}
