//! Reviews of new plans: shortcuts over open ground, and ways around what would be a leap.

use super::stage::{self, of_boxes};
use std::f32::consts::{PI, TAU};
use std::sync::Arc;
use surefoot_planner::evidence::Evidence;
use surefoot_planner::graph::GraphData;
use surefoot_planner::{Edge, EdgeKey, LegKey, NavGraph, Plan, Query, Router};
use surefoot_rollout::attempt::{Recovery, RetryBudget};
use surefoot_rollout::follow::Step;
use surefoot_rollout::rehearse::RehearsalFailure;
use surefoot_rollout::{Attempt, FollowConfig, Follower};
use surefoot_world::character::Body;
use surefoot_world::map::MapSize;
use surefoot_world::{Ability, CharacterProfile, Decisions, Map, Vec3};

const SIDE: u16 = 40;

/// A floor of 40 x 40 m at a height of 2 m, with these boxes on it.
fn floor(boxes: &[[Vec3; 2]]) -> Arc<Map> {
    let side = f32::from(SIDE);
    let ground = [Vec3::new(0.0, 1.0, 0.0), Vec3::new(side, 2.0, side)];
    let size = MapSize { width: SIDE.into(), height: 40, depth: SIDE.into() };
    of_boxes(size, std::iter::once(ground).chain(boxes.iter().copied()))
}

fn router(map: &Arc<Map>) -> Router {
    stage::router(map, 60)
}

fn at(x: f32, z: f32) -> Vec3 {
    Vec3::new(x, 2.0, z)
}

/// An attempt from `start` to `goal`, m, with its first plan.
fn planned(router: &Router, start: Vec3, goal: Vec3) -> Attempt {
    let mut attempt = Attempt::new(Follower::new(goal, FollowConfig::default()));
    attempt.plan(start, |query| router.find_path(query));
    attempt
}

/// Reviews the plans of an attempt of a body at `start`, m, until a review asks for no other; returns how many it
/// asked for.
fn review(
    attempt: &mut Attempt,
    map: &Map,
    router: &Router,
    start: Vec3,
    may_cross: impl Fn(Vec3, Vec3) -> bool,
) -> u32 {
    let body = Body::at(start, 0.0);
    let mut asked = 0;
    while attempt.review(map, &CharacterProfile::default(), &body, &may_cross) {
        attempt.plan(start, |query| router.find_path(query));
        asked += 1;
    }
    asked
}

/// The length of the way from `start` along the waypoints ahead, m.
fn length(start: Vec3, waypoints: &[Vec3]) -> f32 {
    std::iter::once(&start).chain(waypoints).zip(waypoints).map(|(from, to)| from.distance(*to)).sum()
}

#[test]
fn an_npc_on_open_ground_heads_past_the_vertices_of_its_plan_unless_it_must_not() {
    let map = floor(&[]);
    let router = router(&map);
    let (start, goal) = (at(5.0, 6.0), at(34.0, 33.0));
    let mut attempt = planned(&router, start, goal);
    let legs = attempt.follower.waypoints_ahead().to_vec();
    assert!(legs.len() >= 3 && length(start, &legs) > 1.02 * start.distance(goal), "{legs:?}");

    assert_eq!(review(&mut attempt, &map, &router, start, |_, _| true), 0);
    assert_eq!(attempt.follower.waypoint(), Some(goal), "straight to the goal");

    let mut bound = planned(&router, start, goal);
    review(&mut bound, &map, &router, start, |_, _| false);
    assert_eq!(bound.follower.waypoints_ahead(), legs, "a zone beside its way keeps an NPC on its legs");

    // A rehearsal of the shortcut fails: the NPC takes the legs of its plan, with the first one.
    let failure = RehearsalFailure { leg: attempt.follower.leg_key().unwrap(), is_harm: false };
    assert_eq!(RetryBudget::default().spend(failure, &mut attempt.follower), Recovery::MoveFreely);
    let ahead = attempt.follower.waypoints_ahead();
    assert!(legs.ends_with(ahead) && ahead.len() > 1, "{ahead:?}");
    assert!(attempt.follower.waypoint().unwrap().distance(start) < start.distance(goal));
}

