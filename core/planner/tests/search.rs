//! Path search compared with petgraph's algorithms, and plans on small graphs.

use petgraph::algo::{astar, dijkstra};
use petgraph::graph::{DiGraph, NodeIndex};
use proptest::prelude::*;
use surefoot_planner::evidence::{Evidence, TryEnd};
use surefoot_planner::graph::GraphData;
use surefoot_planner::live::{LiveEvidence, Reporter, Traversal};
use surefoot_planner::price::{Caution, EdgeCost, EdgeCosts};
use surefoot_planner::{
    AbilityPrices, Attach, Edge, EdgeKey, Leg, LegKey, NavGraph, NoPath, Plan, Query, Router, Stop, VertexId,
};
use surefoot_world::{Ability, DECISION_SECONDS, Seconds, Vec3};

fn edge(from: u32, to: u32, decisions: u32, successes: u32, tries: u32) -> Edge {
    let mut evidence = Evidence::default();
    for attempt in 0..tries {
        evidence.note(TryEnd::of(attempt < successes), decisions, Ability::WALK);
    }
    Edge { key: EdgeKey::new(from, to), evidence }
}

fn graph(vertices: Vec<Vec3>, edges: Vec<Edge>) -> NavGraph {
    NavGraph::check(GraphData { vertices, edges, ..GraphData::default() }).unwrap()
}

fn row(count: u32) -> Vec<Vec3> {
    (0..count).map(|idx| Vec3::new(30.0 * idx as f32, 0.0, 0.0)).collect()
}

fn router(graph: NavGraph) -> Router {
    Router::new(graph, 4096, 2)
}

/// Scatters vertices so that straight-line distance is a weak guide to the cost of a path.
pub fn scattered(count: u32) -> Vec<Vec3> {
    (0..count).map(|idx| Vec3::new((idx * 37 % 101) as f32, (idx * 13 % 7) as f32, (idx * 53 % 89) as f32)).collect()
}

/// Edges as (from, to, decisions, successes, failures).
pub fn edges_strategy() -> impl Strategy<Value = Vec<(u32, u32, u32, u32, u32)>> {
    prop::collection::vec((0..40u32, 0..40u32, 1..60u32, 1..4u32, 0..3u32), 0..200)
}

pub fn edges_of(tuples: Vec<(u32, u32, u32, u32, u32)>) -> Vec<Edge> {
    let mut seen = std::collections::BTreeSet::new();
    tuples
        .into_iter()
        .filter(|&(a, b, ..)| a != b && seen.insert((a, b)))
        .map(|(a, b, decisions, successes, failures)| edge(a, b, decisions, successes, successes + failures))
        .collect()
}

