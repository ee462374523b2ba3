//! Passages that are lower than a body.

use surefoot_world::character::MoveScratch;
use surefoot_world::character::bodies::NamedBody;
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::reach::Reach;
use surefoot_world::{Ability, AbilitySet, Action, Body, CharacterProfile, Map, Vec3};

const FLOOR: f32 = 2.0;
const AHEAD: Action = Action { forward: 1.0, strafe: 0.0, turn: 0.0, jump: -1.0 };

fn block(low: [f32; 3], high: [f32; 3]) -> Vec<Triangle> {
    cuboid(low.into(), high.into()).into_iter().filter_map(|it| Triangle::new(it, Surface::Ground)).collect()
}

/// Two rooms with a wall of 4 m between them, and a vent of 6 m length and this height through it.
fn vent(height: f32) -> Map {
    let floor = block([0.0, 0.0, 0.0], [24.0, FLOOR, 24.0]);
    let wall = [(0.0, 11.4), (12.6, 24.0)].map(|(from, to)| block([from, FLOOR, 9.0], [to, FLOOR + 8.0, 15.0]));
    let roof = block([11.4, FLOOR + height, 9.0], [12.6, FLOOR + 8.0, 15.0]);
    let size = MapSize { width: 24, height: 20, depth: 24 };
    Map::from_parts(size, [floor, wall.concat(), roof].concat(), Placed::default())
}

/// Lets a body walk at the vent for so many seconds. Returns it with what it used, and the most that it rose.
fn walk(map: &Map, profile: &CharacterProfile, seconds: u32) -> (Body, AbilitySet, bool) {
    let mut scratch = MoveScratch::default();
    let mut body = Body::at(Vec3::new(12.0, FLOOR, 5.0), 0.0);
    let (mut used, mut crouched_inside) = (AbilitySet::default(), true);
    for _ in 0..60 * seconds {
        used = used.union(body.tick(map, profile, &AHEAD, &mut scratch));
        crouched_inside &= body.crouches || !(9.1..14.9).contains(&body.feet.z);
        if body.feet.z > 18.0 {
            break;
        }
    }
    (body, used, crouched_inside)
}

#[test]
fn a_body_crouches_through_a_vent_and_rises_behind_it() {
    let agile = NamedBody::find("agile").unwrap().profile();
    for height in [0.95, 1.1, 1.5, 1.75] {
        let (body, used, crouched_inside) = walk(&vent(height), &agile, 8);
        assert!(body.feet.z > 18.0 && !body.crouches && crouched_inside, "{height} m: {body:?}");
        assert_eq!(used.iter().collect::<Vec<_>>(), [Ability::CROUCH], "{height} m");
    }
}

#[test]
fn bodies_do_not_crouch_where_they_have_room_or_cannot_pass() {
    let agile = NamedBody::find("agile").unwrap().profile();
    let (body, used, _) = walk(&vent(1.9), &agile, 4);
    assert!(body.feet.z > 18.0 && used.is_empty(), "{body:?}");
    let (body, ..) = walk(&vent(0.8), &agile, 4);
    assert!(body.feet.z < 9.0, "{body:?}");
    let (body, used, _) = walk(&vent(1.1), &CharacterProfile::default(), 4);
    assert!(body.feet.z < 9.0 && used.is_empty(), "{body:?}");
}

#[test]
fn the_survey_walks_through_vents_with_bodies_that_crouch() {
    let agile = NamedBody::find("agile").unwrap().profile();
    let share = |map: &Map, body: &CharacterProfile| Reach::survey(map, body, 1).share_on_foot();
    // A quarter of all places is on the roof.
    assert!(share(&vent(1.1), &agile) > 0.55);
    assert!(share(&vent(0.8), &agile) < 0.45);
    assert!(share(&vent(1.1), &CharacterProfile::default()) < 0.45);
}
