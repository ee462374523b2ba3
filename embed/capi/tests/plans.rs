//! Plans and followers through the C functions, on a graph with two ways.
#![expect(unsafe_code, reason = "calls C functions")]

use crate::stage::{at, fails, graph, graph_text, graph_text_of, graph_text_with, handle, load_graph, ok, query, step};
use std::ptr::{null, null_mut};
use surefoot::abi::{self, Leg, LegKey, Plan, Query, STOP_GOAL, STOP_START, Vec3};
use surefoot::exports::*;
use surefoot::{Follower, Graph};
use surefoot_world::character::{OwnMotion, OwnMove};
use surefoot_world::map::{LevelFrame, UpAxis};
use surefoot_world::{Ability, DVec3};

/// The plan, and the vertices that it passes.
fn find(graph: *const Shared<Graph>, query: &Query) -> (Plan, Vec<u32>) {
    let (mut legs, mut count, mut plan) = ([Leg::default(); 32], 0, Plan::default());
    ok(|error| unsafe { sf_graph_find_path(graph, query, legs.as_mut_ptr(), 32, &mut count, &mut plan, error) });
    assert_eq!(count, plan.leg_count as usize);
    let passed = legs[..count].iter().map(|leg| leg.key.to).filter(|stop| *stop != STOP_GOAL).collect();
    (plan, passed)
}

fn across() -> Query {
    query(at(0.2, 0.2), at(90.0, 0.2))
}

const SHORT: [u32; 4] = [0, 1, 2, 3];
const LONG: [u32; 6] = [0, 4, 5, 6, 7, 3];

#[test]
fn a_plan_changes_at_once_with_what_is_closed_priced_and_met() {
    let graph = graph();
    let mut info = abi::GraphInfo { struct_size: size_of::<abi::GraphInfo>() as u32, ..abi::GraphInfo::default() };
    ok(|error| unsafe { sf_graph_describe(graph, &mut info, error) });
    assert_eq!((info.vertex_count, info.edge_count, info.island_count), (8, 16, 1));
    let (plan, passed) = find(graph, &across());
    assert_eq!(passed, SHORT);
    assert!(plan.no_path == 0 && plan.seconds > 8.0 && plan.chance > 0.5 && plan.arrival_chance > plan.chance);

    ok(|error| unsafe { sf_graph_set_edge_open(graph, 1, 2, 0, error) });
    assert_eq!(find(graph, &across()).1, LONG);
    assert_eq!(find(graph, &query(at(90.0, 0.0), at(0.0, 0.0))).1, [3, 2, 1, 0], "the way back is open");
    let (mut edges, mut count) = ([abi::Edge::default(); 16], 0);
    ok(|error| unsafe { sf_graph_edges(graph, edges.as_mut_ptr(), 16, &mut count, error) });
    let closed = edges.iter().filter(|edge| edge.is_open == 0).collect::<Vec<_>>();
    assert!(closed.len() == 1 && closed[0].key == LegKey { from: 1, to: 2 } && closed[0].cost == f32::INFINITY);
    ok(|error| unsafe { sf_graph_set_edge_open(graph, 1, 2, 1, error) });
    assert_eq!(find(graph, &across()).1, SHORT);

    ok(|error| unsafe { sf_graph_set_edge_price(graph, 1, 2, 100.0, error) });
    assert_eq!(find(graph, &across()).1, LONG);
    ok(|error| unsafe { sf_graph_set_edge_price(graph, 1, 2, 1.0, error) });
    assert_eq!(find(graph, &across()).1, SHORT);

    let deaths = [abi::Traversal { key: LegKey { from: 1, to: 2 }, decisions: 9, end: 2 }; 8];
    ok(|error| unsafe { sf_graph_note_traversals(graph, deaths.as_ptr(), deaths.len(), error) });
    assert_eq!(find(graph, &across()).1, LONG);
    unsafe { sf_graph_destroy(graph) };
}

