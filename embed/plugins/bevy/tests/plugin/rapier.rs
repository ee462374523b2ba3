//! Agents on rapier's colliders, moved by its kinematic character controller.

use crate::crowd;
use crate::stage::{self, Ends};
use bevy::app::App;
use bevy_rapier3d::control::KinematicCharacterController;
use bevy_rapier3d::geometry::{Collider, CollisionGroups, Group, TriMeshFlags};
use bevy_rapier3d::plugin::{NoUserData, RapierPhysicsPlugin};
use bevy_surefoot::SurefootSurface;
use bevy_surefoot::rapier::SurefootRapierPlugin;

/// The groups of characters, which collide with the level alone.
const CHARACTERS: CollisionGroups = CollisionGroups::new(Group::GROUP_2, Group::GROUP_1);

fn app() -> App {
    let mut app = stage::app();
    app.add_plugins((RapierPhysicsPlugin::<NoUserData>::default().in_fixed_schedule(), SurefootRapierPlugin));
    for mesh in stage::level().meshes() {
        let shape = Collider::trimesh_with_flags(mesh.corners, mesh.indices, TriMeshFlags::FIX_INTERNAL_EDGES);
        let shape = shape.expect("a level has triangles");
        app.world_mut().spawn((shape, SurefootSurface(mesh.surface)));
    }
    app.finish();
    app.cleanup();
    app.update();
    app
}

#[test]
fn a_crowd_arrives_by_plan() {
    let mut app = app();
    let controller =
        KinematicCharacterController { filter_groups: Some(CHARACTERS), ..KinematicCharacterController::default() };
    let crowd = crowd::spawn(&mut app, &stage::graph(), (controller, CHARACTERS));
    let (ticks, _) = crowd::run(&mut app, crowd.len());
    let ends = app.world().resource::<Ends>();
    println!("{} of {} arrived within {ticks} ticks", ends.reached.len(), crowd.len());
    assert!(ends.failed.is_empty(), "{:?}", ends.failed);
}
