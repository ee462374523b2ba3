//! Goals that move, and arrivals: on a floor of avian's, with bodies that the tests move themselves.

use crate::stage::{self, Ends};
use avian3d::prelude::{Collider, PhysicsPlugins, RigidBody, Sensor};
use bevy::app::App;
use bevy::ecs::prelude::*;
use bevy::math::Vec3;
use bevy::transform::components::Transform;
use bevy_surefoot::avian::SurefootAvianPlugin;
use bevy_surefoot::{AgentPlan, AgentState, AgentStatus, Failure, Goal, GoalRadius, SurefootAgent, SurefootCharacter};

fn cuboid(app: &mut App, [x, y, z]: [f32; 3], centre: Vec3) -> Entity {
    let shape = (RigidBody::Static, Collider::cuboid(x, y, z), Transform::from_translation(centre));
    app.world_mut().spawn(shape).id()
}

/// A floor at 0 m.
fn floor() -> App {
    let mut app = stage::app();
    app.add_plugins((PhysicsPlugins::default(), SurefootAvianPlugin));
    cuboid(&mut app, [60.0, 1.0, 60.0], Vec3::new(0.0, -0.5, 0.0));
    app.finish();
    app.cleanup();
    app
}

/// Puts the body of an agent somewhere, and lets a tick pass. Returns what the agent is doing.
fn stand(app: &mut App, agent: Entity, feet: Vec3, is_grounded: bool) -> AgentStatus {
    *app.world_mut().get_mut::<AgentState>(agent).unwrap() = AgentState { feet, is_grounded, ..AgentState::default() };
    app.update();
    app.world().get::<AgentPlan>(agent).unwrap().status
}

#[test]
fn an_agent_arrives_where_it_stands_with_nothing_solid_between() {
    let mut app = floor();
    let goal = Vec3::new(5.0, 0.0, 0.0);
    let wall = cuboid(&mut app, [0.1, 4.0, 4.0], Vec3::new(5.5, 2.0, 0.0));
    let agent = app.world_mut().spawn((SurefootAgent::default(), Goal(goal))).id();
    for _ in 0..3 {
        app.update();
    }
    let (near, behind) = (goal - Vec3::X * 0.8, goal + Vec3::X * 0.8);
    let cases = [
        ("in the air", near, false),
        ("on another floor", goal + Vec3::Y * 0.9, true),
        ("behind the wall", behind, true),
        ("too far", goal - Vec3::X * 1.1, true),
    ];
    for (case, feet, is_grounded) in cases {
        assert_eq!(stand(&mut app, agent, feet, is_grounded), AgentStatus::Heading, "{case}");
    }
    app.world_mut().entity_mut(agent).insert(GoalRadius(0.5));
    assert_eq!(stand(&mut app, agent, near, true), AgentStatus::Heading, "outside its own radius");
    app.world_mut().entity_mut(agent).insert(GoalRadius(0.85));
    app.world_mut().entity_mut(wall).insert(Sensor);
    stand(&mut app, agent, Vec3::ZERO, true);
    assert_eq!(stand(&mut app, agent, behind, true), AgentStatus::Reached, "through a sensor");
    assert_eq!(app.world().resource::<Ends>().reached, [agent]);
}

#[test]
fn a_goal_that_is_changed_in_every_tick_keeps_its_plan_until_it_has_drifted() {
    let mut app = floor();
    let graph = stage::graph();
    let vertices = graph.vertices();
    let start = vertices[0];
    let is_far = |goal: &&Vec3| {
        let plan = graph.find_path(&surefoot_planner::Query::new(start, **goal));
        goal.distance(start) > 12.0 && plan.no_path.is_none() && plan.legs.len() > 2
    };
    let nearer = |a: &&Vec3, b: &&Vec3| a.distance(start).total_cmp(&b.distance(start));
    let goal = *vertices.iter().filter(is_far).min_by(nearer).expect("a goal that is legs away");
    let agent = app.world_mut().spawn((SurefootAgent::default(), Goal(goal), graph.clone())).id();
    stand(&mut app, agent, start, true);
    let plan = |app: &App| app.world().get::<AgentPlan>(agent).unwrap().clone();
    for tick in 1..=40u8 {
        app.world_mut().entity_mut(agent).insert(Goal(goal + Vec3::X * (0.02 * f32::from(tick))));
        stand(&mut app, agent, start, true);
    }
    assert_eq!((plan(&app).status, plan(&app).plan_count), (AgentStatus::Following, 1), "0.8 m are no drift");
    // Moves of less than 4 m are those of a target, which comes nearer here.
    let mut drifted = goal;
    for _ in 0..4 {
        drifted += (start - drifted).normalize() * 2.0;
        for _ in 0..10 {
            app.world_mut().entity_mut(agent).insert(Goal(drifted));
            stand(&mut app, agent, start, true);
        }
    }
    assert!((2..4).contains(&plan(&app).plan_count), "other plans of the same attempt: {:?}", plan(&app));
    let elsewhere = *vertices.iter().max_by(|a, b| a.distance(goal).total_cmp(&b.distance(goal))).unwrap();
    app.world_mut().entity_mut(agent).insert(Goal(elsewhere));
    stand(&mut app, agent, start, true);
    assert!(plan(&app).plan_count <= 1, "another attempt");
}

#[test]
fn an_agent_catches_a_target_that_moves_and_one_that_is_stuck_gives_up() {
    let mut app = floor();
    let agent = SurefootAgent::default();
    let target = |tick: u16| Goal(Vec3::new(8.0 + (0.04 * f32::from(tick)).min(8.0), 0.0, 4.0));
    let place = SurefootCharacter::standing_at(Vec3::ZERO, &agent.body);
    let chaser = app.world_mut().spawn((agent, SurefootCharacter::default(), place, target(0))).id();
    for tick in 0..900 {
        app.world_mut().entity_mut(chaser).insert(target(tick));
        app.update();
        if !app.world().resource::<Ends>().reached.is_empty() {
            break;
        }
    }
    assert_eq!(app.world().resource::<Ends>().reached, [chaser]);
    assert!(app.world().get::<AgentState>(chaser).unwrap().is_grounded);
    app.world_mut().despawn(chaser);
    // The target goes on and on, but this body never moves.
    let stuck = app.world_mut().spawn(SurefootAgent::default()).id();
    let mut x = 5.0;
    for _ in 0..310 * 10 {
        x += 0.01;
        app.world_mut().entity_mut(stuck).insert(Goal(Vec3::new(x, 0.0, 0.0)));
        stand(&mut app, stuck, Vec3::ZERO, true);
        if !app.world().resource::<Ends>().failed.is_empty() {
            break;
        }
    }
    assert_eq!(app.world().resource::<Ends>().failed, [(stuck, Failure::NoProgress)]);
}
