//! Graphs with ladders, ledges, water, vents and gaps: their edges, and NPCs that follow them.

use super::stage::{of_boxes, of_surfaces, router, router_of};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::Arc;
use surefoot_planner::{Edge, Query, Router};
use surefoot_policy::Policy;
use surefoot_rollout::{Goal, Rollout};
use surefoot_world::character::bodies::NamedBody;
use surefoot_world::character::{OwnMotion, OwnMove};
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{Liquid, MapKind, MapSize, Outline, Placed, Pool, Spot};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::navigable::sample_many;
use surefoot_world::{Ability, Arrival, CharacterProfile, End, Map, MapSpec, TaskConfig, Vec3};

const FLOOR: f32 = 2.0;
/// Higher than two jumps.
const ROOF: f32 = 10.0;

/// A house without stairs, with a ladder at its front.
fn house() -> Arc<Map> {
    let boxes = [
        ([Vec3::new(0.0, 0.0, 0.0), Vec3::new(40.0, FLOOR, 40.0)], Surface::Ground),
        ([Vec3::new(12.0, FLOOR, 20.0), Vec3::new(28.0, ROOF, 34.0)], Surface::Ground),
        ([Vec3::new(19.6, FLOOR, 19.9), Vec3::new(20.4, ROOF, 20.0)], Surface::Climb),
    ];
    of_surfaces(MapSize { width: 40, height: 20, depth: 40 }, boxes)
}

#[test]
fn a_plan_to_a_roof_climbs_the_ladder() {
    let router = router(&house(), 60);
    let climbs: Vec<_> = router.graph().edges().filter(|edge| edge.evidence.ability == Ability::CLIMB).collect();
    assert!(!climbs.is_empty(), "no edge climbs");
    let (from, to) = (Vec3::new(6.0, FLOOR, 6.0), Vec3::new(20.0, ROOF, 28.0));
    let plan = router.find_path(&Query::new(from, to));
    assert_eq!(plan.no_path, None);
    assert!(plan.legs.iter().any(|leg| leg.ability == Ability::CLIMB), "{plan:?}");
    let without = Query { without: [Ability::CLIMB].into_iter().collect(), ..Query::new(from, to) };
    let other = router.find_path(&without);
    assert!(other.no_path.is_some(), "{other:?}");
}

#[test]
fn npcs_climb_the_ladder_from_anywhere_and_come_down_again() {
    let map = house();
    let (policy, router) = (Policy::shipped().unwrap(), router(&map, 60));
    let mut rollout = Rollout::new(map, CharacterProfile::default(), TaskConfig::default());
    rollout.follow.arrival = Arrival::Stand;
    let places = [(6.0, 6.0), (36.0, 10.0), (20.0, 4.0), (5.0, 30.0), (34.0, 36.0), (20.5, 18.0)];
    let roofs = [(14.0, 22.0), (26.0, 32.0), (20.0, 21.0)];
    for (x, z) in places {
        for (over, behind) in roofs {
            let (ground, roof) = (Vec3::new(x, FLOOR, z), Vec3::new(over, ROOF, behind));
            let goals = [[ground, roof], [roof, ground]].map(|[start, goal]| Goal { start, yaw: 0.0, goal });
            for played in rollout.play(&policy, Some(&router), &goals) {
                assert_eq!(played.attempt.end, End::Reached, "{:?}", played.attempt);
            }
        }
    }
}