#[test]
fn abilities_have_names_and_animations() {
    let rope = OwnMove { animation: "Climb_Rope".to_owned(), ..OwnMove::new("rope", OwnMotion::Curve) };
    let graph = load_graph(&graph_text_with(None, &[rope]));
    let describe = |graph, ability: Ability| {
        let mut info = abi::AbilityInfo { struct_size: size_of::<abi::AbilityInfo>() as u32, ..EMPTY };
        ok(|error| unsafe { sf_graph_ability(graph, ability.idx() as i32, &mut info, error) });
        [&info.name[..], &info.animation[..]].map(|text| {
            let bytes = text.iter().take_while(|byte| **byte != 0).map(|byte| *byte as u8);
            String::from_utf8(bytes.collect()).expect("UTF-8")
        })
    };
    assert_eq!(describe(graph, Ability::own(0)), ["rope", "Climb_Rope"]);
    assert_eq!(describe(graph, Ability::ZIP_LINE), ["zip_line", "zip_line"]);
    assert_eq!(describe(std::ptr::null_mut(), Ability::DIVE), ["dive", "dive"]);
    let mut info = abi::AbilityInfo { struct_size: size_of::<abi::AbilityInfo>() as u32, ..EMPTY };
    fails(3, "the body has 1 moves of its own", |error| unsafe { sf_graph_ability(graph, 17, &mut info, error) });
    fails(1, "ability is 99", |error| unsafe { sf_graph_ability(graph, 99, &mut info, error) });
    unsafe { sf_graph_destroy(graph) };
}

const EMPTY: abi::AbilityInfo =
    abi::AbilityInfo { struct_size: 0, name: [0; abi::ABILITY_NAME_LEN], animation: [0; abi::ANIMATION_LEN] };

#[test]
fn a_plan_without_a_path_says_why_and_leads_near() {
    let graph = graph();
    for (from, to) in [(2, 3), (7, 3)] {
        ok(|error| unsafe { sf_graph_set_edge_open(graph, from, to, 0, error) });
    }
    let (plan, passed) = find(graph, &across());
    assert_eq!((plan.no_path, plan.leads_near, plan.arrival_chance), (2, 1, 0.0), "no edge reaches the goal");
    assert_eq!(passed.last(), Some(&2), "the reachable vertex nearest to the goal");
    unsafe { sf_graph_destroy(graph) };
}

#[test]
fn queries_do_without_legs_and_abilities_and_list_alternatives() {
    let graph = graph();
    let avoid = [LegKey { from: 1, to: 2 }];
    let around = Query { avoid: avoid.as_ptr(), avoid_count: 1, ..across() };
    assert_eq!(find(graph, &around).1, LONG);
    let on_foot = Query { without: 1 << 3, ..around };
    assert!(!find(graph, &on_foot).1.contains(&5), "no pads");
    let bold = Query { caution: 0.0, ..across() };
    assert_eq!(find(graph, &bold).1, SHORT);

    let (mut plans, mut plan_count) = ([Plan::default(); 8], 0);
    let (mut legs, mut leg_count) = ([Leg::default(); 64], 0);
    ok(|error| unsafe {
        let (plans, legs) = (plans.as_mut_ptr(), legs.as_mut_ptr());
        sf_graph_find_alternatives(graph, &across(), plans, 8, &mut plan_count, legs, 64, &mut leg_count, error)
    });
    assert!(plan_count >= 2);
    let vertices = |plan: &Plan| -> Vec<u32> {
        let own = &legs[plan.first_leg as usize..][..plan.leg_count as usize];
        assert_eq!(own[0].key.from, STOP_START);
        own.iter().map(|leg| leg.key.to).filter(|stop| *stop != STOP_GOAL).collect()
    };
    assert_eq!(vertices(&plans[0]), SHORT);
    assert!(plans[1..plan_count].iter().any(|plan| vertices(plan) == LONG));
    assert_eq!(leg_count, plans[..plan_count].iter().map(|plan| plan.leg_count as usize).sum::<usize>());
    unsafe { sf_graph_destroy(graph) };
}

#[test]
fn designers_edits_apply_by_place_or_not_at_all() {
    let graph = graph();
    let forbid = abi::Edit { kind: 1, value: 0.0, from: at(30.5, 0.0), to: at(59.0, 0.0) };
    ok(|error| unsafe { sf_graph_edit(graph, &forbid, 1, error) });
    assert_eq!(find(graph, &across()).1, LONG);
    let force = abi::Edit { kind: 2, value: 1.0, from: at(0.0, 0.0), to: at(90.0, 0.0) };
    ok(|error| unsafe { sf_graph_edit(graph, [forbid, force].as_ptr(), 2, error) });
    assert_eq!(find(graph, &across()).1, [0, 3]);
    let nowhere = abi::Edit { from: at(500.0, 0.0), ..forbid };
    fails(3, "edit 1: there is no vertex within 3 m", |error| unsafe {
        sf_graph_edit(graph, [force, nowhere].as_ptr(), 2, error)
    });
    assert_eq!(find(graph, &across()).1, [0, 3], "nothing has changed");
    fails(1, "edits[0].kind is 9", |error| unsafe { sf_graph_edit(graph, &abi::Edit { kind: 9, ..force }, 1, error) });
    fails(1, "factor is 0", |error| unsafe {
        sf_graph_edit(graph, &abi::Edit { kind: 3, value: 0.0, ..force }, 1, error)
    });
    ok(|error| unsafe { sf_graph_edit(graph, null(), 0, error) });
    assert_eq!(find(graph, &across()).1, SHORT);
    unsafe { sf_graph_destroy(graph) };
}

