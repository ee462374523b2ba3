//! Ladders, nets and walls that bodies climb, and ledges to which they pull themselves up.

use surefoot_world::character::MoveScratch;
use surefoot_world::character::bodies::NamedBody;
use surefoot_world::crossings::crossings;
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::reach::{Means, Reach};
use surefoot_world::{Ability, AbilitySet, Action, Body, CharacterProfile, Map, Vec3};

const FLOOR: f32 = 2.0;
const TOP: f32 = 10.0;
const AHEAD: Action = Action { forward: 1.0, strafe: 0.0, turn: 0.0, jump: -1.0 };

fn block(low: [f32; 3], high: [f32; 3], surface: Surface) -> Vec<Triangle> {
    let faces = cuboid(low.into(), high.into()).into_iter();
    faces.filter_map(|corners| Triangle::new(corners, surface)).collect()
}

/// A floor with a block of 8 m on it, and a ladder in front of the block.
fn map(surface: Surface) -> Map {
    let floor = block([0.0, 0.0, 0.0], [24.0, FLOOR, 24.0], Surface::Ground);
    let tower = block([8.0, FLOOR, 12.0], [16.0, TOP, 20.0], Surface::Ground);
    let ladder = block([11.7, FLOOR, 11.9], [12.3, TOP, 12.0], surface);
    Map::from_parts(MapSize { width: 24, height: 20, depth: 24 }, [floor, tower, ladder].concat(), Placed::default())
}

/// A floor with a block of so many metres on it.
fn ledge(height: f32) -> Map {
    let floor = block([0.0, 0.0, 0.0], [24.0, FLOOR, 24.0], Surface::Ground);
    let step = block([8.0, FLOOR, 12.0], [16.0, FLOOR + height, 20.0], Surface::Ground);
    Map::from_parts(MapSize { width: 24, height: 20, depth: 24 }, [floor, step].concat(), Placed::default())
}

/// Lets a body with its face to the ladder act for some seconds. Returns it with what it used.
fn act(map: &Map, profile: &CharacterProfile, action: Action, seconds: u32) -> (Body, AbilitySet) {
    let mut scratch = MoveScratch::default();
    let mut body = Body::at(Vec3::new(12.0, FLOOR, 10.0), 0.0);
    let mut used = AbilitySet::default();
    for tick in 0..60 * seconds {
        if tick % 10 == 0 {
            body.begin_decision(&action);
        }
        used = used.union(body.tick(map, profile, &action, &mut scratch));
        if body.is_grounded() && body.feet.z > 13.0 {
            break;
        }
    }
    (body, used)
}

#[test]
fn a_body_that_walks_into_a_ladder_climbs_to_its_top_and_walks_on() {
    let (body, used) = act(&map(Surface::Climb), &CharacterProfile::default(), AHEAD, 6);
    assert!(body.is_grounded() && (body.feet.y - TOP).abs() < 0.1, "{body:?}");
    assert_eq!(used.iter().collect::<Vec<_>>(), [Ability::CLIMB]);
}

#[test]
fn walls_are_not_climbed_nor_are_ladders_by_bodies_that_cannot_climb_or_do_not_want_to() {
    let body = CharacterProfile::default();
    let unable = body.with(|it| it.climb_speed = 0.0).unwrap();
    let cases = [
        ("a wall", map(Surface::Ground), &body, AHEAD),
        ("a body that cannot climb", map(Surface::Climb), &unable, AHEAD),
        ("a body that strafes", map(Surface::Climb), &body, Action { forward: 0.0, strafe: 1.0, ..AHEAD }),
    ];
    for (case, map, profile, action) in cases {
        let (body, used) = act(&map, profile, action, 6);
        assert!(body.feet.y < FLOOR + 0.1 && used.is_empty(), "{case}: {body:?}");
    }
}

#[test]
fn climbs_are_found_where_a_body_gets_up_and_the_survey_links_them() {
    let (map, body) = (map(Surface::Climb), CharacterProfile::default());
    let found = crossings(&map, &body);
    assert_eq!(found.len(), 1, "{found:?}");
    let climb = found[0];
    assert!((climb.from.y - FLOOR).abs() < 0.1 && climb.from.z < 11.9, "{climb:?}");
    assert!((climb.to.y - TOP).abs() < 0.1 && climb.to.z > 12.0, "{climb:?}");
    let links = Reach::survey(&map, &body, 1).links;
    assert!(links.iter().any(|link| link.means == Means::Climb), "{links:?}");
    assert!(crossings(&map, &body.with(|it| it.climb_speed = 0.0).unwrap()).is_empty());
}

#[test]
fn a_body_pulls_itself_up_to_ledges_within_its_reach() {
    let agile = NamedBody::find("agile").unwrap().profile();
    let jumps = Action { jump: 1.0, ..AHEAD };
    for tenths in 6..40 {
        let height = tenths as f32 * 0.1;
        let map = ledge(height);
        let walked = act(&map, &agile, AHEAD, 3);
        assert_eq!(walked.0.feet.y > FLOOR + height - 0.05, height < 1.91, "{height} m: {walked:?}");
        let used: Vec<_> = walked.1.iter().collect();
        assert!(used == [Ability::MANTLE] || height > 1.91 && used.is_empty(), "{height} m: {used:?}");
        // A jump rises 1.2 m.
        let jumped = act(&map, &agile, jumps, 3).0;
        assert_eq!(jumped.feet.y > FLOOR + height - 0.05, height < 3.15, "{height} m: {jumped:?}");
        let other = act(&map, &CharacterProfile::default(), AHEAD, 3);
        assert!(other.0.feet.y < FLOOR + 0.1 && other.1.is_empty(), "{height} m: {other:?}");
    }
}

#[test]
fn a_body_does_not_pull_itself_up_where_it_has_no_room() {
    let agile = NamedBody::find("agile").unwrap().profile();
    let floor = block([0.0, 0.0, 0.0], [24.0, FLOOR, 24.0], Surface::Ground);
    let step = block([8.0, FLOOR, 12.0], [16.0, FLOOR + 1.0, 20.0], Surface::Ground);
    let roof = block([8.0, FLOOR + 1.8, 12.0], [16.0, FLOOR + 3.0, 20.0], Surface::Ground);
    let size = MapSize { width: 24, height: 20, depth: 24 };
    let map = Map::from_parts(size, [floor, step, roof].concat(), Placed::default());
    let (body, used) = act(&map, &agile, AHEAD, 3);
    assert!(body.feet.y < FLOOR + 0.1 && used.is_empty(), "{body:?}");
}