#[test]
fn agile_npcs_pull_themselves_up_terraces_that_others_cannot_reach() {
    // Three terraces, each 1.7 m above the one before.
    let terrace = |idx: f32| [Vec3::new(0.0, 0.0, 10.0 * idx), Vec3::new(40.0, FLOOR + 1.7 * idx, 40.0)];
    let map = of_boxes(MapSize { width: 40, height: 20, depth: 40 }, [0.0, 1.0, 2.0, 3.0].map(terrace));
    let agile = NamedBody::find("agile").unwrap().profile();
    let router = router_of(&map, agile.clone(), 60);
    let (low, high) = (Vec3::new(20.0, FLOOR, 5.0), Vec3::new(20.0, FLOOR + 5.1, 35.0));
    let plan = router.find_path(&Query::new(low, high));
    assert_eq!(plan.no_path, None);
    assert!(plan.legs.iter().any(|leg| leg.ability == Ability::MANTLE), "{plan:?}");
    let rise = |edge: &Edge| router.graph().position(edge.key.to).y - router.graph().position(edge.key.from).y;
    assert!(router.graph().edges().all(|edge| rise(edge) < 1.0 || edge.evidence.ability == Ability::MANTLE));
    let mut rollout = Rollout::new(map, agile, TaskConfig::default());
    rollout.follow.arrival = Arrival::Stand;
    let goals = [4.0, 14.0, 26.0, 36.0].map(|x| Goal { start: low.with_x(x), yaw: 0.0, goal: high.with_x(40.0 - x) });
    for played in rollout.play(&Policy::shipped().unwrap(), Some(&router), &goals) {
        assert_eq!(played.attempt.end, End::Reached, "{:?}", played.attempt);
    }
}

#[test]
fn agile_npcs_swim_to_an_island_and_back() {
    let size = MapSize { width: 60, height: 20, depth: 60 };
    let boxes = [
        [Vec3::ZERO, Vec3::new(60.0, 1.0, 60.0)],
        [Vec3::ZERO, Vec3::new(60.0, 6.0, 10.0)],
        [Vec3::new(0.0, 0.0, 50.0), Vec3::new(60.0, 6.0, 60.0)],
        [Vec3::new(24.0, 0.0, 24.0), Vec3::new(36.0, 6.2, 36.0)],
    ];
    let outline = Outline::Rectangle { half_x: 30.0, half_z: 20.0 };
    let pool = Pool { centre: Vec3::new(30.0, 5.7, 30.0), outline, depth: 4.7, liquid: Liquid::Water };
    let solids = boxes.into_iter().flat_map(|[low, high]| cuboid(low, high));
    let solids = solids.filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect();
    let map = Arc::new(Map::from_parts(size, solids, Placed { pools: vec![pool], ..Placed::default() }));
    let agile = NamedBody::find("agile").unwrap().profile();
    let router = router_of(&map, agile.clone(), 60);
    let mut rollout = Rollout::new(map, agile, TaskConfig::default());
    rollout.follow.arrival = Arrival::Stand;
    let places = [(10.0, 5.0, 6.0), (50.0, 5.0, 6.0), (30.0, 30.0, 6.2), (15.0, 55.0, 6.0), (45.0, 56.0, 6.0)];
    let places = places.map(|(x, z, y)| Vec3::new(x, y, z));
    let pairs = places.iter().flat_map(|start| places.iter().map(move |goal| (*start, *goal)));
    let goals: Vec<Goal> = pairs.filter(|(a, b)| a != b).map(|(start, goal)| Goal { start, yaw: 0.0, goal }).collect();
    for (goal, played) in goals.iter().zip(rollout.play(&Policy::shipped().unwrap(), Some(&router), &goals)) {
        assert_eq!(played.attempt.end, End::Reached, "{goal:?}: {:?}", played.attempt);
    }
}

#[test]
fn agile_npcs_crouch_through_a_vent() {
    let size = MapSize { width: 40, height: 20, depth: 40 };
    let wall = |from: [f32; 2], to: [f32; 2]| [Vec3::new(from[0], from[1], 17.0), Vec3::new(to[0], to[1], 23.0)];
    let boxes = [
        [Vec3::ZERO, Vec3::new(40.0, FLOOR, 40.0)],
        wall([0.0, FLOOR], [19.2, 10.0]),
        wall([20.8, FLOOR], [40.0, 10.0]),
        wall([19.2, FLOOR + 1.1], [20.8, 10.0]),
    ];
    let map = of_boxes(size, boxes);
    let agile = NamedBody::find("agile").unwrap().profile();
    let router = router_of(&map, agile.clone(), 60);
    let mut rollout = Rollout::new(map, agile, TaskConfig::default());
    rollout.follow.arrival = Arrival::Stand;
    let rooms = [[(6.0, 6.0), (20.0, 10.0), (34.0, 4.0)], [(34.0, 35.0), (20.0, 30.0), (6.0, 36.0)]];
    let at = |(x, z): (f32, f32)| Vec3::new(x, FLOOR, z);
    let pairs = rooms[0].iter().flat_map(|a| rooms[1].iter().flat_map(move |b| [(*a, *b), (*b, *a)]));
    let goals: Vec<Goal> = pairs.map(|(a, b)| Goal { start: at(a), yaw: 0.0, goal: at(b) }).collect();
    for (goal, played) in goals.iter().zip(rollout.play(&Policy::shipped().unwrap(), Some(&router), &goals)) {
        assert_eq!(played.attempt.end, End::Reached, "{goal:?}: {:?}", played.attempt);
    }
}