#[test]
fn many_threads_search_while_one_changes() {
    struct Everywhere(*mut Shared<Graph>);
    // SAFETY: the header allows calls on any thread.
    unsafe impl Sync for Everywhere {}
    let graph = Everywhere(graph());
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                let graph = &graph;
                for _ in 0..200 {
                    let passed = find(graph.0, &across()).1;
                    assert!(passed == SHORT || passed == LONG);
                }
            });
        }
        for round in 0..100 {
            ok(|error| unsafe { sf_graph_set_edge_open(graph.0, 1, 2, round % 2, error) });
        }
    });
    unsafe { sf_graph_destroy(graph.0) };
}

#[test]
fn a_follower_goes_on_to_the_next_waypoint_plans_anew_and_reports() {
    let graph = graph();
    let follower: *mut Handle<Follower> = handle(|out, error| unsafe { sf_follower_create(at(90.0, 0.2), out, error) });
    let advance = |feet, reached| {
        let mut step = step();
        ok(|error| unsafe { sf_follower_advance(follower, feet, reached, &mut step, error) });
        step
    };
    let plan = |feet| {
        let mut step = step();
        ok(|error| unsafe { sf_follower_plan(follower, graph, feet, 1.0, 0, &mut step, error) });
        step
    };
    let start = at(0.2, 0.2);
    fails(6, "no plan", |error| unsafe { sf_follower_legs(follower, null_mut(), 0, &mut 0, error) });
    assert_eq!(advance(start, 0).kind, 2, "it wants a plan");
    let first = plan(start);
    assert_eq!((first.kind, first.waypoint, first.leg, first.leg_count), (1, at(0.0, 0.0), 0, 5));
    let next = advance(start, 1);
    assert_eq!((next.kind, next.waypoint, next.leg), (1, at(30.0, 0.0), 1));
    assert_eq!(advance(at(5.0, 0.0), 0).kind, 0);
    let next = advance(at(29.8, 0.0), 1);
    assert_eq!((next.kind, next.waypoint), (1, at(60.0, 0.0)));
    // It is stuck on the way from vertex 1 to 2.
    let stuck = at(30.0, 0.0);
    let kinds: Vec<i32> = (0..51).map(|_| advance(stuck, 0).kind).collect();
    assert_eq!((kinds[0], kinds[50]), (0, 2), "{kinds:?}");
    let around = plan(stuck);
    assert_eq!((around.kind, around.plans), (1, 2));
    let (mut legs, mut count) = ([Leg::default(); 16], 0);
    ok(|error| unsafe { sf_follower_legs(follower, legs.as_mut_ptr(), 16, &mut count, error) });
    assert!(legs[..count].iter().all(|leg| leg.key != LegKey { from: 1, to: 2 }));
    let mut traversals = [abi::Traversal::default(); 4];
    fails(2, "traversals has room for 1, but there are 2", |error| unsafe {
        sf_follower_take_traversals(follower, traversals.as_mut_ptr(), 1, &mut count, error)
    });
    ok(|error| unsafe { sf_follower_take_traversals(follower, traversals.as_mut_ptr(), 4, &mut count, error) });
    assert_eq!(count, 2);
    assert_eq!((traversals[0].key, traversals[0].end), (LegKey { from: 0, to: 1 }, 0));
    assert_eq!((traversals[1].key, traversals[1].end), (LegKey { from: 1, to: 2 }, 1));
    ok(|error| unsafe { sf_graph_note_traversals(graph, traversals.as_ptr(), count, error) });
    ok(|error| unsafe { sf_follower_note_death(follower, error) });
    assert_eq!(advance(stuck, 0).kind, 3, "the attempt is over");
    unsafe {
        sf_follower_destroy(follower);
        sf_graph_destroy(graph);
    }
}

