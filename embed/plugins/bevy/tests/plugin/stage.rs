//! A level with its graph, and the apps that run on it.

#[cfg(feature = "avian")]
use avian3d::prelude::{Collider, PhysicsPlugins, RigidBody};
use bevy::app::App;
use bevy::ecs::prelude::*;
#[cfg(feature = "avian")]
use bevy::math::Vec3;
use bevy::prelude::{MinimalPlugins, TransformPlugin};
use bevy::time::{Fixed, Time, TimeUpdateStrategy};
#[cfg(feature = "avian")]
use bevy::transform::components::Transform;
#[cfg(feature = "avian")]
use bevy_surefoot::avian::SurefootAvianPlugin;
use bevy_surefoot::events::{GoalFailed, GoalReached};
use bevy_surefoot::{Failure, SurefootGraph, SurefootLevel, SurefootPlugin};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, OnceLock, PoisonError};

pub fn level_path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../game/examples/boxes.obj")
}

pub fn level() -> SurefootLevel {
    SurefootLevel::load(level_path()).expect("the level of the examples")
}

/// The graph of the level, which the program proves.
pub fn graph() -> SurefootGraph {
    static TEXT: OnceLock<String> = OnceLock::new();
    let text = TEXT.get_or_init(|| export(&level_path().display().to_string(), &[]));
    SurefootGraph::from_json(text).expect("the program wrote it").aligned_to(&level()).expect("it is of this level")
}

/// Lets the program prove the graph of a map.
pub fn export(map: &str, more: &[&str]) -> String {
    // One process at a time may have the cache open.
    static TURN: Mutex<()> = Mutex::new(());
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let program = std::env::var("SUREFOOT").expect("SUREFOOT names the program: run embed/plugins/bevy/check");
    let arguments = ["graph", "export", map, "--vertices", "60", "--format", "json"];
    let output = Command::new(program).args(arguments).args(more).output().expect("the program runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("JSON is text")
}

/// Goals that ended.
#[derive(Resource, Default, Debug)]
pub struct Ends {
    pub reached: Vec<Entity>,
    pub failed: Vec<(Entity, Failure)>,
}

/// An app without a window whose every update is a tick of 1/60 s.
pub fn app() -> App {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, TransformPlugin, SurefootPlugin::default()))
        .insert_resource(Time::<Fixed>::from_hz(60.0))
        .insert_resource(TimeUpdateStrategy::FixedTimesteps(1))
        .init_resource::<Ends>()
        .add_observer(|event: On<'_, '_, GoalReached>, mut ends: ResMut<'_, Ends>| ends.reached.push(event.agent))
        .add_observer(|event: On<'_, '_, GoalFailed>, mut ends: ResMut<'_, Ends>| {
            ends.failed.push((event.agent, event.failure));
        });
    app
}

/// Such an app on avian with ticks of this rate: a floor, and a box of 3 m on it.
#[cfg(feature = "avian")]
pub fn app_with_box(hz: f64) -> App {
    let mut app = app();
    app.add_plugins((PhysicsPlugins::default(), SurefootAvianPlugin)).insert_resource(Time::<Fixed>::from_hz(hz));
    let boxes = [([40.0, 1.0, 40.0], Vec3::new(0.0, -0.5, 0.0)), ([8.0, 3.0, 8.0], Vec3::new(6.0, 1.5, -6.0))];
    for ([x, y, z], centre) in boxes {
        let place = Transform::from_translation(centre);
        app.world_mut().spawn((RigidBody::Static, Collider::cuboid(x, y, z), place));
    }
    app.finish();
    app.cleanup();
    app
}