fn cost_of(graph: &NavGraph, path: &[VertexId]) -> f64 {
    path.windows(2)
        .map(|pair| graph.edge(EdgeKey { from: pair[0], to: pair[1] }).expect("a path follows edges").evidence.cost())
        .sum()
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 300,
        rng_seed: proptest::test_runner::RngSeed::Fixed(1),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn hub_labels_our_a_star_and_petgraphs_searches_agree(
        tuples in edges_strategy(),
        from in 0..40u32,
        to in 0..40u32,
    ) {
        let graph = graph(scattered(40), edges_of(tuples));
        let router = router(graph.clone());
        let (source, target) = (NodeIndex::new(from as usize), NodeIndex::new(to as usize));
        let node = |vertex: VertexId| NodeIndex::new(vertex.idx());
        let mut petgraph: DiGraph<(), f64> = DiGraph::new();
        graph.vertices().for_each(|_| _ = petgraph.add_node(()));
        for edge in graph.edges() {
            petgraph.add_edge(node(edge.key.from), node(edge.key.to), edge.evidence.cost());
        }
        let theirs = dijkstra(&petgraph, source, Some(target), |edge| *edge.weight());
        let star = astar(&petgraph, source, |node| node == target, |edge| *edge.weight(), |_| 0.0);
        let (from, to) = (VertexId(from), VertexId(to));
        match (router.look_up(from, to), router.search(from, to), theirs.get(&target), star) {
            (None, None, None, None) => {}
            (Some(by_labels), Some(searched), Some(reference), Some((star, _))) => {
                let close = |cost: f64| (cost - reference).abs() < 1.0e-4 * (1.0 + reference);
                prop_assert!(close(star));
                for (cost, path) in [by_labels, searched] {
                    prop_assert!(close(f64::from(cost)));
                    prop_assert_eq!((path[0], path[path.len() - 1]), (from, to));
                    prop_assert!(close(cost_of(&graph, &path)));
                }
            }
            other => prop_assert!(false, "they disagree on whether there is a path: {:?}", other),
        }
    }

    #[test]
    fn plans_with_and_without_hub_labels_cost_the_same(
        tuples in edges_strategy(),
        ends in prop::array::uniform6(0.0..100.0f32),
        barred in prop::collection::vec((0..40u32, 0..40u32), 0..6),
    ) {
        let graph = graph(scattered(40), edges_of(tuples));
        let (start, goal) = (Vec3::new(ends[0], 0.0, ends[1]), Vec3::new(ends[2] + 60.0, ends[3] / 20.0, ends[4]));
        let barred: Vec<LegKey> = barred.into_iter().map(|(from, to)| EdgeKey::new(from, to).into()).collect();
        let query = Query { avoid: barred.clone(), ..Query::new(start, goal) };
        let without = Router::new(graph.clone(), 0, 1).find_path(&query);
        let with = router(graph).find_path(&query);
        let cost = |leg: &Leg| f64::from(leg.seconds.0) / (1.0 / 6.0) - 60.0 * libm::log(leg.chance.get());
        let total = |plan: &Plan| plan.legs.iter().map(cost).sum::<f64>();
        prop_assert_eq!(with.no_path, without.no_path);
        let (with_labels, without_labels) = (total(&with), total(&without));
        let is_same = (with_labels - without_labels).abs() < 1.0e-2 * (1.0 + with_labels);
        prop_assert!(is_same, "{with_labels} and {without_labels}");
        prop_assert!(with.legs.iter().all(|leg| !barred.contains(&leg.key)));
    }

    /// Dijkstra's search over edges that cost as much more decisions as their price says.
    #[test]
    fn priced_plans_are_the_cheapest(
        tuples in edges_strategy(),
        jumps in prop::collection::btree_set((0..40u32, 0..40u32), 0..800),
        (from, to) in (0..40u32, 0..40u32),
        price in 0.0..20.0f32,
    ) {
        let mut edges = edges_of(tuples);
        for edge in &mut edges {
            if jumps.contains(&(edge.key.from.0, edge.key.to.0)) {
                edge.evidence.ability = Ability::JUMP;
            }
        }
        let graph = graph(scattered(40), edges);
        let mut petgraph: DiGraph<(), f64> = DiGraph::new();
        graph.vertices().for_each(|_| _ = petgraph.add_node(()));
        let cost = |ability: Ability, cost: f64| {
            cost + if ability == Ability::JUMP { f64::from(price / DECISION_SECONDS) } else { 0.0 }
        };
        for edge in graph.edges() {
            let node = |vertex: VertexId| NodeIndex::new(vertex.idx());
            let weight = cost(edge.evidence.ability, edge.evidence.cost());
            petgraph.add_edge(node(edge.key.from), node(edge.key.to), weight);
        }
        let target = NodeIndex::new(to as usize);
        let cheapest = dijkstra(&petgraph, NodeIndex::new(from as usize), Some(target), |edge| *edge.weight());
        let mut prices = AbilityPrices::default();
        prop_assert!(prices.add(Ability::JUMP, Seconds(price)));
        let ends = [from, to].map(|vertex| graph.position(VertexId(vertex)));
        // From vertex to vertex, without unproved legs.
        let query = Query { prices, attach: Attach::Nearest, ..Query::new(ends[0], ends[1]) };
        for label_limit in [4096, 0] {
            let plan = Router::new(graph.clone(), label_limit, 1).find_path(&query);
            let edges = plan.legs.iter().filter_map(|leg| leg.key.edge());
            let evidence = edges.map(|key| graph.edge(key).unwrap().evidence);
            let paid: f64 = evidence.map(|it| cost(it.ability, it.cost())).sum();
            match cheapest.get(&target) {
                Some(least) => prop_assert!((paid - least).abs() < 1.0e-3 * (1.0 + least), "{paid}, not {least}"),
                None => prop_assert!(plan.no_path.is_some()),
            }
        }
    }

    #[test]
    fn no_leg_of_a_plan_leads_along_a_forbidden_edge(
        tuples in edges_strategy(),
        ends in (0..40u32, 0..40u32),
        forbidden in prop::collection::btree_set((0..40u32, 0..40u32), 0..400),
    ) {
        let forbidden: Vec<EdgeKey> = forbidden.into_iter().map(|(from, to)| EdgeKey::new(from, to)).collect();
        let edges = edges_of(tuples).into_iter().filter(|edge| !forbidden.contains(&edge.key)).collect();
        let graph = graph(scattered(40), edges);
        let near = |vertex: u32| graph.position(VertexId(vertex)) + Vec3::new(0.3, 0.0, -0.3);
        let query = Query::new(near(ends.0), near(ends.1));
        let plan = router(graph.clone()).forbidding(forbidden.iter().copied()).find_path(&query);
        let passed = std::iter::once(&query.start).chain(&plan.waypoints).collect::<Vec<_>>();
        if plan.no_path.is_some() {
            return Ok(());
        }
        for pair in passed.windows(2) {
            let is_at = |vertex: VertexId, place: &Vec3| graph.position(vertex).distance(*place) <= 1.0;
            for key in &forbidden {
                prop_assert!(!(is_at(key.from, pair[0]) && is_at(key.to, pair[1])), "{:?} is forbidden", key);
            }
        }
    }
}

