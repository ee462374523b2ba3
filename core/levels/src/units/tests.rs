//! Levels in metres and in other units.

use super::*;

type Faces = Vec<[Vec3; 3]>;

/// A box with its fronts outside.
fn cuboid(low: [f32; 3], high: [f32; 3]) -> Faces {
    let corner =
        |idx: usize| Vec3::new([low, high][idx & 1][0], [low, high][idx >> 1 & 1][1], [low, high][idx >> 2][2]);
    let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = |[a, b, c, d]: [usize; 4]| [[a, b, c], [a, c, d]].map(|triangle| triangle.map(corner));
    sides.into_iter().flat_map(triangles).collect()
}

fn ground() -> Faces {
    cuboid([-20.0, -0.5, -20.0], [20.0, 0.0, 20.0])
}

/// A flight of steps from the ground, as boxes beside each other.
fn stair(count: usize, rise: f32, run: f32) -> Faces {
    let step = |idx: usize| {
        let (x, top) = (idx as f32 * run, (idx + 1) as f32 * rise);
        cuboid([x, 0.0, 0.0], [x + run, top, 1.2])
    };
    (0..count).flat_map(step).collect()
}

/// A wall along x with doorways.
fn wall(count: usize, z: f32, height: f32) -> Faces {
    let bay = |idx: usize| {
        let x = idx as f32 * 3.0 - 15.0;
        let pillar = cuboid([x, 0.0, z], [x + 2.0, 3.0, z + 0.2]);
        [pillar, cuboid([x + 2.0, height, z], [x + 3.0, 3.0, z + 0.2])].concat()
    };
    let end = count as f32 * 3.0 - 15.0;
    [(0..count).flat_map(bay).collect(), cuboid([end, 0.0, z], [end + 1.0, 3.0, z + 0.2])].concat()
}

fn scaled(faces: &[[Vec3; 3]], times: f32) -> Faces {
    faces.iter().map(|corners| corners.map(|corner| corner * times + Vec3::new(300.0, -20.0, 7.0))).collect()
}

fn times(faces: &[[Vec3; 3]]) -> Option<f64> {
    suggest(faces, &[], 1.0).map(|suggestion| suggestion.times)
}

#[test]
fn steps_and_doorways_tell_the_unit() {
    let stairs = [ground(), stair(8, 0.17, 0.29)].concat();
    let doors = [ground(), wall(6, 5.0, 2.1)].concat();
    for level in [&stairs, &doors, &[stairs.clone(), doors.clone()].concat()] {
        for unit in [0.001, 0.01, 0.0254, 10.0, 100.0, 1000.0] {
            assert_eq!(times(&scaled(level, (1.0 / unit) as f32)), Some(unit), "{unit} m");
        }
        assert_eq!(times(&scaled(level, 1.0)), None);
    }
    // Feet are too near to metres for steps to tell.
    assert_eq!((times(&scaled(&doors, 3.28)), times(&scaled(&stairs, 3.28))), (Some(0.3048), None));
    let evidence = suggest(&scaled(&stairs, 100.0), &[], 1.0).map(|suggestion| suggestion.evidence);
    assert_eq!(evidence.as_deref(), Some("7 steps are 17 units high"));
}

#[test]
fn levels_of_games_have_their_own_units() {
    let sauerbraten = [scaled(&ground(), 8.0), scaled(&stair(12, 0.5, 2.0), 8.0)].concat();
    assert_eq!(times(&sauerbraten), Some(0.12));
    let quake = [scaled(&ground(), 32.0), scaled(&stair(8, 0.5, 0.75), 32.0)].concat();
    let doors: Vec<(&str, Aabb)> = vec![("door_1", Aabb::from((Vec3::ZERO, Vec3::new(64.0, 112.0, 8.0)))); 4];
    assert_eq!(suggest(&quake, &doors, 1.0).map(|suggestion| suggestion.times), Some(0.031_25));
}

#[test]
fn names_count_if_enough_agree() {
    let named = |name: &'static str, heights: &[f32]| -> Vec<(&str, Aabb)> {
        heights.iter().map(|&height| (name, Aabb::from((Vec3::ZERO, Vec3::new(90.0, height, 4.0))))).collect()
    };
    let level = scaled(&ground(), 100.0);
    let suggested = |named: &[(&str, Aabb)]| suggest(&level, named, 1.0).map(|suggestion| suggestion.times);
    assert_eq!(suggested(&named("Railing", &[95.0, 100.0, 100.0, 105.0])), Some(0.01));
    assert_eq!(suggested(&named("Door_A", &[205.0, 210.0, 210.0, 212.0, 400.0])), Some(0.01));
    assert_eq!(suggested(&named("Door_A", &[210.0, 210.0, 210.0])), None, "three are too few");
    assert_eq!(suggested(&named("Door_A", &[210.0, 300.0, 400.0, 100.0, 55.0])), None, "they differ");
    assert_eq!(suggested(&named("Table", &[75.0; 9])), None);
    // Of two kinds, one fits people.
    let mixed = [named("Door_A", &[210.0; 5]), named("railing", &[1.0; 5])].concat();
    assert_eq!(suggested(&mixed), None);
}

#[test]
fn what_is_no_stair_or_doorway_tells_nothing() {
    let stair_of = |rise: f32, run: f32| scaled(&[ground(), stair(8, rise, run)].concat(), 100.0);
    // Terraces, ladders, and two steps.
    assert_eq!(times(&stair_of(0.2, 2.0)), None);
    assert_eq!(times(&stair_of(0.3, 0.1)), None);
    assert_eq!(times(&scaled(&[ground(), stair(2, 0.17, 0.3)].concat(), 100.0)), None);
    // Windows with sills, and a roof on posts.
    let sill = (0..6).flat_map(|idx| cuboid([idx as f32 * 3.0 - 13.0, 0.0, 5.0], [idx as f32 * 3.0 - 12.0, 0.9, 5.2]));
    let windows = [ground(), wall(6, 5.0, 2.1), sill.collect()].concat();
    assert_eq!(times(&scaled(&windows, 100.0)), None);
    assert_eq!(times(&[]), None);
    assert_eq!(times(&[[Vec3::ONE; 3]]), None);
}

#[test]
fn tiny_levels_are_asked_about_unless_they_fit() {
    for (side, expected) in [(0.02_f32, Some(1000.0)), (0.3, Some(100.0)), (3.0, Some(10.0)), (30.0, None)] {
        assert_eq!(times(&cuboid([0.0; 3], [side, 0.1 * side, side])), expected, "{side} m");
    }
    // A stairwell of 3 m.
    assert_eq!(times(&stair(8, 0.17, 0.29)), None);
}
