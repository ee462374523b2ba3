//! Plans between one place and many promise what the plan of each pair promises.

use crate::search::{edges_of, edges_strategy, scattered};
use proptest::prelude::*;
use surefoot_planner::graph::GraphData;
use surefoot_planner::price::{Caution, EdgeCost, EdgeCosts};
use surefoot_planner::search::many::{Arrival, RankBy, SharedEnd, best};
use surefoot_planner::zones::{Rule, Shape};
use surefoot_planner::{
    EdgeKey, LegKey, NavGraph, Need, Needs, NoPath, Query, Router, Stop, Tags, VertexId, Zone, Zones,
};
use surefoot_world::{Aabb, Ability, Chance, MoverId, Seconds, StopSet, Vec3};

/// Legs that a query avoids: from the start, along an edge, and to the goal.
fn avoided() -> impl Strategy<Value = Vec<LegKey>> {
    let vertex = || (0..40u32).prop_map(|vertex| Stop::Vertex(VertexId(vertex)));
    let leg = prop_oneof![
        vertex().prop_map(|to| LegKey { from: Stop::Start, to }),
        vertex().prop_map(|from| LegKey { from, to: Stop::Goal }),
        (vertex(), vertex()).prop_map(|(from, to)| LegKey { from, to }),
        Just(LegKey::DIRECT),
    ];
    prop::collection::vec(leg, 0..12)
}

fn places() -> impl Strategy<Value = Vec<Vec3>> {
    let place = (0.0..110.0f32, prop_oneof![9 => 0.0..7.0f32, 1 => Just(90.0)], 0.0..100.0f32);
    prop::collection::vec(place.prop_map(|(x, y, z)| Vec3::new(x, y, z)), 1..12)
}

fn zones() -> impl Strategy<Value = Zones> {
    let place = (0.0..100.0f32, 0.0..8.0f32, 0.0..90.0f32).prop_map(|(x, y, z)| Vec3::new(x, y, z));
    let rule = prop_oneof![
        2 => (0.1..20.0f32).prop_map(Rule::Price),
        1 => Just(Rule::Never),
        1 => Just(Rule::OnlyWith("key".to_owned())),
    ];
    let zone = (place, 1.0..30.0f32, rule).prop_map(|(low, side, rule)| {
        let shape = Shape::Box(Aabb { low, high: low + side });
        Zone { name: "zone".to_owned(), shape, rule, concerns: Tags::new() }
    });
    prop_oneof![Just(Vec::new()), prop::collection::vec(zone, 1..6)].prop_map(Zones::new)
}

/// Queries with any of the restrictions that there are.
fn queries() -> impl Strategy<Value = Query> {
    let restrictions = (avoided(), any::<bool>(), prop_oneof![Just(1.0), 0.0..1.0f32], 0..3u16);
    (restrictions, zones(), any::<bool>()).prop_map(|((avoid, is_without, caution, stops), zones, has_key)| Query {
        avoid,
        without: [Ability::JUMP].into_iter().filter(|_| is_without).collect(),
        caution: Caution::new(caution).unwrap(),
        stops: if stops == 0 { Vec::new() } else { vec![StopSet(stops)] },
        zones,
        tags: ["key".to_owned()].into_iter().filter(|_| has_key).collect(),
        ..Query::new(Vec3::ZERO, Vec3::ZERO)
    })
}

/// Edges, every third of which needs a jump, and every fifth a mover at its first stop.
fn graph(tuples: Vec<(u32, u32, u32, u32, u32)>) -> NavGraph {
    let mut edges = edges_of(tuples);
    edges.iter_mut().step_by(3).for_each(|edge| edge.evidence.ability = Ability::JUMP);
    for edge in edges.iter_mut().step_by(5) {
        let mut needs = Needs::default();
        needs.add(Need { mover: MoverId(0), stops: StopSet(1) });
        edge.evidence.needs = needs;
    }
    NavGraph::check(GraphData { vertices: scattered(40), edges, ..GraphData::default() }).unwrap()
}

fn is_close(one: f64, other: f64) -> bool {
    (one - other).abs() <= 1.0e-4 * (1.0 + one.abs())
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 300,
        rng_seed: proptest::test_runner::RngSeed::Fixed(3),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn arrivals_are_those_of_the_plan_of_each_pair(
        tuples in edges_strategy(),
        query in queries(),
        places in places(),
        here in places(),
        (has_labels, begins_here) in any::<(bool, bool)>(),
        repriced in prop::collection::vec((0..40u32, 0..40u32, 1.0..90.0f32), 0..6),
    ) {
        let router = Router::new(graph(tuples), if has_labels { 4096 } else { 0 }, 1);
        let costs: EdgeCosts = repriced
            .into_iter()
            .map(|(from, to, careful)| (EdgeKey::new(from, to), EdgeCost { careful: 90.0 + careful, by_death: 0.3 }))
            .collect();
        let query = Query { start: here[0], goal: here[0], ..query };
        let shared = if begins_here { SharedEnd::Start } else { SharedEnd::Goal };
        let arrivals = router.arrivals(&query, shared, &places, &costs);
        prop_assert_eq!(arrivals.len(), places.len());
        for (place, arrival) in places.iter().zip(arrivals) {
            let query = if begins_here {
                Query { goal: *place, ..query.clone() }
            } else {
                Query { start: *place, ..query.clone() }
            };
            let plan = router.find_path_at(&query, &costs);
            prop_assert_eq!(plan.no_path, arrival.err());
            let Ok(arrival) = arrival else { continue };
            // Paths that cost the same may differ.
            let (ours, single) = (f64::from(arrival.seconds.0), f64::from(plan.seconds().0));
            prop_assert!(is_close(ours, single), "{} s, alone {} s", ours, single);
            prop_assert!(is_close(arrival.chance.get(), plan.chance().get()));
            prop_assert!(is_close(arrival.arrival_chance.get(), plan.arrival_chance().get()));
            prop_assert!(is_close(arrival.death_chance, plan.death_chance()));
        }
    }
}

#[test]
fn the_best_come_first_and_places_without_a_plan_last() {
    let arrival = |seconds: f32, cost: f32| {
        let chance = Chance::new(1.0);
        let (seconds, cost) = (Seconds(seconds), Seconds(cost));
        Ok(Arrival { seconds, cost, chance, arrival_chance: chance, death_chance: 0.0 })
    };
    let arrivals = [arrival(3.0, 9.0), Err(NoPath::OneWay), arrival(5.0, 6.0), arrival(3.0, 7.0)];
    assert_eq!(best(&arrivals, RankBy::Cost, 9), [2, 3, 0, 1]);
    assert_eq!(best(&arrivals, RankBy::Seconds, 2), [0, 3]);
    assert_eq!(best(&arrivals, RankBy::Seconds, 0), [0_usize; 0]);
}
