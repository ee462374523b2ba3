//! Agents on avian's colliders, moved by its move and slide.

use crate::crowd;
use crate::stage::{self, Ends};
use avian3d::prelude::{Collider, PhysicsPlugins, RigidBody, TrimeshFlags};
use bevy::app::App;
use bevy::ecs::prelude::*;
use bevy::math::Vec3;
use bevy_surefoot::avian::SurefootAvianPlugin;
use bevy_surefoot::events::{AgentDied, LegFailed};
use bevy_surefoot::{
    AgentPlan, AgentState, AgentStatus, Failure, Goal, NoPath, SurefootAgent, SurefootCharacter, SurefootGraph,
    SurefootSurface,
};

fn app() -> App {
    let mut app = stage::app();
    app.add_plugins((PhysicsPlugins::default(), SurefootAvianPlugin));
    for mesh in stage::level().meshes() {
        let shape = Collider::trimesh_with_config(mesh.corners, mesh.indices, TrimeshFlags::FIX_INTERNAL_EDGES);
        app.world_mut().spawn((RigidBody::Static, shape, SurefootSurface(mesh.surface)));
    }
    app.finish();
    app.cleanup();
    // Colliders are found only once physics has run.
    app.update();
    app
}

#[test]
fn a_crowd_arrives_by_plan_calmly_if_it_rehearses_and_equal_seeds_give_equal_bits() {
    let attempt = |graph: &SurefootGraph| {
        let mut app = app();
        let crowd = crowd::spawn(&mut app, graph, ());
        let (ticks, jumps) = crowd::run(&mut app, crowd.len());
        let ends = app.world().resource::<Ends>();
        println!("{} of {} arrived within {ticks} ticks, with {jumps} jumps", ends.reached.len(), crowd.len());
        assert!(ends.failed.is_empty(), "{:?}", ends.failed);
        let state = |agent: &Entity| *app.world().get::<AgentState>(*agent).unwrap();
        (jumps, (ticks, crowd.iter().map(state).collect::<Vec<_>>()))
    };
    // Agents of one graph learn from one another.
    let (jumps, run) = attempt(&stage::graph());
    assert_eq!(attempt(&stage::graph()).1, run);
    let rehearsed = || stage::graph().rehearsed_on(&stage::level(), 0);
    let (fewer, calm) = attempt(&rehearsed());
    assert_eq!(attempt(&rehearsed()).1, calm);
    assert!(2 * fewer < jumps, "{fewer} jumps with rehearsals, {jumps} without");
}

/// The scene of docs/guides/bevy.md.
#[test]
fn without_a_graph_an_agent_jumps_onto_a_box() {
    let mut app = stage::app_with_box(60.0);
    let agent = SurefootAgent::default();
    let place = SurefootCharacter::standing_at(Vec3::new(-6.0, 0.0, 6.0), &agent.body);
    let goal = Goal(Vec3::new(6.0, 3.0, -6.0));
    let spawned = app.world_mut().spawn((agent, SurefootCharacter::default(), place, goal)).id();
    crowd::run(&mut app, 1);
    assert_eq!(app.world().resource::<Ends>().reached, [spawned]);
}

#[test]
fn an_unreachable_goal_ends_with_its_reason_as_near_as_paths_lead() {
    let mut app = app();
    let graph = stage::graph();
    let start = graph.vertices()[0];
    let agent = SurefootAgent::default();
    let place = SurefootCharacter::standing_at(start, &agent.body);
    let goal = Goal(start + Vec3::Y * 500.0);
    let lost = app.world_mut().spawn((agent, SurefootCharacter::default(), place, goal, graph)).id();
    crowd::run(&mut app, 1);
    let failure = Failure::Unreachable(Some(NoPath::GoalOffGraph));
    assert_eq!(app.world().resource::<Ends>().failed, [(lost, failure)]);
    assert_eq!(app.world().get::<AgentPlan>(lost).unwrap().status, AgentStatus::Failed(failure));
    assert!(failure.to_string().contains("near the goal"));
}

#[test]
fn a_death_ends_the_attempt_and_another_goal_begins_one() {
    let mut app = app();
    app.init_resource::<Dead>().add_observer(|event: On<'_, '_, LegFailed>, mut dead: ResMut<'_, Dead>| {
        dead.0 += usize::from(event.died);
    });
    let crowd = crowd::spawn(&mut app, &stage::graph(), ());
    for _ in 0..30 {
        app.update();
    }
    let agent = crowd[0];
    app.world_mut().trigger(AgentDied { agent });
    app.world_mut().flush();
    assert_eq!(app.world().resource::<Dead>().0, 1);
    assert_eq!(std::mem::take(&mut app.world_mut().resource_mut::<Ends>().failed), [(agent, Failure::Died)]);
    let goal = *app.world().get::<Goal>(agent).unwrap();
    app.world_mut().entity_mut(agent).insert(goal);
    crowd::run(&mut app, crowd.len());
    assert!(app.world().resource::<Ends>().reached.contains(&agent));
}

#[derive(Resource, Default)]
struct Dead(usize);

#[test]
fn without_a_goal_an_agent_stands_and_forgets_its_plan() {
    let mut app = app();
    let crowd = crowd::spawn(&mut app, &stage::graph(), ());
    for _ in 0..60 {
        app.update();
    }
    let agent = crowd[0];
    assert_eq!(app.world().get::<AgentPlan>(agent).unwrap().status, AgentStatus::Following);
    app.world_mut().entity_mut(agent).remove::<Goal>();
    for _ in 0..120 {
        app.update();
    }
    assert_eq!(app.world().get::<AgentPlan>(agent).unwrap().status, AgentStatus::Idle);
    assert!(app.world().get::<SurefootCharacter>(agent).unwrap().velocity.length() < 0.01);
}