#[test]
fn a_plan_passes_proved_vertices_and_ends_at_the_goal() {
    let graph = graph(row(4), vec![edge(0, 1, 10, 2, 2), edge(1, 2, 10, 2, 2), edge(2, 3, 10, 2, 2)]);
    let goal = Vec3::new(92.0, 0.0, 1.0);
    let plan = router(graph).find_path(&Query::new(Vec3::new(-1.0, 0.0, 0.0), goal));
    assert_eq!(plan.no_path, None);
    assert_eq!(plan.waypoints.last(), Some(&goal));
    assert_eq!(plan.legs.len(), plan.waypoints.len());
    assert!(plan.legs.iter().any(|leg| leg.key.edge() == Some(EdgeKey::new(1, 2))));
    assert!(plan.chance().get() > 0.0 && plan.seconds().0 > 0.0);
}

#[test]
fn a_safe_detour_is_preferred_to_a_risky_short_cut() {
    let vertices = vec![Vec3::ZERO, Vec3::new(60.0, 0.0, 0.0), Vec3::new(30.0, 0.0, 25.0)];
    let graph = graph(vertices, vec![edge(0, 1, 30, 1, 10), edge(0, 2, 25, 10, 10), edge(2, 1, 25, 10, 10)]);
    assert_eq!(router(graph).look_up(VertexId(0), VertexId(1)).unwrap().1, [0, 2, 1].map(VertexId));
}

#[test]
fn unproved_legs_do_not_stand_in_for_forbidden_edges() {
    let vertices = vec![Vec3::ZERO, Vec3::new(12.0, 0.0, 0.0), Vec3::new(6.0, 0.0, 30.0)];
    // Without the edge from 0 to 1.
    let graph = graph(vertices.clone(), vec![edge(0, 2, 25, 10, 10), edge(2, 1, 25, 10, 10), edge(1, 0, 10, 10, 10)]);
    let leads_straight = |router: &Router, start, goal| {
        router.find_path(&Query::new(start, goal)).legs.iter().all(|leg| leg.key.edge().is_none())
    };
    for label_limit in [4096, 0] {
        let proved = Router::new(graph.clone(), label_limit, 1);
        assert!(leads_straight(&proved, vertices[0], vertices[1]), "as unproved as any other leg");
        let router = proved.forbidding([EdgeKey::new(0, 1)]);
        let beside = Vec3::new(0.5, 0.0, 0.5);
        for (start, goal) in [(vertices[0], vertices[1]), (beside, vertices[1] + beside)] {
            let plan = router.find_path(&Query::new(start, goal));
            assert_eq!(plan.no_path, None);
            assert!(plan.waypoints.contains(&vertices[2]), "the way round: {plan:?}");
        }
        // Elsewhere, and in the other direction, nothing is forbidden.
        assert!(leads_straight(&router, vertices[1], vertices[0]));
        assert!(leads_straight(&router, Vec3::new(3.0, 0.0, 0.0), vertices[1]));
    }
}

