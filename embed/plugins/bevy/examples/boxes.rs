//! Agents on avian that go to and fro in a level, without a window: docs/guides/bevy.md.
//!
//!   surefoot graph export embed/game/examples/boxes.obj --vertices 60 --format json --out graph.json
//!   cargo run --release --features avian --example boxes -- ../../game/examples/boxes.obj ../../../graph.json

use avian3d::prelude::{Collider, PhysicsPlugins, RigidBody, TrimeshFlags};
use bevy::app::{App, AppExit, ScheduleRunnerPlugin};
use bevy::ecs::prelude::*;
use bevy::prelude::{PluginGroup, TransformPlugin};
use bevy::time::{Fixed, Time};
use bevy::{MinimalPlugins, math::Vec3};
use bevy_surefoot::avian::SurefootAvianPlugin;
use bevy_surefoot::events::{GoalFailed, GoalReached, LegFailed};
use bevy_surefoot::{
    Goal, SurefootAgent, SurefootCharacter, SurefootError, SurefootGraph, SurefootLevel, SurefootPlugin,
    SurefootSurface,
};
use std::time::Duration;

/// Agents of the example.
const AGENTS: usize = 8;

/// Where agents go, in turn.
#[derive(Resource)]
struct Places(Vec<Vec3>);

fn main() -> Result<(), SurefootError> {
    let mut args = std::env::args().skip(1);
    let (Some(level), Some(graph)) = (args.next(), args.next()) else {
        println!("usage: boxes LEVEL GRAPH");
        return Ok(());
    };
    let level = SurefootLevel::load(level)?;
    let graph = SurefootGraph::load(graph)?.aligned_to(&level)?;
    let mut app = App::new();
    let frames = ScheduleRunnerPlugin::run_loop(Duration::from_secs_f64(1.0 / 60.0));
    app.add_plugins((MinimalPlugins.set(frames), TransformPlugin, PhysicsPlugins::default()))
        .add_plugins((SurefootPlugin::default(), SurefootAvianPlugin))
        .insert_resource(Time::<Fixed>::from_hz(60.0))
        .add_observer(go_on)
        .add_observer(|event: On<'_, '_, LegFailed>| println!("{} needs another plan", event.agent))
        .add_observer(|event: On<'_, '_, GoalFailed>| println!("{}: {}", event.agent, event.failure));
    for mesh in level.meshes() {
        let shape = Collider::trimesh_with_config(mesh.corners, mesh.indices, TrimeshFlags::FIX_INTERNAL_EDGES);
        app.world_mut().spawn((RigidBody::Static, shape, SurefootSurface(mesh.surface)));
    }
    let places = graph.vertices();
    for idx in 0..AGENTS {
        let agent = SurefootAgent::default();
        let place = SurefootCharacter::standing_at(places[idx], &agent.body);
        let goal = Goal(places[places.len() - 1 - idx]);
        app.world_mut().spawn((agent, SurefootCharacter::default(), place, goal, graph.clone()));
    }
    app.insert_resource(Places(places)).run();
    Ok(())
}

/// Sends each agent that has arrived to another place. Ends after as many arrivals as there are agents.
fn go_on(
    event: On<'_, '_, GoalReached>,
    places: Res<'_, Places>,
    mut commands: Commands<'_, '_>,
    mut arrivals: Local<'_, usize>,
    mut exit: MessageWriter<'_, AppExit>,
) {
    *arrivals += 1;
    println!("{} has arrived", event.agent);
    commands.entity(event.agent).insert(Goal(places.0[*arrivals * 7 % places.0.len()]));
    if *arrivals == AGENTS {
        exit.write(AppExit::Success);
    }
}
