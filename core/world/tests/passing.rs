//! NPCs that pass others at rest in corridors.

use std::sync::Arc;
use surefoot_world::float::{heading, wrapped};
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{
    Action, CharacterProfile, Map, NpcSlot, TICKS_PER_DECISION, TICKS_PER_SECOND, TaskConfig, Vec3, World, WorldConfig,
};

const MIDDLE: Vec3 = Vec3::new(20.0, 1.0, 20.0);

/// How an NPC passed another at rest.
struct Passing {
    /// Time for 16 m along the corridor, s; `None`: it took more than 20 s.
    seconds: Option<f32>,
    /// How far the other was moved in the end, m, and how far it went altogether, m.
    moved_m: f32,
    went_m: f32,
    /// How often its direction of motion reversed.
    reversals: u32,
}

/// A corridor along z, so many metres wide, from wall to wall.
fn corridor(width: f32) -> World {
    let walls = [MIDDLE.x - 0.5 * width, MIDDLE.x + 0.5 * width];
    let boxes = [
        ([0.0, 0.0, 0.0], [40.0, 1.0, 40.0]),
        ([walls[0] - 1.0, 1.0, 2.0], [walls[0], 5.0, 38.0]),
        ([walls[1], 1.0, 2.0], [walls[1] + 1.0, 5.0, 38.0]),
    ];
    let faces = boxes.into_iter().flat_map(|(low, high)| cuboid(Vec3::from(low), Vec3::from(high)));
    let triangles = faces.filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect();
    let map = Map::from_parts(MapSize { width: 40, depth: 40, height: 10 }, triangles, Placed::default());
    let profiles = vec![CharacterProfile::default()];
    World::with_config(Arc::new(map), WorldConfig { profiles, task: TaskConfig::default(), npc_collision: true })
}

/// Lets an NPC go from 8 m before the middle to 8 m behind it, at a share of its top speed, while another rests at an
/// offset from the middle, m.
fn pass(width: f32, offset: Vec3, speed: f32) -> Passing {
    let mut world = corridor(width);
    let resting = world.spawn(MIDDLE + offset, 0.0);
    let passing = world.spawn(MIDDLE - 8.0 * Vec3::Z, 0.0);
    let goal = MIDDLE + 8.0 * Vec3::Z;
    let feet = |world: &World, slot: NpcSlot| world.npc(slot).unwrap().body.feet;
    let (mut last_step, mut went_m, mut reversals) = (Vec3::ZERO, 0.0, 0);
    let mut seconds = None;
    let from = feet(&world, resting);
    for tick in 0..20 * TICKS_PER_SECOND {
        let body = world.npc(passing).unwrap().body;
        if tick % TICKS_PER_DECISION == 0 && seconds.is_none() {
            let way = (goal - body.feet).with_y(0.0);
            let local = body.to_local(way.normalize_or_zero()) * speed;
            let turn = (wrapped(heading(way) - body.yaw) * 6.0).clamp(-1.0, 1.0);
            let is_there = way.length() < 0.7;
            let action = Action { forward: local.z, strafe: (local.x / 0.6).clamp(-1.0, 1.0), turn, jump: -1.0 };
            world.decide(passing, if is_there { Action::default() } else { action });
            seconds = is_there.then_some(tick as f32 / TICKS_PER_SECOND as f32);
        }
        let before = feet(&world, resting);
        world.tick();
        let step = (feet(&world, resting) - before).with_y(0.0);
        went_m += step.length();
        if step.length() > 1.0e-3 {
            reversals += u32::from(step.dot(last_step) < 0.0);
            last_step = step;
        }
    }
    Passing { seconds, moved_m: feet(&world, resting).distance(from), went_m, reversals }
}

#[test]
fn an_npc_at_rest_makes_way_once_in_corridors_and_stays_there() {
    for (width, speed) in [2.0, 1.6, 1.2].into_iter().flat_map(|width| [0.15, 0.4, 1.0].map(|speed| (width, speed))) {
        let free = pass(width, 14.0 * Vec3::Z, speed).seconds.expect("nothing is in the way");
        for beside in [0.0, 0.05, 0.2, 0.3] {
            let Passing { seconds, moved_m, went_m, reversals } = pass(width, beside * Vec3::X, speed);
            let what = format!("{width} m wide, speed {speed}, {beside} m beside the middle");
            println!(
                "{what}: {seconds:?} s, {free} s if free, moved {moved_m} m, went {went_m} m, {reversals} reversals"
            );
            assert!(seconds.is_some_and(|seconds| seconds < free + 1.0), "{what}: {seconds:?} s, not {free} s");
            assert!(moved_m < 0.55 && went_m < moved_m + 0.1, "{what}: moved {moved_m} m, went {went_m} m");
            assert_eq!(reversals, 0, "{what}");
        }
    }
}