#[test]
fn where_the_only_way_is_forbidden_there_is_none() {
    let graph = graph(vec![Vec3::ZERO, Vec3::new(12.0, 0.0, 0.0)], vec![edge(1, 0, 10, 10, 10)]);
    let plan =
        router(graph).forbidding([EdgeKey::new(0, 1)]).find_path(&Query::new(Vec3::ZERO, Vec3::new(12.0, 0.0, 0.0)));
    assert!(plan.no_path.is_some(), "{plan:?}");
}

/// An edge of 10 decisions that needs an ability.
fn edge_by(from: u32, to: u32, ability: Ability) -> Edge {
    let mut evidence = Evidence::default();
    evidence.note(TryEnd::Arrived, 10, ability);
    Edge { key: EdgeKey::new(from, to), evidence }
}

#[test]
fn a_plan_does_without_excluded_abilities_with_and_without_labels() {
    let vertices = vec![Vec3::ZERO, Vec3::new(60.0, 0.0, 0.0), Vec3::new(30.0, 0.0, 40.0), Vec3::new(120.0, 0.0, 0.0)];
    let edges = vec![
        edge_by(0, 1, Ability::DOUBLE_JUMP),
        edge_by(0, 2, Ability::WALK),
        edge_by(2, 1, Ability::PAD),
        edge_by(1, 3, Ability::ZIP_LINE),
    ];
    let graph = graph(vertices, edges);
    for label_limit in [4096, 0] {
        let router = Router::new(graph.clone(), label_limit, 1);
        let plan = |without: &[Ability], goal: Vec3| {
            router.find_path(&Query { without: without.iter().copied().collect(), ..Query::new(Vec3::ZERO, goal) })
        };
        let used = |without: &[Ability]| -> Vec<Ability> {
            let plan = plan(without, Vec3::new(60.0, 0.0, 0.0));
            plan.legs.iter().filter(|leg| leg.key.edge().is_some()).map(|leg| leg.ability).collect()
        };
        assert_eq!(used(&[]), [Ability::DOUBLE_JUMP]);
        assert_eq!(used(&[Ability::ZIP_LINE]), [Ability::DOUBLE_JUMP]);
        assert_eq!(used(&[Ability::DOUBLE_JUMP]), [Ability::WALK, Ability::PAD]);
        assert_eq!(used(&[Ability::JUMP]), [Ability::WALK, Ability::PAD], "a double jump begins with a jump");
        let told = plan(&[Ability::ZIP_LINE], Vec3::new(120.0, 0.0, 0.0));
        assert_eq!(told.no_path, Some(NoPath::DifferentIslands));
        assert_eq!(told.nearest, Some(Vec3::new(60.0, 0.0, 0.0)), "as near as it gets without zip lines");
    }
}