/// A follower with its graph.
struct Chase {
    graph: *mut Shared<Graph>,
    follower: *mut Handle<Follower>,
}

impl Chase {
    fn of(goal: Vec3) -> Self {
        Self { graph: graph(), follower: handle(|out, error| unsafe { sf_follower_create(goal, out, error) }) }
    }

    fn move_goal(&self, goal: Vec3, feet: Vec3, reached: i32) -> abi::Step {
        let mut step = step();
        ok(|error| unsafe { sf_follower_move_goal(self.follower, goal, feet, reached, &mut step, error) });
        step
    }

    fn advance(&self, feet: Vec3, reached: i32) -> abi::Step {
        let mut step = step();
        ok(|error| unsafe { sf_follower_advance(self.follower, feet, reached, &mut step, error) });
        step
    }

    fn plan(&self, feet: Vec3) -> abi::Step {
        let mut step = step();
        ok(|error| unsafe { sf_follower_plan(self.follower, self.graph, feet, 1.0, 0, &mut step, error) });
        step
    }

    fn last_leg(&self) -> Vec3 {
        let (mut legs, mut count) = ([Leg::default(); 16], 0);
        ok(|error| unsafe { sf_follower_legs(self.follower, legs.as_mut_ptr(), 16, &mut count, error) });
        legs[count - 1].waypoint
    }

    /// Plans from vertex 2, and advances to the last leg.
    fn advance_to_last_leg(&self) -> abi::Step {
        let mut step = self.plan(at(60.0, 0.0));
        while step.leg + 1 < step.leg_count {
            step = self.advance(step.waypoint, 1);
        }
        step
    }
}

impl Drop for Chase {
    fn drop(&mut self) {
        unsafe {
            sf_follower_destroy(self.follower);
            sf_graph_destroy(self.graph);
        }
    }
}

fn distance(a: Vec3, b: Vec3) -> f32 {
    (a.x - b.x).hypot(a.z - b.z)
}

#[test]
fn a_goal_that_moves_a_little_is_followed_and_drifts_into_another_plan() {
    let goal = |decision: u8| at(96.0 + 0.2 * f32::from(decision), 0.0);
    let chase = Chase::of(goal(0));
    let abi::Step { mut waypoint, leg_count, .. } = chase.advance_to_last_leg();
    assert_eq!(waypoint, goal(0));
    let feet = at(90.0, 0.0);
    let mut heads = 0;
    // At 6 to 8 m from the NPC the goal drifts by 25 % of its distance after 2 m, and the waypoint follows by 15 %.
    for decision in 1..=9 {
        let step = chase.move_goal(goal(decision), feet, 0);
        assert!(step.kind < 2, "decision {decision}: {step:?}");
        assert_eq!(step.kind == 1, step.waypoint != waypoint, "decision {decision}");
        waypoint = step.waypoint;
        heads += step.kind;
        assert!(distance(waypoint, goal(decision)) <= 0.15 * distance(feet, goal(decision)), "decision {decision}");
        assert_eq!(chase.last_leg(), waypoint);
        assert_eq!((chase.advance(feet, 0).kind, step.plans), (0, 1));
    }
    assert_eq!(heads, 1);
    let drifted = (10..20).map(|decision| (decision, chase.move_goal(goal(decision), feet, 0).kind));
    let (decision, _) = drifted.into_iter().find(|(_, kind)| *kind == 2).expect("a drift");
    assert_eq!(decision, 11, "2.2 m from the goal of the plan, at 8.2 m from the NPC");
    assert_eq!(chase.advance(feet, 0).leg_count, leg_count, "the follower keeps its plan");
    let again = chase.plan(feet);
    assert_eq!((again.kind, again.plans, chase.last_leg()), (1, 2, goal(decision)));
    assert_ne!(chase.move_goal(goal(decision), feet, 0).kind, 2, "the drift counts from the last plan");
}

