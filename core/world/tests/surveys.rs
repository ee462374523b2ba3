//! Surveys: which places are joined, and where play takes place.

use surefoot_world::map::mover::cuboid;
use surefoot_world::map::spot::SPAWN;
use surefoot_world::map::{MapSize, Placed, Spot};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::reach::{PlayArea, Reach};
use surefoot_world::{CharacterProfile, Map, Vec3};

const SIZE: MapSize = MapSize { width: 40, height: 30, depth: 20 };
const FLOOR: f32 = 2.0;

fn map(boxes: &[[[f32; 3]; 2]], placed: Placed) -> Map {
    let triangles = boxes.iter().flat_map(|[low, high]| cuboid((*low).into(), (*high).into()));
    Map::from_parts(SIZE, triangles.filter_map(|it| Triangle::new(it, Surface::Ground)).collect(), placed)
}

#[test]
fn a_wall_that_is_thinner_than_a_body_keeps_two_rooms_apart() {
    let profile = CharacterProfile::default();
    let rooms = |wall: [[f32; 3]; 2]| map(&[[[0.0, 0.0, 0.0], [40.0, FLOOR, 20.0]], wall], Placed::default());
    for at in [19.6, 19.9, 20.2, 20.5, 20.8] {
        let walled = rooms([[at, FLOOR, 0.0], [at + 0.04, FLOOR + 9.0, 20.0]]);
        let survey = Reach::survey(&walled, &profile, 1);
        assert_eq!(survey.ground.islands().len(), 2, "a wall at {at} m");
        assert!(survey.share_by(|_| true) < 0.6, "a wall at {at} m");
    }
    // The body is 0.6 m wide: it passes a gap of 1.2 m, and not one of 0.5 m.
    for (gap, joined) in [(1.2, true), (0.5, false)] {
        let open = rooms([[20.0, FLOOR, 0.0], [20.04, FLOOR + 9.0, 20.0 - gap]]);
        let share = Reach::survey(&open, &profile, 1).share_on_foot();
        assert_eq!(share > 0.9, joined, "a gap of {gap} m: {share}");
    }
}

#[test]
fn play_takes_place_around_spawn_points_and_without_any_on_the_largest_region() {
    let profile = CharacterProfile::default();
    // A large floor, and a small roof 20 m above one end of it.
    let boxes = [[[0.0, 0.0, 0.0], [40.0, FLOOR, 20.0]], [[30.0, 21.0, 0.0], [40.0, 22.0, 20.0]]];
    let spawn = |at: [f32; 3]| Spot { tag: SPAWN.to_owned(), from: at.into(), to: None, two_way: false };
    let at = |spawns: &[[f32; 3]]| {
        let placed = Placed { spots: spawns.iter().map(|at| spawn(*at)).collect(), ..Placed::default() };
        let map = map(&boxes, placed);
        let survey = Reach::survey(&map, &profile, 1);
        let area = PlayArea::of(&map, &profile, &survey);
        let island = |place: Vec3| {
            let mut cells = survey.ground.cells().iter();
            cells.find(|cell| cell.feet.distance(place) < 1.5).expect("a place to stand").island
        };
        let [floor, roof] = [Vec3::new(10.0, FLOOR, 10.0), Vec3::new(35.0, 22.0, 10.0)].map(island);
        [(area.holds(floor), area.reaches(floor)), (area.holds(roof), area.reaches(roof))]
    };
    let (home, away, below) = ((true, true), (false, false), (false, true));
    assert_eq!(at(&[]), [home, away]);
    assert_eq!(at(&[[5.0, FLOOR + 0.9, 5.0]]), [home, away], "a spawn point at the centre of its body");
    assert_eq!(at(&[[35.0, 22.0, 5.0]]), [below, home], "a body drops from the roof and does not come back");
    assert_eq!(at(&[[35.0, 22.0, 5.0], [5.0, FLOOR, 5.0]]), [home, home]);
    assert_eq!(at(&[[5.0, 15.0, 5.0]]), [home, away], "a spawn point in the air says nothing");
}
