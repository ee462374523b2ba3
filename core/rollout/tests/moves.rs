//! Graphs with ladders, ledges, water, vents and gaps: their edges, and NPCs that follow them.

use super::stage::{of_boxes, of_surfaces, router, router_of};
use std::sync::Arc;
use surefoot_planner::{Edge, Query, Router};
use surefoot_policy::Policy;
use surefoot_rollout::{Goal, Rollout};
use surefoot_world::character::bodies::NamedBody;
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{Liquid, MapSize, Outline, Placed, Pool};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{Ability, Arrival, CharacterProfile, End, Map, TaskConfig, Vec3};

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
