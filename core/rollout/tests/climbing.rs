//! Graphs with ladders and ledges: their edges, and NPCs that follow them.

use super::stage::{of_boxes, of_surfaces, router, router_of};
use std::sync::Arc;
use surefoot_planner::{Edge, Query};
use surefoot_policy::Policy;
use surefoot_rollout::{Goal, Rollout};
use surefoot_world::character::bodies::NamedBody;
use surefoot_world::map::MapSize;
use surefoot_world::mesh::Surface;
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