#[test]
fn dashers_cross_gaps_that_agile_npcs_cannot() {
    let boxes = [(0.0, 20.0), (30.0, 50.0)];
    let boxes = boxes.map(|(from, to)| [Vec3::new(0.0, 4.0, from), Vec3::new(40.0, 6.0, to)]);
    let map = of_boxes(MapSize { width: 40, height: 20, depth: 50 }, boxes);
    let [agile, dasher] = ["agile", "dasher"].map(|name| NamedBody::find(name).unwrap().profile());
    let crosses = |router: &Router| {
        let place = |vertex| router.graph().position(vertex).z < 25.0;
        router.graph().edges().filter(|edge| place(edge.key.from) != place(edge.key.to)).count()
    };
    assert_eq!(crosses(&router_of(&map, agile, 60)), 0);
    let router = router_of(&map, dasher.clone(), 60);
    assert!(crosses(&router) > 0, "no edge dashes");
    let mut rollout = Rollout::new(map, dasher, TaskConfig::default());
    rollout.follow.arrival = Arrival::Stand;
    let near = [(6.0, 6.0), (20.0, 10.0), (34.0, 4.0)];
    let at = |x: f32, z: f32| Vec3::new(x, 6.0, z);
    let goals: Vec<Goal> = near
        .iter()
        .flat_map(|&(x, z)| [[at(x, z), at(40.0 - x, 50.0 - z)], [at(40.0 - x, 50.0 - z), at(x, z)]])
        .map(|[start, goal]| Goal { start, yaw: 0.0, goal })
        .collect();
    for (goal, played) in goals.iter().zip(rollout.play(&Policy::shipped().unwrap(), Some(&router), &goals)) {
        assert_eq!(played.attempt.end, End::Reached, "{goal:?}: {:?}", played.attempt);
    }
}

/// Two decks with a gap of so many metres between them, along x.
fn decks(gap: f32) -> Vec<([Vec3; 2], Surface)> {
    let deck = |from: f32, to: f32| ([Vec3::new(from, 0.0, 0.0), Vec3::new(to, HIGH, 40.0)], Surface::Ground);
    vec![deck(0.0, 16.0), deck(16.0 + gap, 48.0)]
}

/// Higher than anything gets up again.
const HIGH: f32 = 12.0;

/// NPCs with this body go from one deck to the other and, if `both_ways`, back; the graph has edges by `ability` there.
fn cross(map: &Arc<Map>, body: &CharacterProfile, ability: Ability, both_ways: bool) {
    let router = router_of(map, body.clone(), 60);
    let is_left = |vertex| router.graph().position(vertex).x < 16.0;
    let crossing = router.graph().edges().filter(|edge| is_left(edge.key.from) != is_left(edge.key.to));
    let abilities: Vec<Ability> = crossing.map(|edge| edge.evidence.ability).collect();
    assert!(!abilities.is_empty() && abilities.iter().all(|it| *it == ability), "{abilities:?}");
    let mut rollout = Rollout::new(map.clone(), body.clone(), TaskConfig::default());
    rollout.follow.arrival = Arrival::Stand;
    let at = |x: f32, z: f32| Vec3::new(x, HIGH, z);
    let ways = [(4.0, 8.0, 44.0, 30.0), (8.0, 30.0, 40.0, 10.0), (12.0, 20.0, 36.0, 20.0)];
    let goals = ways.iter().flat_map(|&(x, z, to_x, to_z)| {
        let back = both_ways.then_some([at(to_x, to_z), at(x, z)]);
        std::iter::once([at(x, z), at(to_x, to_z)]).chain(back)
    });
    let goals: Vec<Goal> = goals.map(|[start, goal]| Goal { start, yaw: 0.0, goal }).collect();
    for (goal, played) in goals.iter().zip(rollout.play(&Policy::shipped().unwrap(), Some(&router), &goals)) {
        assert_eq!(played.attempt.end, End::Reached, "{goal:?}: {:?}", played.attempt);
    }
}