#[test]
fn a_goal_that_moves_far_asks_for_another_plan_of_the_same_attempt() {
    let chase = Chase::of(at(90.0, 0.2));
    let (feet, far) = (at(60.0, 0.0), at(60.0, 40.0));
    assert_eq!(chase.move_goal(at(90.0, 0.2), feet, 0).kind, 2, "it has no plan");
    let last = chase.advance_to_last_leg();
    let jump = chase.move_goal(far, feet, 0);
    assert_eq!((jump.kind, jump.plans, jump.leg_count), (2, 1, last.leg_count));
    let next = chase.plan(feet);
    assert_eq!((next.kind, next.plans, chase.last_leg()), (1, 2, far));
    assert_eq!(chase.move_goal(far, feet, 0).kind, 0);
    ok(|error| unsafe { sf_follower_note_death(chase.follower, error) });
    assert_eq!(chase.move_goal(at(90.0, 0.2), feet, 0).kind, 3, "the attempt is over");
}

#[test]
fn a_follower_heads_for_its_goal_where_its_last_waypoint_lags_behind() {
    let (before, after) = (at(96.0, 0.0), at(96.4, 0.0));
    let chase = Chase::of(before);
    chase.advance_to_last_leg();
    let feet = at(90.0, 0.0);
    let step = chase.move_goal(after, feet, 0);
    assert_eq!((step.kind, step.waypoint), (0, before), "0.4 m make no difference yet");
    let step = chase.advance(at(95.2, 0.0), 1);
    assert_eq!((step.kind, step.waypoint), (1, after));
    assert_eq!(chase.advance(at(95.5, 0.0), 1).kind, 0, "the caller says that the goal is reached");
    // A target that was caught runs on.
    let step = chase.move_goal(at(96.6, 0.0), at(95.5, 0.0), 1);
    assert_eq!((step.kind, step.waypoint), (1, at(96.6, 0.0)));
}

#[test]
fn what_is_wrong_with_a_moved_goal_is_said() {
    let chase = Chase::of(at(90.0, 0.2));
    let (place, nowhere) = (at(60.0, 0.0), at(f32::NAN, 0.0));
    let call = |goal, feet, step, error| unsafe { sf_follower_move_goal(chase.follower, goal, feet, 0, step, error) };
    fails(1, "goal is (NaN, 0, 0)", |error| call(nowhere, place, &mut step(), error));
    fails(1, "feet is (NaN, 0, 0)", |error| call(place, nowhere, &mut step(), error));
    fails(1, "step is NULL", |error| call(place, place, null_mut(), error));
    fails(1, "step.struct_size is 0", |error| call(place, place, &mut abi::Step::default(), error));
    fails(1, "follower is NULL", |error| unsafe {
        sf_follower_move_goal(null_mut(), place, place, 0, &mut step(), error)
    });
}

#[test]
fn a_graph_takes_and_gives_places_of_the_levels_file() {
    // In centimetres with z up: (x, y, z) of the level is (x + 20, z + 1, 10 - y) on the map, in metres.
    let frame = LevelFrame { origin: DVec3::new(20.0, 1.0, 10.0), scale: 0.01, up: UpAxis::Z };
    let graph = load_graph(&graph_text_of(Some(frame)));
    let mut found = abi::Frame::default();
    ok(|error| unsafe { sf_graph_frame(graph, &mut found, error) });
    assert_eq!(found, abi::Frame { origin: abi::Place { x: 20.0, y: 1.0, z: 10.0 }, scale: 0.01, z_up: 1 });
    // A place of the map as the level's file has it.
    let in_level = |place: Vec3| {
        let mut found_place = abi::Place::default();
        ok(|error| unsafe { sf_frame_to_level(&found, place, &mut found_place, error) });
        Vec3 { x: found_place.x as f32, y: found_place.y as f32, z: found_place.z as f32 }
    };
    assert_eq!(in_level(at(90.0, 40.0)), Vec3 { x: 7000.0, y: -3000.0, z: -100.0 });
    let (place, mut on_map) = (abi::Place { x: 7000.0, y: -3000.0, z: -100.0 }, Vec3::default());
    ok(|error| unsafe { sf_frame_to_map(&found, place, &mut on_map, error) });
    assert_eq!(on_map, at(90.0, 40.0));

    let (on_map, _) = find(graph, &across());
    ok(|error| unsafe { sf_graph_set_coordinates(graph, 1, error) });
    let (start, goal) = (in_level(at(0.2, 0.2)), in_level(at(90.0, 0.2)));
    let (plan, passed) = find(graph, &query(start, goal));
    assert_eq!((passed, plan.leg_count), (SHORT.to_vec(), on_map.leg_count));
    assert!((plan.seconds - on_map.seconds).abs() < 1.0e-3, "durations are not in units of the level");
    let (mut vertices, mut count) = ([Vec3::default(); 8], 0);
    ok(|error| unsafe { sf_graph_vertices(graph, vertices.as_mut_ptr(), 8, &mut count, error) });
    assert_eq!((vertices[0], vertices[7]), (in_level(at(0.0, 0.0)), in_level(at(90.0, 40.0))));
    let forbid = abi::Edit { kind: 1, value: 0.0, from: vertices[1], to: vertices[2] };
    ok(|error| unsafe { sf_graph_edit(graph, &forbid, 1, error) });
    assert_eq!(find(graph, &query(start, goal)).1, LONG);

    let follower: *mut Handle<Follower> =
        handle(|out, error| unsafe { sf_follower_create_on(graph, goal, out, error) });
    let mut next = step();
    ok(|error| unsafe { sf_follower_plan(follower, graph, start, 1.0, 0, &mut next, error) });
    assert_eq!((next.kind, next.waypoint), (1, vertices[0]));
    ok(|error| unsafe { sf_follower_advance(follower, start, 1, &mut next, error) });
    assert_eq!((next.kind, next.waypoint), (1, vertices[4]));

    let silent = load_graph(&graph_text());
    fails(3, "where its level lies", |error| unsafe { sf_graph_set_coordinates(silent, 1, error) });
    fails(3, "where its level lies", |error| unsafe { sf_graph_frame(silent, &mut found, error) });
    fails(1, "coordinates is 2", |error| unsafe { sf_graph_set_coordinates(graph, 2, error) });
    let flat = abi::Frame { scale: 0.0, ..found };
    fails(1, "frame.scale is 0", |error| unsafe { sf_frame_to_map(&flat, place, &mut Vec3::default(), error) });
    unsafe {
        sf_follower_destroy(follower);
        sf_graph_destroy(graph);
        sf_graph_destroy(silent);
    }
}