#[test]
fn a_plan_pays_for_abilities_with_and_without_labels() {
    let vertices = vec![Vec3::ZERO, Vec3::new(60.0, 0.0, 0.0), Vec3::new(30.0, 0.0, 40.0)];
    let edges = vec![edge_by(0, 1, Ability::JUMP), edge_by(0, 2, Ability::WALK), edge_by(2, 1, Ability::PAD)];
    let graph = graph(vertices, edges);
    for label_limit in [4096, 0] {
        let router = Router::new(graph.clone(), label_limit, 1);
        let used = |priced: &[(Ability, f32)]| -> Vec<Ability> {
            let mut prices = AbilityPrices::default();
            assert!(priced.iter().all(|(ability, price)| prices.add(*ability, Seconds(*price))));
            let query = Query { prices, ..Query::new(Vec3::ZERO, Vec3::new(60.0, 0.0, 0.0)) };
            let plan = router.find_path(&query);
            plan.legs.iter().filter(|leg| leg.key.edge().is_some()).map(|leg| leg.ability).collect()
        };
        // The detour has one leg more, and with it the time and the risk of one more.
        let one_more = graph.edge(EdgeKey::new(0, 1)).unwrap().evidence.cost() as f32 * DECISION_SECONDS;
        assert_eq!(used(&[]), [Ability::JUMP]);
        assert_eq!(used(&[(Ability::JUMP, 0.9 * one_more)]), [Ability::JUMP]);
        assert_eq!(used(&[(Ability::JUMP, 1.1 * one_more)]), [Ability::WALK, Ability::PAD]);
        assert_eq!(used(&[(Ability::JUMP, 0.6 * one_more); 2]), [Ability::WALK, Ability::PAD], "prices add up");
        assert_eq!(used(&[(Ability::JUMP, 1.1 * one_more), (Ability::PAD, 0.2 * one_more)]), [Ability::JUMP]);
    }
    let mut prices = AbilityPrices::default();
    for wrong in [-1.0, 1000.1, f32::NAN, f32::INFINITY] {
        assert!(!prices.add(Ability::JUMP, Seconds(wrong)) && prices.is_empty(), "{wrong}");
    }
}

#[test]
fn the_more_cautious_a_plan_the_farther_it_goes_around_an_edge_that_kills() {
    // Both of the short ways fail once in ten tries, and one of them kills.
    let short = |end: TryEnd, to: u32| {
        let mut evidence = Evidence::default();
        (0..9).for_each(|_| evidence.note(TryEnd::Arrived, 20, Ability::WALK));
        evidence.note(end, 20, Ability::WALK);
        Edge { key: EdgeKey::new(0, to), evidence }
    };
    let vertices =
        vec![Vec3::ZERO, Vec3::new(100.0, 0.0, 0.0), Vec3::new(50.0, 0.0, 60.0), Vec3::new(-100.0, 0.0, 0.0)];
    let around = [edge(0, 2, 50, 99, 99), edge(2, 1, 50, 99, 99), edge(2, 3, 50, 99, 99)];
    let edges = [vec![short(TryEnd::Died, 1), short(TryEnd::Failed, 3)], around.to_vec()].concat();
    let graph = graph(vertices, edges);
    for label_limit in [4096, 0] {
        let router = Router::new(graph.clone(), label_limit, 1);
        let plan = |x: f32, caution: Caution| {
            router.find_path(&Query { caution, ..Query::new(Vec3::ZERO, Vec3::new(x, 0.0, 0.0)) })
        };
        let passes = |x: f32, caution: Caution| plan(x, caution).waypoints.contains(&Vec3::new(50.0, 0.0, 60.0));
        assert!(passes(100.0, Caution::CAREFUL), "a careful plan goes around");
        assert!(!passes(100.0, Caution::BOLD), "a bold one does not");
        assert!(!passes(100.0, Caution::new(0.1).unwrap()), "nor does one that is hardly careful");
        assert!(!passes(-100.0, Caution::CAREFUL), "failing without harm is worth no detour");
        let (careful, bold) = (plan(100.0, Caution::CAREFUL), plan(100.0, Caution::BOLD));
        assert!(bold.death_chance() > 0.05 && careful.death_chance() < 0.02, "{bold:?} {careful:?}");
        assert!(bold.arrival_chance().get() > bold.chance().get(), "most failures are made good by other plans");
    }
    assert_eq!([-0.1, 1.1, f32::NAN].map(Caution::new), [None; 3]);
}

