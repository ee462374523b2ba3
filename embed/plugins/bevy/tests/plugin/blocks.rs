//! Agents that rehearse around what the app has put into its level.

use crate::stage::{self, Ends};
use avian3d::prelude::{Collider, PhysicsPlugins, RigidBody};
use bevy::app::App;
use bevy::ecs::prelude::*;
use bevy::math::{Quat, Vec3};
use bevy::transform::components::Transform;
use bevy_surefoot::avian::SurefootAvianPlugin;
use bevy_surefoot::{
    AgentState, Goal, LevelFormat, SurefootAgent, SurefootBlock, SurefootCharacter, SurefootGraph, SurefootLevel,
};
use std::f32::consts::FRAC_PI_2;
use std::path::Path;
use std::sync::OnceLock;

/// A level floor of 60 by 20 m.
const FLOOR: &str = "v -30 0 -10\nv 30 0 -10\nv 30 0 10\nv -30 0 10\nf 4 3 2 1\n";
/// Where agents start and arrive across the floor, m.
const STARTS_Z: [f32; 5] = [-4.0, -2.0, 0.0, 2.0, 4.0];
/// Ticks in which agents make their first decisions.
const FIRST_TICKS: usize = 12;
/// Ticks within which all agents must have arrived or failed.
const MAX_TICKS: usize = 7200;

/// A pocket that is open towards the agents: its back lies across the floor, and its sides along it.
fn pocket() -> [SurefootBlock; 3] {
    let side = |z: f32| SurefootBlock { centre: Vec3::new(-5.0, 3.0, z), size: Vec3::new(10.0, 6.0, 1.0), yaw: 0.0 };
    let back = SurefootBlock { centre: Vec3::Y * 3.0, size: Vec3::new(14.0, 6.0, 1.0), yaw: FRAC_PI_2 };
    [back, side(-7.0), side(7.0)]
}

fn level() -> SurefootLevel {
    SurefootLevel::from_bytes(FLOOR.as_bytes(), LevelFormat::Obj).expect("a floor")
}

fn graph() -> SurefootGraph {
    static TEXT: OnceLock<String> = OnceLock::new();
    let text = TEXT.get_or_init(|| {
        let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("floor.obj");
        std::fs::write(&file, FLOOR).expect("a folder of this test");
        stage::export(&file.display().to_string(), &[])
    });
    let graph = SurefootGraph::from_json(text).expect("the program wrote it");
    graph.aligned_to(&level()).expect("it is of this level").rehearsed_on(&level(), 0)
}

/// Lets agents cross the floor, whose rehearsals know the blocks `first` and, after their first decisions, those of
/// `then`. Returns the ticks that they spend in the pocket, added up, and how many arrive.
fn cross(first: &[SurefootBlock], then: &[SurefootBlock]) -> (usize, usize) {
    let graph = graph();
    graph.set_blocks(first).unwrap();
    let mut app = stage::app();
    app.add_plugins((PhysicsPlugins::default(), SurefootAvianPlugin));
    let ground = SurefootBlock { centre: Vec3::Y * -0.5, size: Vec3::new(60.0, 1.0, 20.0), yaw: 0.0 };
    for SurefootBlock { centre, size, yaw } in pocket().into_iter().chain([ground]) {
        let place = Transform::from_translation(centre).with_rotation(Quat::from_rotation_y(yaw));
        app.world_mut().spawn((RigidBody::Static, Collider::cuboid(size.x, size.y, size.z), place));
    }
    app.finish();
    app.cleanup();
    app.update();
    let agents = STARTS_Z.map(|z| spawn(&mut app, &graph, z));
    let mut ticks_inside = 0;
    for tick in 0..MAX_TICKS {
        if tick == FIRST_TICKS {
            graph.set_blocks(then).unwrap();
        }
        app.update();
        let is_inside = |agent: &&Entity| {
            let feet = app.world().get::<AgentState>(**agent).expect("an agent").feet;
            (-10.0..0.0).contains(&feet.x) && feet.z.abs() < 7.0
        };
        ticks_inside += agents.iter().filter(is_inside).count();
        let ends = app.world().resource::<Ends>();
        if ends.reached.len() + ends.failed.len() == agents.len() {
            break;
        }
    }
    (ticks_inside, app.world().resource::<Ends>().reached.len())
}

fn spawn(app: &mut App, graph: &SurefootGraph, z: f32) -> Entity {
    let agent = SurefootAgent { seed: 7, ..SurefootAgent::default() };
    let place = SurefootCharacter::standing_at(Vec3::new(-25.0, 0.0, z), &agent.body);
    let goal = Goal(Vec3::new(25.0, 0.0, z));
    app.world_mut().spawn((agent, SurefootCharacter::facing(FRAC_PI_2), place, goal, graph.clone())).id()
}

#[test]
fn agents_go_around_blocks_that_an_app_adds_and_forget_those_that_it_removes() {
    let (none, all): (&[SurefootBlock], &[SurefootBlock]) = (&[], &pocket());
    let [ignorant, aware, forgetful] = [(none, none), (none, all), (all, none)].map(|(first, then)| cross(first, then));
    println!("ticks in the pocket, and arrivals: {ignorant:?} {aware:?} {forgetful:?}");
    assert_eq!(aware.1, STARTS_Z.len());
    assert!(2 * aware.0 < ignorant.0.min(forgetful.0), "{ignorant:?} {aware:?} {forgetful:?}");
}

#[test]
fn blocks_that_cannot_be_used_are_rejected_by_name() {
    let [block, ..] = pocket();
    let flat = SurefootBlock { size: Vec3::new(1.0, 0.0, 1.0), ..block };
    let message = graph().set_blocks(&[block, flat]).unwrap_err().to_string();
    assert!(message.contains("height of the piece `blocks[1]` is 0"), "{message}");
    let message = stage::graph().set_blocks(&[block]).unwrap_err().to_string();
    assert!(message.contains("rehearsed_on"), "{message}");
}
