//! Tests of what the character can and cannot do: it climbs neither faces that are too steep nor steps that are too
//! high, it does not jump off faces it cannot stand on, and characters ignore each other.

use bevy_surefoot::{LevelFormat, SurefootLevel};
use surefoot_bevy_world::{app, scene};
use surefoot_game::{Action, BodyState, CharacterProfile, Command, GameWorld, Level, Vec3};

/// Decisions that each attempt lasts.
const DECISIONS: usize = 20;
/// Width of a lane, m, and where along it the obstacle begins.
const LANE_M: f32 = 4.0;
const OBSTACLE_AT_M: f32 = 8.0;

/// A level of lanes along z, each with an obstacle: corners of a quadrilateral in (y, z), as wide as the lane.
fn lanes(obstacles: &[Vec<[(f32, f32); 2]>]) -> SurefootLevel {
    let mut obj = String::new();
    let mut count = 0;
    let mut quad = |low: f32, high: f32, [(from_y, from_z), (to_y, to_z)]: [(f32, f32); 2]| {
        for (x, y, z) in [(low, from_y, from_z), (low, to_y, to_z), (high, to_y, to_z), (high, from_y, from_z)] {
            obj += &format!("v {x} {y} {z}\n");
        }
        obj += &format!("f {} {} {} {}\n", count + 1, count + 2, count + 3, count + 4);
        count += 4;
    };
    for (idx, faces) in obstacles.iter().enumerate() {
        let (low, high) = (LANE_M * idx as f32, LANE_M * (idx + 1) as f32);
        quad(low, high, [(0.0, 0.0), (0.0, OBSTACLE_AT_M)]);
        faces.iter().for_each(|face| quad(low, high, *face));
    }
    SurefootLevel::from_bytes(obj.as_bytes(), LevelFormat::Obj).expect("lanes are a level")
}

/// A ramp of that slope, degrees, 3 m high, and the plateau behind it.
fn ramp(degrees: f32) -> Vec<[(f32, f32); 2]> {
    let end = OBSTACLE_AT_M + 3.0 / degrees.to_radians().tan();
    vec![[(0.0, OBSTACLE_AT_M), (3.0, end)], [(3.0, end), (3.0, 40.0)]]
}

/// A step of that height, m, and the floor behind it.
fn step(height: f32) -> Vec<[(f32, f32); 2]> {
    vec![[(0.0, OBSTACLE_AT_M), (height, OBSTACLE_AT_M)], [(height, OBSTACLE_AT_M), (height, 40.0)]]
}

/// Lets a character in each lane repeat `action`, and returns its states after each tick, with feet relative to the
/// lane.
fn run(level: &SurefootLevel, lane_count: usize, action: Action) -> Vec<Vec<BodyState>> {
    let (scene, calls) = scene(level);
    let mut app = app(level, calls);
    let origin = level.origin();
    let driver = std::thread::spawn(move || {
        let mut world = scene.open(&CharacterProfile::default(), lane_count).unwrap();
        drop(scene);
        for lane in 0..lane_count {
            world.place(lane, origin + Vec3::new(LANE_M * (lane as f32 + 0.5), 0.0, 2.0), 0.0);
        }
        let tick = |world: &mut Box<dyn GameWorld>, is_first| {
            let commands: Vec<(usize, Command)> =
                (0..lane_count).map(|lane| (lane, Command { action, is_first })).collect();
            world.tick(&commands);
            let state = |lane| {
                let state = world.state(lane);
                BodyState { feet: state.feet - origin, ..state }
            };
            (0..lane_count).map(state).collect::<Vec<_>>()
        };
        (0..10 * DECISIONS).map(|idx| tick(&mut world, idx % 10 == 0)).collect::<Vec<_>>()
    });
    app.run();
    driver.join().unwrap()
}

fn highest(ticks: &[Vec<BodyState>], lane: usize) -> f32 {
    ticks.iter().map(|states| states[lane].feet.y).fold(0.0, f32::max)
}

#[test]
fn slopes_are_climbed_up_to_the_steepest_that_the_body_can_walk_on() {
    let slopes = [20.0, 30.0, 34.0, 37.0, 45.0, 60.0, 80.0];
    let level = lanes(&slopes.map(ramp));
    let ahead = Action { forward: 1.0, ..Action::default() };
    let ticks = run(&level, slopes.len(), ahead);
    for (lane, degrees) in slopes.into_iter().enumerate() {
        let highest = highest(&ticks, lane);
        println!("{degrees} degrees: {highest:.2} m");
        assert_eq!(highest > 2.9, degrees <= 35.0, "{degrees} degrees: {highest} m");
        let stands = ticks.iter().skip(60).all(|states| states[lane].is_grounded);
        assert!(stands || degrees <= 35.0, "{degrees} degrees: it stands at the foot of the face");
        // No higher than a step where it cannot walk.
        assert!(degrees <= 35.0 || highest <= 0.13, "{degrees} degrees: {highest} m");
    }
}

#[test]
fn steps_are_climbed_up_to_the_height_of_a_step() {
    let heights = [0.04, 0.1, 0.2, 0.3, 0.34, 0.4, 0.5];
    let level = lanes(&heights.map(step));
    let ticks = run(&level, heights.len(), Action { forward: 1.0, ..Action::default() });
    for (lane, height) in heights.into_iter().enumerate() {
        let last = ticks.last().unwrap()[lane].feet;
        println!("{height} m: at {last}");
        let climbs = height <= CharacterProfile::default().step_height;
        assert_eq!(last.z > OBSTACLE_AT_M + 1.0, climbs, "{height} m: at {last}");
    }
}

#[test]
fn nobody_jumps_off_a_face_that_is_too_steep() {
    // A jump and a double jump rise at most 2.5 m each: a character that jumped off the face would climb on.
    let slopes = [40.0, 50.0, 60.0, 75.0];
    let high = |degrees: f32| vec![[(0.0, OBSTACLE_AT_M), (12.0, OBSTACLE_AT_M + 12.0 / degrees.to_radians().tan())]];
    let level = lanes(&slopes.map(high));
    let ticks = run(&level, slopes.len(), Action { forward: 1.0, jump: 1.0, ..Action::default() });
    for (lane, degrees) in slopes.into_iter().enumerate() {
        let highest = highest(&ticks, lane);
        println!("{degrees} degrees: {highest:.2} m");
        assert!(highest <= 5.1, "{degrees} degrees: {highest} m");
        for states in &ticks {
            let state = states[lane];
            assert!(!state.is_grounded || state.feet.y <= 0.13, "{degrees} degrees: grounded at {}", state.feet);
        }
    }
}

#[test]
fn walls_stop_bodies_and_the_ground_carries_them() {
    let level = lanes(&[step(3.0)]);
    let ticks = run(&level, 1, Action { forward: 1.0, ..Action::default() });
    let last = ticks.last().unwrap()[0];
    assert!(last.feet.z < OBSTACLE_AT_M - 0.28 && last.feet.z > OBSTACLE_AT_M - 0.36, "{}", last.feet);
    assert!(last.velocity.length() < 0.5, "{}", last.velocity);
    assert!(ticks.iter().skip(10).all(|states| states[0].is_grounded && states[0].feet.y.abs() < 0.03));
}