#[test]
fn reported_deaths_make_careful_plans_go_around() {
    let graph = graph(row(2), vec![edge(0, 1, 10, 20, 20)]);
    let (mut died, mut failed) = (LiveEvidence::default(), LiveEvidence::default());
    let cost = |live: &mut LiveEvidence, end| {
        let traversal = Traversal { edge: EdgeKey::new(0, 1), end, decisions: 10 };
        live.note(&graph, &reporter("worker", true), &traversal).unwrap().careful
    };
    assert!(cost(&mut died, TryEnd::Died) > cost(&mut failed, TryEnd::Failed) + 10.0);
    for _ in 0..500 {
        cost(&mut died, TryEnd::Died);
        assert!(died.is_sound());
    }
    let evidence = died.apply_to(&graph).edge(EdgeKey::new(0, 1)).unwrap().evidence;
    assert!(evidence.is_consistent() && evidence.death_chance() > 0.5, "{evidence:?}");
}

#[test]
fn a_failed_leg_is_not_used_again() {
    let graph = graph(row(3), vec![edge(0, 1, 10, 2, 2), edge(1, 2, 10, 2, 2), edge(0, 2, 30, 2, 2)]);
    let router = router(graph);
    let passed = |avoid: Vec<LegKey>, repriced: &EdgeCosts| -> Vec<(u32, u32)> {
        let query = Query { avoid, ..Query::new(Vec3::ZERO, Vec3::new(60.0, 0.0, 0.0)) };
        let plan = router.find_path_at(&query, repriced);
        plan.legs.iter().filter_map(|leg| leg.key.edge()).map(|edge| (edge.from.0, edge.to.0)).collect()
    };
    assert_eq!(passed(Vec::new(), &EdgeCosts::new()), [(0, 1), (1, 2)]);
    assert_eq!(passed(vec![EdgeKey::new(1, 2).into()], &EdgeCosts::new()), [(0, 2)]);
    // The same holds where the edge has become expensive for all queries.
    assert_eq!(
        passed(Vec::new(), &EdgeCosts::from([(EdgeKey::new(1, 2), EdgeCost { careful: 500.0, by_death: 0.0 })])),
        [(0, 2)]
    );
}

fn reporter(name: &str, is_trusted: bool) -> Reporter {
    Reporter { name: name.to_owned(), is_trusted }
}

#[test]
fn reports_of_strangers_never_outweigh_the_probes_and_can_be_taken_back() {
    let graph = graph(row(2), vec![edge(0, 1, 10, 4, 4)]);
    let mut live = LiveEvidence::default();
    let failure = Traversal { edge: EdgeKey::new(0, 1), end: TryEnd::Failed, decisions: 10 };
    let mut note = |name: &str, is_trusted, count: u32| {
        (0..count).for_each(|_| {
            live.note(&graph, &reporter(name, is_trusted), &failure).unwrap();
        });
        live.clone()
    };
    let counted = |live: &LiveEvidence| live.apply_to(&graph).edge(EdgeKey::new(0, 1)).unwrap().evidence.tries - 4;
    assert_eq!(counted(&note("game", false, 500)), 2, "half of four probes");
    assert_eq!(counted(&note("other game", false, 500)), 2, "all strangers together");
    assert_eq!(counted(&note("worker", true, 10)), 12, "a worker's traversals count in full");
    let mut live = note("worker", true, 0);
    let names: Vec<String> = live.reports().into_iter().map(|report| report.reporter.name).collect();
    assert_eq!(names, ["game", "other game", "worker"]);
    assert_eq!((live.drop_reports("worker"), live.drop_reports("nobody")), (10, 0));
    live.drop_reports("game");
    live.drop_reports("other game");
    assert!(live.is_empty() && counted(&live) == 0);
}

#[test]
fn any_number_of_reporters_takes_bounded_memory() {
    let graph = graph(row(2), vec![edge(0, 1, 10, 4, 4)]);
    let mut live = LiveEvidence::default();
    let failure = Traversal { edge: EdgeKey::new(0, 1), end: TryEnd::Failed, decisions: 10 };
    for number in 0..1000 {
        live.note(&graph, &reporter(&number.to_string(), number % 2 == 0), &failure).unwrap();
    }
    assert!(live.reports().len() <= 66 && live.is_sound(), "{} reporters", live.reports().len());
}