#[test]
fn a_shortcut_goes_past_the_end_of_a_wall() {
    let wall = [Vec3::new(19.0, 2.0, 0.0), Vec3::new(21.0, 30.0, 30.0)];
    let map = floor(&[wall]);
    let router = router(&map);
    let (start, goal) = (at(5.0, 5.0), at(35.0, 5.0));
    let mut attempt = planned(&router, start, goal);
    review(&mut attempt, &map, &router, start, |_, _| true);
    let ahead = attempt.follower.waypoints_ahead();
    let first = ahead[0];
    assert!(ahead.len() > 1 && first.z > 28.0, "the first turn is beyond the end of the wall: {ahead:?}");
}

#[test]
fn a_review_keeps_the_goal_that_has_moved_meanwhile() {
    // The goal is beyond a block that the body would have to climb on its direct leg.
    let block = [Vec3::new(18.0, 2.0, 10.0), Vec3::new(22.0, 3.4, 30.0)];
    let map = floor(&[block]);
    let router = router(&map);
    let (start, goal, moved) = (at(16.5, 20.0), at(23.5, 20.0), at(23.9, 20.2));
    let body = Body::at(start, 0.0);
    let mut attempt = Attempt::new(Follower::new(goal, FollowConfig::default()));
    // The first plan is the direct leg, which cannot be walked: the review asks for another one.
    attempt.take_plan(Plan::straight(goal));
    assert!(attempt.review(&map, &CharacterProfile::default(), &body, |_, _| true));
    let Query { avoid, .. } = attempt.follower.query(start);
    assert_eq!(avoid, [LegKey::DIRECT], "the next plan does without the leap");
    attempt.follow_goal(moved, start, true);
    let asked = review(&mut attempt, &map, &router, start, |_, _| true);
    assert!(asked <= 3, "{asked} further plans");
    assert_eq!(attempt.follower.waypoints_ahead().last(), Some(&moved));
    assert_eq!(attempt.follower.plans(), 1, "plans of one review count as one");
}

#[test]
fn ways_are_pulled_taut_and_let_go_where_a_rehearsal_fails() {
    let block = [Vec3::new(15.0, 2.0, 15.0), Vec3::new(25.0, 30.0, 25.0)];
    let map = floor(&[block]);
    let router = router(&map);
    let around = |angle: f32| at(20.0 + 15.0 * angle.cos(), 20.0 + 15.0 * angle.sin());
    let mut moves = 0;
    for idx in 0..24 {
        let angle = idx as f32 * TAU / 24.0;
        let (start, goal) = (around(angle), around(angle + 0.8 * PI));
        let mut attempt = planned(&router, start, goal);
        let waypoints = |attempt: &Attempt| attempt.follower.current_plan().unwrap().waypoints.clone();
        let legs = waypoints(&attempt);
        if review(&mut attempt, &map, &router, start, |_, _| true) > 0 {
            continue;
        }
        let taut = waypoints(&attempt);
        if taut.len() > legs.len() {
            continue; // A leg leads around the block.
        }
        for idx in (0..legs.len()).filter(|idx| legs[*idx] != taut[*idx]) {
            assert!(idx + 1 < legs.len() && legs[idx].distance(taut[idx]) > 0.05, "{:?} {:?}", legs[idx], taut[idx]);
            moves += 1;
        }
        let former = attempt.follower.waypoint().unwrap();
        let failure = RehearsalFailure { leg: attempt.follower.leg_key().unwrap(), is_harm: false };
        let recovery = RetryBudget::default().spend(failure, &mut attempt.follower);
        let first = attempt.follower.waypoint().unwrap();
        assert_eq!(recovery, Recovery::MoveFreely);
        assert!(legs.contains(&former) || legs.contains(&first), "it heads for a vertex of its plan again");
    }
    assert!(moves >= 5, "{moves} waypoints moved");
}

