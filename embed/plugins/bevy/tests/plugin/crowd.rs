//! Agents that go to goals by plan.

use crate::stage::Ends;
use bevy::app::App;
use bevy::ecs::prelude::*;
use bevy::math::Vec3;
use bevy_surefoot::{AgentAction, AgentPlan, Goal, SurefootAgent, SurefootCharacter, SurefootGraph};

/// Agents of a crowd.
pub const CROWD: usize = 32;
/// Ticks within which everybody must have arrived or failed: two minutes.
const MAX_TICKS: usize = 7200;

/// Spawns agents at vertices of the graph, each with a goal that can be reached from there.
pub fn spawn(app: &mut App, graph: &SurefootGraph, extras: impl Bundle + Clone) -> Vec<Entity> {
    let vertices = graph.vertices();
    let agent = SurefootAgent { seed: 7, ..SurefootAgent::default() };
    let reachable = |start: usize, idx: usize| {
        let goals = (1..vertices.len()).map(|step| vertices[(start + idx * 11 + step * 7) % vertices.len()]);
        let from = vertices[start];
        let query =
            |goal| surefoot_planner::Query { without: agent.without, ..surefoot_planner::Query::new(from, goal) };
        goals.into_iter().find(|goal| goal.distance(from) > 5.0 && graph.find_path(&query(*goal)).no_path.is_none())
    };
    let pairs = (0..vertices.len()).filter_map(|start| Some((vertices[start], reachable(start, start)?)));
    let crowd: Vec<(Vec3, Vec3)> = pairs.take(CROWD).collect();
    assert_eq!(crowd.len(), CROWD, "most vertices are starts");
    let spawned = |(start, goal): (Vec3, Vec3)| {
        let place = SurefootCharacter::standing_at(start, &agent.body);
        let character = SurefootCharacter::facing((goal - start).x.atan2((goal - start).z));
        app.world_mut().spawn((agent.clone(), character, place, Goal(goal), graph.clone(), extras.clone())).id()
    };
    crowd.into_iter().map(spawned).collect()
}

/// Runs the app until everybody has arrived or failed. Returns the number of ticks, and of decisions to jump.
pub fn run(app: &mut App, count: usize) -> (usize, usize) {
    let (mut jumps, mut actions) = (0, app.world_mut().query::<&AgentAction>());
    for tick in 0..MAX_TICKS {
        app.update();
        jumps += actions.iter(app.world()).filter(|it| it.is_first && it.action.jump > 0.0).count();
        let ends = app.world().resource::<Ends>();
        if ends.reached.len() + ends.failed.len() >= count {
            return (tick, jumps);
        }
    }
    let mut plans = app.world_mut().query::<&AgentPlan>();
    panic!("still under way: {:?}", plans.iter(app.world()).map(|plan| plan.status).collect::<Vec<_>>());
}