#[test]
fn a_goal_that_no_leg_can_reach_is_off_the_graph() {
    let chain = (0..7).map(|idx| edge(idx, idx + 1, 10, 2, 2)).collect();
    let router = router(graph(row(8), chain));
    let reason = |goal| router.find_path(&Query::new(Vec3::ZERO, goal)).no_path;
    assert_eq!(reason(Vec3::new(190.0, 0.0, 10.0)), None);
    assert_eq!(reason(Vec3::new(190.0, 50.0, 0.0)), Some(NoPath::GoalOffGraph), "50 m up in the air");
    assert_eq!(reason(Vec3::new(1.0e9, 0.0, 0.0)), Some(NoPath::GoalOffGraph));
}

#[test]
fn reported_failures_divert_plans_and_later_successes_bring_them_back() {
    let graph = graph(row(3), vec![edge(0, 1, 10, 2, 2), edge(1, 2, 10, 2, 2), edge(0, 2, 50, 2, 2)]);
    let mut live = LiveEvidence::default();
    let worker = reporter("worker", true);
    let traversal = |reached| Traversal { edge: EdgeKey::new(1, 2), end: TryEnd::of(reached), decisions: 10 };
    let before = graph.edge(EdgeKey::new(1, 2)).unwrap().evidence.cost();
    let mut cost = 0.0;
    for _ in 0..4 {
        cost = f64::from(live.note(&graph, &worker, &traversal(false)).unwrap().careful);
    }
    assert!(cost > before + 20.0, "{cost} after {before}");
    let path = |live: &LiveEvidence| router(live.apply_to(&graph)).look_up(VertexId(0), VertexId(2)).unwrap().1;
    assert_eq!(path(&live), [0, 2].map(VertexId));
    for _ in 0..200 {
        live.note(&graph, &worker, &traversal(true));
    }
    assert_eq!(path(&live), [0, 1, 2].map(VertexId));
    assert!(live.traversals() < 100, "old traversals are forgotten");
    assert_eq!(
        live.note(&graph, &worker, &Traversal { edge: EdgeKey::new(2, 0), end: TryEnd::Arrived, decisions: 1 }),
        None
    );
}

#[test]
fn without_a_path_the_plan_gives_the_reason_and_leads_to_the_nearest_place() {
    let two_islands = |edges: Vec<Edge>| {
        let mut vertices = row(8);
        vertices.extend((0..8).map(|idx| Vec3::new(5000.0 + 30.0 * idx as f32, 0.0, 0.0)));
        let chain = |from: u32, to: u32| {
            (from..to).flat_map(|idx| [edge(idx, idx + 1, 10, 2, 2), edge(idx + 1, idx, 10, 2, 2)])
        };
        graph(vertices, chain(0, 7).chain(chain(8, 15)).chain(edges).collect())
    };
    let (start, goal) = (Vec3::new(10.0, 0.0, 0.0), Vec3::new(5100.0, 0.0, 0.0));
    let plan = router(two_islands(Vec::new())).find_path(&Query::new(start, goal));
    assert_eq!((plan.no_path, plan.nearest), (Some(NoPath::DifferentIslands), Some(Vec3::new(210.0, 0.0, 0.0))));
    assert_eq!((plan.waypoints.len(), plan.waypoints.last()), (plan.legs.len(), plan.nearest.as_ref()));
    assert_eq!(
        (plan.legs[0].key.from, plan.legs[plan.legs.len() - 1].key.to),
        (Stop::Start, Stop::Vertex(VertexId(7)))
    );
    let plan = router(two_islands(vec![edge(8, 7, 10, 2, 2)])).find_path(&Query::new(start, goal));
    assert_eq!(plan.no_path, Some(NoPath::OneWay));
    let plan = router(two_islands(vec![edge(7, 8, 10, 2, 2)])).find_path(&Query::new(start, goal));
    assert_eq!(plan.no_path, None);
    let bare = graph(row(3), Vec::new());
    assert_eq!(
        router(bare).find_path(&Query::new(Vec3::ZERO, Vec3::new(60.0, 0.0, 0.0))).no_path,
        Some(NoPath::StartOffGraph)
    );
}