#[test]
fn a_leg_behind_a_wall_is_walked_around_until_a_rehearsal_fails() {
    let wall = [Vec3::new(19.5, 2.0, 14.0), Vec3::new(20.5, 30.0, 26.0)];
    let map = floor(&[wall]);
    let (start, goal) = (at(17.0, 16.0), at(23.0, 16.0));
    let body = Body::at(start, 0.0);
    // A planner that knows nothing but the straight leg.
    let reviewed = |may_cross: bool| {
        let mut attempt = Attempt::new(Follower::new(goal, FollowConfig::default()));
        attempt.take_plan(Plan::straight(goal));
        while attempt.review(&map, &CharacterProfile::default(), &body, |_, _| may_cross) {
            attempt.take_plan(Plan::straight(goal));
        }
        attempt
    };
    let mut attempt = reviewed(true);
    let ahead = attempt.follower.waypoints_ahead();
    assert!(ahead.len() > 1 && ahead.iter().any(|place| place.z < 14.0), "around the near end: {ahead:?}");
    assert_eq!(attempt.follower.ability(), Some(Ability::WALK));

    let mut budget = RetryBudget::default();
    while attempt.follower.waypoints_ahead() != [goal] {
        let failure = RehearsalFailure { leg: LegKey::DIRECT, is_harm: false };
        assert_eq!(budget.spend(failure, &mut attempt.follower), Recovery::MoveFreely);
    }
    assert_eq!(attempt.follower.ability(), Some(Ability::JUMP));
    assert_eq!(reviewed(false).follower.waypoints_ahead(), [goal], "a zone bars the way around");
}

/// Plans on a graph of these vertices. Edges lead both ways, and each takes so many decisions.
fn router_of(vertices: Vec<Vec3>, edges: &[(u32, u32, f64)]) -> Router {
    let both_ways =
        edges.iter().flat_map(|&(one, other, decisions)| [(one, other, decisions), (other, one, decisions)]);
    let edge =
        |(from, to, decisions)| Edge { key: EdgeKey::new(from, to), evidence: Evidence::forced(Decisions(decisions)) };
    let edges = both_ways.map(edge).collect();
    Router::new(NavGraph::check(GraphData { vertices, edges, ..GraphData::default() }).unwrap(), 0, 1)
}

#[test]
fn where_legs_through_a_wall_fail_a_long_walk_is_found_before_the_goal_counts_as_unreachable() {
    // Start and goal are at the closed end of a wall. Beyond it are twenty vertices, on this side there is one, and the
    // walk to the open end takes long.
    let wall = [Vec3::new(19.5, 2.0, 0.0), Vec3::new(20.5, 30.0, 37.0)];
    let map = floor(&[wall]);
    let (start, goal) = (at(17.0, 4.0), at(38.0, 4.0));
    let beyond = (0..20u16).map(|idx| at(22.0 + f32::from(idx % 5), 2.0 + 1.5 * f32::from(idx / 5)));
    let vertices: Vec<Vec3> = [at(16.0, 12.0), at(18.0, 38.5), at(22.0, 38.5)].into_iter().chain(beyond).collect();
    let to_goal = (3..23).flat_map(|from| (from + 1..23).map(move |to| (from, to, 5.0)));
    let edges: Vec<_> = [(0, 1, 200.0), (1, 2, 50.0), (2, 3, 200.0)].into_iter().chain(to_goal).collect();
    let router = router_of(vertices, &edges);

    let mut attempt = planned(&router, start, goal);
    review(&mut attempt, &map, &router, start, |_, _| true);
    let mut failed = 0;
    while attempt.follower.waypoint().unwrap().x > 20.0 {
        let leg = attempt.follower.leg_key().unwrap();
        assert_eq!(attempt.follower.avoid(leg, false), Step::Plan, "after {failed} legs the goal is still reachable");
        failed += 1;
        attempt.plan(start, |query| router.find_path(query));
        review(&mut attempt, &map, &router, start, |_, _| true);
    }
    assert!(failed >= 1, "a leg through the wall is tried first, because it may be a leap");
    let plan = attempt.follower.current_plan().unwrap();
    assert!(plan.no_path.is_none() && plan.waypoints.last() == Some(&goal));
}