#[test]
fn what_is_wrong_with_a_graph_is_said() {
    let text = graph_text();
    let load = |bytes: &[u8], error| unsafe {
        let mut graph = null_mut();
        let status = sf_graph_load_memory(bytes.as_ptr().cast(), bytes.len(), &mut graph, error);
        sf_graph_destroy(graph);
        status
    };
    fails(4, "surefoot graph export --format json", |error| load(&text.as_bytes()[..text.len() / 2], error));
    fails(4, "JSON in UTF-8", |error| load(&[255, 254], error));
    fails(4, "surefoot graph export", |error| load(&[], error));
    fails(3, "cannot be read", |error| unsafe { sf_graph_load(c"nowhere.json".as_ptr(), &mut null_mut(), error) });
    fails(1, "graph is NULL", |error| unsafe {
        sf_graph_load_memory(text.as_ptr().cast(), text.len(), null_mut(), error)
    });
}

#[test]
fn what_is_wrong_with_a_query_is_said() {
    let graph = graph();
    let find = |query: &Query, capacity, error| unsafe {
        let (mut legs, mut count) = ([Leg::default(); 32], 0);
        sf_graph_find_path(graph, query, legs.as_mut_ptr(), capacity, &mut count, null_mut(), error)
    };
    fails(2, "legs has room for 2, but the plan has 5", |error| find(&across(), 2, error));
    fails(1, "query.struct_size is 0", |error| find(&Query { struct_size: 0, ..across() }, 32, error));
    fails(1, "query.goal is (NaN", |error| find(&query(at(0.0, 0.0), at(f32::NAN, 0.0)), 32, error));
    fails(1, "caution is 2", |error| find(&Query { caution: 2.0, ..across() }, 32, error));
    fails(1, "without is 1", |error| find(&Query { without: 1, ..across() }, 32, error));
    fails(1, "query.avoid is NULL", |error| find(&Query { avoid_count: 1, ..across() }, 32, error));
    fails(3, "no edge from vertex 0 to vertex 77", |error| unsafe { sf_graph_set_edge_open(graph, 0, 77, 0, error) });
    fails(1, "factor is 0.01", |error| unsafe { sf_graph_set_edge_price(graph, 0, 1, 0.01, error) });
    fails(1, "traversal.end is 5", |error| unsafe {
        let traversal = abi::Traversal { key: LegKey { from: 0, to: 1 }, decisions: 1, end: 5 };
        sf_graph_note_traversals(graph, &traversal, 1, error)
    });
    unsafe { sf_graph_destroy(graph) };
}