#[test]
fn islands_are_strongly_connected_components() {
    let graph = graph(row(4), vec![edge(0, 1, 5, 1, 1), edge(1, 0, 5, 1, 1), edge(1, 2, 5, 1, 1)]);
    assert_eq!(graph.island_count(), 3);
    assert_eq!(graph.islands()[0], graph.islands()[1]);
    assert!((graph.connected_share() - 4.0 / 12.0).abs() < 1.0e-9);
}

#[test]
fn invalid_edges_and_positions_are_rejected() {
    let check = |edges| NavGraph::check(GraphData { vertices: row(2), edges, ..GraphData::default() });
    assert!(check(vec![edge(0, 2, 5, 1, 1)]).is_err());
    assert!(check(vec![edge(1, 1, 5, 1, 1)]).is_err());
    assert!(
        NavGraph::check(GraphData {
            vertices: vec![Vec3::new(f32::NAN, 0.0, 0.0)],
            edges: Vec::new(),
            ..GraphData::default()
        })
        .is_err()
    );
}

#[test]
fn a_very_long_chain_of_vertices_is_checked_without_deep_recursion() {
    let count = 200_000;
    let edges = (1..count).map(|to| edge(to - 1, to, 1, 1, 1)).collect();
    let graph = graph(vec![Vec3::ZERO; count as usize], edges);
    assert_eq!(graph.island_count(), count);
}

#[test]
fn a_query_that_snaps_takes_the_nearest_vertices_whatever_they_cost() {
    // Vertex 1 is nearest to the start, but only a detour leads on from there.
    let vertices =
        [[0.0, 0.0], [10.0, 4.0], [10.0, 40.0], [60.0, 40.0], [60.0, 0.0]].map(|[x, z]| Vec3::new(x, 0.0, z));
    let edges = vec![edge(0, 4, 10, 2, 2), edge(1, 2, 10, 2, 2), edge(2, 3, 10, 2, 2), edge(3, 4, 10, 2, 2)];
    let router = router(graph(vertices.to_vec(), edges));
    let query = Query::new(Vec3::new(6.0, 0.0, 3.0), Vec3::new(58.0, 0.0, 0.0));
    let several = router.find_path(&query);
    assert_eq!(several.waypoints, [vertices[0], vertices[4], query.goal]);
    let nearest = router.find_path(&Query { attach: Attach::Nearest, ..query.clone() });
    assert_eq!(nearest.waypoints, [vertices[1], vertices[2], vertices[3], vertices[4], query.goal]);
    assert!(nearest.no_path.is_none());
    // Nothing leads back: the plan heads straight for the goal.
    let back = Query { attach: Attach::Nearest, ..Query::new(query.goal, query.start) };
    let straight = router.find_path(&back);
    assert_eq!((straight.waypoints.as_slice(), straight.nearest), ([back.goal].as_slice(), None));
    assert_eq!(straight.no_path, Some(NoPath::OneWay));
}

#[test]
fn edges_that_are_priced_by_steps_cost_their_decisions_whatever_the_risk() {
    let square = [[0.0, 0.0], [20.0, 0.0], [20.0, 20.0], [0.0, 20.0]].map(|[x, z]| Vec3::new(x, 0.0, z));
    // The short way succeeds once in four tries, the long one always.
    let risky = graph(square.to_vec(), vec![edge(0, 2, 10, 1, 4), edge(0, 1, 10, 4, 4), edge(1, 2, 10, 4, 4)]);
    let way = |graph: NavGraph| router(graph).look_up(VertexId(0), VertexId(2)).expect("a way");
    assert_eq!(way(risky.clone()).1, [0, 1, 2].map(VertexId));
    assert_eq!(way(risky.priced_by_decisions()), (10.0, vec![VertexId(0), VertexId(2)]));
}
