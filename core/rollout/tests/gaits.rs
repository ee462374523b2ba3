//! Gaits: distance from walls, ways without jumps, and slow turns.

use super::stage::{of_boxes, router};
use std::f32::consts::FRAC_PI_2;
use std::sync::Arc;
use surefoot_policy::Policy;
use surefoot_rollout::attempts::Played;
use surefoot_rollout::steer::Course;
use surefoot_rollout::{Goal, Rollout};
use surefoot_world::map::MapSize;
use surefoot_world::{Arrival, CharacterProfile, End, Gait, Map, NamedGait, TaskConfig, Vec3, World};

/// Height of the floor, m.
const FLOOR: f32 = 2.0;

/// A room of 24 x 24 m with solid boxes on its floor, each given by two corners, m, above the floor.
fn room(boxes: &[[Vec3; 2]]) -> Arc<Map> {
    let size = MapSize { width: 24, height: 40, depth: 24 };
    let side = 24.0;
    let above_floor = |solid: &[Vec3; 2]| solid.map(|corner| corner + Vec3::Y * FLOOR);
    let around = [
        [Vec3::ZERO, Vec3::new(side, 4.0, 0.5)],
        [Vec3::new(0.0, 0.0, side - 0.5), Vec3::new(side, 4.0, side)],
        [Vec3::ZERO, Vec3::new(0.5, 4.0, side)],
        [Vec3::new(side - 0.5, 0.0, 0.0), Vec3::new(side, 4.0, side)],
    ];
    let floor = [Vec3::new(0.0, 1.0, 0.0), Vec3::new(side, FLOOR, side)];
    of_boxes(size, around.iter().chain(boxes).map(above_floor).chain([floor]))
}

fn at(x: f32, z: f32) -> Vec3 {
    Vec3::new(x, FLOOR, z)
}

/// The attempts of an NPC with each of these gaits from one place of a map to another.
fn walk(map: &Arc<Map>, [start, goal]: [Vec3; 2], gaits: &[Gait]) -> Vec<Played> {
    let (policy, router) = (Policy::shipped().unwrap(), router(map, 80));
    let mut rollout = Rollout::new(map.clone(), CharacterProfile::default(), TaskConfig::default());
    rollout.follow.arrival = Arrival::Stand;
    let goal = Goal { start, yaw: 0.0, goal };
    let play = |gait: &Gait| {
        rollout.follow.gait = *gait;
        rollout.play(&policy, Some(&router), &[goal]).remove(0)
    };
    gaits.iter().map(play).collect()
}

/// The least distance from a vertical edge of a wall at `edge`, m, that a track has.
fn nearest(played: &Played, edge: Vec3) -> f32 {
    let distances = played.track.windows(2).flat_map(|pair| {
        let steps = (0..=8).map(|step| pair[0].lerp(pair[1], step as f32 / 8.0));
        steps.map(|place| (place - edge).with_y(0.0).length())
    });
    distances.fold(f32::INFINITY, f32::min)
}

#[test]
fn an_npc_keeps_its_distance_from_walls() {
    // A wall that ends in the middle of the room, with a way around its end.
    let map = room(&[[Vec3::new(11.5, 0.0, 0.0), Vec3::new(12.5, 30.0, 12.0)]]);
    let jog = Gait { wall_distance: 0.0, ..NamedGait::find("jog").unwrap().gait };
    let wide = Gait { wall_distance: 1.2, ..jog };
    let played = walk(&map, [at(6.0, 5.0), at(18.0, 5.0)], &[jog, wide, wide]);
    assert!(played.iter().all(|it| it.attempt.end == End::Reached), "{:?}", played[1].attempt);
    let [close, far] = [&played[0], &played[1]]
        .map(|it| [11.5, 12.5].map(|x| nearest(it, at(x, 12.0))).into_iter().fold(f32::INFINITY, f32::min));
    assert!(close < 1.2, "{close} m");
    // Its radius is 0.3 m.
    assert!(far > 0.3 + 0.8 * 1.2, "{far} m instead of {close} m");
    assert_eq!(played[1], played[2], "the same way each time");
}

#[test]
fn an_npc_that_keeps_more_distance_than_a_door_has_goes_through() {
    let wall = |from: f32, to: f32| [Vec3::new(11.5, 0.0, from), Vec3::new(12.5, 30.0, to)];
    let map = room(&[wall(0.0, 11.4), wall(12.6, 24.0)]);
    let wide = Gait { wall_distance: 2.0, ..NamedGait::find("walk").unwrap().gait };
    let played = walk(&map, [at(6.0, 8.0), at(18.0, 16.0)], &[wide]);
    assert_eq!(played[0].attempt.end, End::Reached);
}

/// The greatest height above the floor at which an NPC was, m.
fn highest(played: &Played) -> f32 {
    played.track.iter().map(|place| place.y - FLOOR).fold(0.0, f32::max)
}

#[test]
fn an_npc_that_avoids_jumps_walks_around_and_jumps_only_where_no_other_way_leads() {
    let run = Gait::default();
    let avoids = Gait { avoids_jumps: true, ..run };
    let low = |to: f32| room(&[[Vec3::new(11.0, 0.0, 0.0), Vec3::new(13.0, 0.9, to)]]);
    let ends = [at(6.0, 4.0), at(18.0, 4.0)];
    let around = walk(&low(20.0), ends, &[run, avoids]);
    assert!(around.iter().all(|it| it.attempt.end == End::Reached), "{:?}", around[1].attempt);
    assert!(highest(&around[0]) > 0.7, "it jumps over");
    assert!(highest(&around[1]) < 0.5, "it walks around, {} m high", highest(&around[1]));
    let over = walk(&low(24.0), ends, &[avoids]);
    assert_eq!(over[0].attempt.end, End::Reached);
    assert!(highest(&over[0]) > 0.7, "it jumps over");
}

#[test]
fn a_low_turn_rate_gives_a_wider_arc() {
    let profile = CharacterProfile::default();
    let map = room(&[]);
    // A body that walks along x, whose waypoint is to its side.
    let width = |turn_rate: f32| {
        let mut world = World::new(map.clone(), profile.clone(), TaskConfig::default());
        let slot = world.spawn(at(8.0, 6.0), FRAC_PI_2);
        let gait = Gait { speed: 0.13, turn_rate, ..Gait::default() };
        let mut course = Course { to: at(18.0, 6.0), then: None, cuts: true, gait, around: None };
        let (mut widest, mut fastest_turn) = (0.0f32, 0.0f32);
        for decision in 0..80 {
            if decision == 10 {
                course.to = at(world.npc(slot).unwrap().body.feet.x, 18.0);
            }
            let body = world.npc(slot).unwrap().body;
            let action = course.action(&body, &profile);
            fastest_turn = fastest_turn.max(action.turn.abs());
            world.decide(slot, action);
            world.tick_decision();
            if decision >= 10 {
                widest = widest.max(world.npc(slot).unwrap().body.feet.x - course.to.x);
            }
        }
        let body = world.npc(slot).unwrap().body;
        assert!(body.feet.z > 8.0 && fastest_turn <= turn_rate, "{body:?}");
        widest
    };
    let [tight, wide] = [1.0, 0.3].map(width);
    assert!(wide > 1.5 * tight, "{wide} m, {tight} m");
}