#[test]
fn acrobats_run_along_walls_over_gaps() {
    let acrobat = NamedBody::find("acrobat").unwrap().profile();
    // Nobody stands on top of it.
    let wall = ([Vec3::new(2.0, HIGH, 36.0), Vec3::new(46.0, 30.0, 38.0)], Surface::Ground);
    let map = of_surfaces(MapSize { width: 48, height: 30, depth: 40 }, [decks(8.0), vec![wall]].concat());
    cross(&map, &acrobat, Ability::WALL_RUN, true);
}

/// The same decks with spots.
fn with_spots(gap: f32, spots: Vec<Spot>) -> Arc<Map> {
    let triangles = decks(gap).into_iter().flat_map(|([low, high], surface)| {
        let faces = cuboid(low, high).into_iter();
        faces.filter_map(move |corners| Triangle::new(corners, surface)).collect::<Vec<_>>()
    });
    let size = MapSize { width: 48, height: 30, depth: 40 };
    Arc::new(Map::from_parts(size, triangles.collect(), Placed { spots, ..Placed::default() }))
}

#[test]
fn acrobats_pull_themselves_to_anchors() {
    let acrobat = NamedBody::find("acrobat").unwrap().profile();
    let anchor = |z: f32| {
        let from = Vec3::new(22.0, HIGH + 6.0, z);
        Spot { tag: "anchor".to_owned(), from, to: None, two_way: false }
    };
    let map = with_spots(12.0, vec![anchor(12.0), anchor(28.0)]);
    cross(&map, &acrobat, acrobat.move_named("grapple").unwrap(), true);
}

#[test]
fn npcs_make_moves_that_only_their_game_has() {
    let vault = OwnMove { rise: 3.0, speed: 8.0, ..OwnMove::new("vault", OwnMotion::Curve) };
    let body = CharacterProfile::default().with(|it| (it.extra_jumps, it.moves) = (0, [vault].into())).unwrap();
    let (from, to) = (Vec3::new(15.0, HIGH, 20.0), Some(Vec3::new(33.0, HIGH, 20.0)));
    let spot = |two_way| vec![Spot { tag: "vault".to_owned(), from, to, two_way }];
    let ability = body.move_named("vault").unwrap();
    cross(&with_spots(16.0, spot(true)), &body, ability, true);
    cross(&with_spots(16.0, spot(false)), &body, ability, false);
    let one_way = router_of(&with_spots(16.0, spot(false)), body, 60);
    assert_eq!(one_way.graph().name_of(ability), "vault");
    let back = Query::new(Vec3::new(40.0, HIGH, 20.0), Vec3::new(8.0, HIGH, 20.0));
    assert!(one_way.find_path(&back).no_path.is_some());
}

#[test]
fn acrobats_get_anywhere_on_courses() {
    let acrobat = NamedBody::find("acrobat").unwrap().profile();
    for kind in MapKind::COURSES {
        let spec = MapSpec::with_side(4, 80).unwrap().with(|it| it.kind = kind).unwrap();
        let map = Arc::new(surefoot_generate::generate(&spec));
        let router = router_of(&map, acrobat.clone(), 200);
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let places = sample_many(&map, &acrobat, 40, &mut rng).unwrap();
        let (pairs, _) = places.as_chunks::<2>();
        let goals: Vec<Goal> = pairs.iter().map(|&[start, goal]| Goal { start, yaw: 0.0, goal }).collect();
        let mut rollout = Rollout::new(map, acrobat.clone(), TaskConfig::default());
        rollout.follow.arrival = Arrival::Stand;
        for (goal, played) in goals.iter().zip(rollout.play(&Policy::shipped().unwrap(), Some(&router), &goals)) {
            assert_eq!(played.attempt.end, End::Reached, "{}, {goal:?}: {:?}", kind.name(), played.attempt);
        }
    }
}
