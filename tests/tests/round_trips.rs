//! Maps, recordings, graphs, layers and messages are unchanged after writing and reading.

use crate::decoders::FLOOR;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use surefoot_planner::BuildStats;
use surefoot_planner::edits::{Edit, Layer};
use surefoot_planner::evidence::{Evidence, TryEnd};
use surefoot_planner::export::{Format, export, import_json};
use surefoot_planner::graph::GraphData;
use surefoot_planner::live::{LiveEvidence, Reporter, Traversal};
use surefoot_planner::{
    BuildSettings, Built, Edge, EdgeKey, Leg, LegKey, NavGraph, Need, Needs, NoPath, Placement, Plan, Probing,
    RawBuildSettings, Ride, Stop, VertexId, store as cache,
};
use surefoot_planner_service::{PlannerConfig, layer_from_wire, layer_to_wire, settings_from_wire};
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::plans::{self, plan_to_wire, settings_to_wire};
use surefoot_world::map::{
    Building, Cave, Features, Jetpack, Liquid, MapKind, MapSize, MoverDensities, Outline, Pad, Placed, Plateau, Pool,
    Ravine, Spot, Teleporter, ZipLine,
};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::replay::Recording;
use surefoot_world::{
    Ability, Action, Arrival, Chance, CharacterProfile, Decisions, Map, MapSpec, MoverId, RawMapSpec, Seconds, StopIdx,
    StopSet, TaskConfig, Vec3, World, WorldConfig,
};

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, rng_seed: RngSeed::Fixed(2), failure_persistence: None, ..ProptestConfig::default() }
}

fn several<S: Strategy>(of: S) -> impl Strategy<Value = Vec<S::Value>> {
    prop::collection::vec(of, 0..4)
}

/// A point within or near a map of 20 x 10 x 20 m.
fn point() -> impl Strategy<Value = Vec3> {
    (-2.0..22.0f32, -2.0..12.0f32, -2.0..22.0f32).prop_map(|(x, y, z)| Vec3::new(x, y, z))
}

fn anywhere() -> impl Strategy<Value = Vec3> {
    let number = || prop::num::f32::NORMAL | prop::num::f32::SUBNORMAL | prop::num::f32::ZERO;
    (number(), number(), number()).prop_map(|(x, y, z)| Vec3::new(x, y, z))
}

fn on_a_map() -> impl Strategy<Value = Vec3> {
    (0.0..1000.0f32, 0.0..200.0f32, 0.0..1000.0f32).prop_map(|(x, y, z)| Vec3::new(x, y, z))
}

fn pool() -> impl Strategy<Value = Pool> {
    let outline = prop_oneof![
        (0.1..9.0f32).prop_map(|radius| Outline::Round { radius }),
        (0.1..9.0f32, 0.1..9.0f32).prop_map(|(half_x, half_z)| Outline::Rectangle { half_x, half_z }),
    ];
    let liquid = prop_oneof![Just(Liquid::Water), Just(Liquid::Lava)];
    (point(), outline, 0.0..3.0f32, liquid).prop_map(|(centre, outline, depth, liquid)| Pool {
        centre,
        outline,
        depth,
        liquid,
    })
}

fn building() -> impl Strategy<Value = Building> {
    (point(), [0.5..5.0f32, 0.5..5.0f32], -3.0..3.0f32, 1.0..9.0f32, 0..4u8, any::<bool>()).prop_map(
        |(base, half, yaw, height, storeys, roof_stairs)| Building { base, half, yaw, height, storeys, roof_stairs },
    )
}

fn spot() -> impl Strategy<Value = Spot> {
    ("[a-z][a-z0-9_]{0,31}", point(), prop::option::of(point()), any::<bool>())
        .prop_map(|(tag, from, to, two_way)| Spot { tag, from, to, two_way })
}

fn placed() -> impl Strategy<Value = Placed> {
    let devices = (
        several(pool()),
        several((point(), 1.0..30.0f32).prop_map(|(centre, speed)| Pad { centre, speed })),
        several((point(), point()).prop_map(|(from, to)| ZipLine { from, to })),
        several((point(), point(), any::<bool>()).prop_map(|(from, to, two_way)| Teleporter { from, to, two_way })),
        several((point(), 0.0..9.0f32).prop_map(|(centre, fuel)| Jetpack { centre, fuel })),
        several(spot()),
    );
    let ground = (
        several(building()),
        several((point(), 0.5..5.0f32).prop_map(|(top, radius)| Plateau { top, radius })),
        several((several(point()), 0.5..5.0f32).prop_map(|(path, width)| Ravine { path, width })),
        several((point(), point(), 0.5..5.0f32).prop_map(|(from, to, radius)| Cave { from, to, radius })),
    );
    (devices, ground).prop_map(|(devices, ground)| {
        let ((pools, pads, zip_lines, teleporters, jetpacks, spots), (buildings, plateaus, ravines, caves)) =
            (devices, ground);
        Placed { pools, pads, zip_lines, teleporters, jetpacks, buildings, plateaus, ravines, caves, spots }
    })
}

proptest! {
    #![proptest_config(config(2000))]

    #[test]
    fn maps_keep_their_bits(corners in prop::collection::vec([point(), point(), point()], 0..20), placed in placed()) {
        let size = MapSize { width: 20, height: 10, depth: 20 };
        let triangles = corners.into_iter().filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect();
        let map = Map::from_parts(size, triangles, placed);
        let back = surefoot_levels::decode(&surefoot_levels::encode(&map)).unwrap();
        prop_assert_eq!(back.hash(), map.hash());
        prop_assert_eq!(back.placed(), map.placed());
        prop_assert_eq!(surefoot_levels::encode(&back), surefoot_levels::encode(&map));
    }
}

/// An input to the one or two NPCs of a world, each followed by some ticks.
#[derive(Debug, Clone)]
enum Move {
    Decide(Action),
    SetGoal(Vec3),
    ClearGoal,
    Teleport(Vec3, f32),
    Close,
    Replace(Vec3),
}

fn moves() -> impl Strategy<Value = Vec<(Move, u8)>> {
    let one = || -1.0..1.0f32;
    let action =
        (one(), one(), one(), one()).prop_map(|(forward, strafe, turn, jump)| Action { forward, strafe, turn, jump });
    let step = prop_oneof![
        action.prop_map(Move::Decide),
        point().prop_map(Move::SetGoal),
        Just(Move::ClearGoal),
        (point(), -3.0..3.0f32).prop_map(|(feet, yaw)| Move::Teleport(feet, yaw)),
        Just(Move::Close),
        // Points far outside too: such an NPC leaves the map and stays there.
        prop_oneof![point(), anywhere()].prop_map(Move::Replace),
    ];
    prop::collection::vec((step, 0..30u8), 0..12)
}

proptest! {
    #![proptest_config(config(1000))]

    #[test]
    fn recordings_keep_their_bits_and_repeat(moves in moves(), npc_collision in any::<bool>()) {
        let profiles = vec![CharacterProfile::default()];
        let config = WorldConfig { profiles, task: TaskConfig::default(), npc_collision };
        let mut world = World::with_config(FLOOR.clone(), config);
        let bystander = world.spawn(Vec3::new(10.0, 1.0, 10.0), 0.0);
        let mut npc = world.spawn(Vec3::new(10.2, 1.0, 10.0), 0.0);
        world.set_waypoint(bystander, Vec3::new(12.0, 1.0, 12.0));
        world.start_recording();
        for (step, ticks) in moves {
            match step {
                Move::Decide(action) => world.decide(npc, action),
                Move::SetGoal(goal) => world.set_waypoint(npc, goal),
                Move::ClearGoal => world.clear_waypoint(npc),
                Move::Teleport(feet, yaw) => world.teleport(npc, feet, yaw),
                Move::Close => _ = world.close_decision(npc),
                Move::Replace(feet) => {
                    world.despawn(npc);
                    npc = world.spawn(feet, 1.0);
                }
            }
            (0..ticks).for_each(|_| world.tick());
        }
        let recording = world.finish_recording().unwrap();
        let back = Recording::decode(&recording.encode()).unwrap();
        prop_assert_eq!(&back, &recording);
        prop_assert_eq!(back.replay(FLOOR.clone(), None).unwrap().hash(), world.save().hash());
    }
}

fn ability() -> impl Strategy<Value = Ability> {
    prop::sample::select(Ability::all().collect::<Vec<_>>())
}

fn graph() -> impl Strategy<Value = NavGraph> {
    let evidence = (1..5u32, 0..3u32, 0..500u32, ability()).prop_map(|(successes, failures, decisions, ability)| {
        let mut evidence = Evidence::default();
        (0..successes).for_each(|_| evidence.note(TryEnd::Arrived, decisions, ability));
        let failure = |idx: u32| if idx.is_multiple_of(3) { TryEnd::Died } else { TryEnd::Failed };
        (0..failures).for_each(|idx| evidence.note(failure(idx), decisions, ability));
        evidence.widen_bounds(Vec3::ONE);
        evidence
    });
    // Sums that use all digits of a number.
    let evidence =
        prop_oneof![3 => evidence, 1 => (0.0..1.0e9).prop_map(|decisions| Evidence::forced(Decisions(decisions)))];
    let edges = prop::collection::vec((0..12u32, 0..12u32, evidence), 0..30);
    (prop::collection::vec(on_a_map(), 12), edges).prop_map(|(vertices, edges)| {
        let edges = edges.into_iter().filter(|(from, to, _)| from != to);
        let edges = edges.map(|(from, to, evidence)| Edge { key: EdgeKey::new(from, to), evidence }).collect();
        NavGraph::check(GraphData { vertices, edges, ..GraphData::default() }).unwrap()
    })
}

fn layer() -> impl Strategy<Value = Layer> {
    let ends = || (anywhere(), anywhere());
    let edit = prop_oneof![
        ends().prop_map(|(from, to)| Edit::ForbidEdge { from, to }),
        (ends(), prop::option::of(0.0..3600.0f32)).prop_map(|((from, to), seconds)| Edit::ForceEdge {
            from,
            to,
            seconds
        }),
        (ends(), 0.1..1000.0f32).prop_map(|((from, to), factor)| Edit::PriceEdge { from, to, factor }),
        anywhere().prop_map(|at| Edit::AddVertex { at }),
        ends().prop_map(|(from, to)| Edit::MoveVertex { from, to }),
        anywhere().prop_map(|at| Edit::RemoveVertex { at }),
    ];
    ("[a-z ä]{1,9}", prop::collection::vec(edit, 0..9)).prop_map(|(name, edits)| Layer { name, edits })
}

fn settings() -> impl Strategy<Value = BuildSettings> {
    let placement = prop::sample::select(Placement::ALL.to_vec());
    let probing = prop::sample::select(vec![Probing::Frugal, Probing::Exhaustive]);
    let numbers = (2..2000usize, 1..65usize, 1..33u32, 0.01..1.0f32, any::<u64>());
    (placement, probing, numbers, any::<(bool, bool)>()).prop_map(
        |(placement, probing, (vertices, neighbours, repeats, threshold, seed), (special_moves, touches))| {
            let raw = RawBuildSettings {
                placement,
                vertices,
                neighbours,
                repeats,
                threshold: f64::from(threshold),
                seed,
                probing,
                special_moves,
                arrival: if touches { Arrival::Touch } else { Arrival::Stand },
            };
            BuildSettings::try_from(raw).unwrap()
        },
    )
}

fn needs() -> impl Strategy<Value = Option<Needs>> {
    let need =
        (0..1024u16, 1..=u16::MAX).prop_map(|(mover, stops)| Need { mover: MoverId(mover), stops: StopSet(stops) });
    let ride = (0..1024u16, 0..16u8, 0..16u8).prop_map(|(mover, from, to)| Ride {
        mover: MoverId(mover),
        from: StopIdx(from),
        to: StopIdx(to),
    });
    (prop::collection::vec(need, 0..3), prop::option::of(ride)).prop_map(|(list, ride)| {
        let mut needs = Needs::default();
        list.into_iter().for_each(|need| needs.add(need));
        needs.ride = ride;
        Some(needs).filter(|needs| !needs.is_empty())
    })
}

fn plan() -> impl Strategy<Value = Plan> {
    let stop = |end| prop_oneof![Just(end), any::<u32>().prop_map(|id| Stop::Vertex(VertexId(id)))];
    let leg = (stop(Stop::Start), stop(Stop::Goal), 0.0..1.0e6f32, 0.0..1.0f32, ability()).prop_map(
        |(from, to, seconds, chance, ability)| Leg {
            key: LegKey { from, to },
            seconds: Seconds(seconds),
            chance: Chance::new(f64::from(chance)),
            death_chance: 0.5 * (1.0 - chance),
            ability,
        },
    );
    let reasons =
        vec![NoPath::StartOffGraph, NoPath::GoalOffGraph, NoPath::DifferentIslands, NoPath::OneWay, NoPath::GoalInZone];
    let no_path = prop::option::of(prop::sample::select(reasons));
    let way = prop::collection::vec(((anywhere(), leg), needs()), 1..9);
    (way, no_path, prop::option::of(anywhere())).prop_map(|(way, no_path, nearest)| {
        let (way, needs): (Vec<_>, Vec<_>) = way.into_iter().unzip();
        let (waypoints, legs) = way.into_iter().unzip();
        let needs = needs.into_iter().enumerate().filter_map(|(leg, needs)| Some((leg, needs?))).collect();
        Plan { waypoints, legs, no_path, needs, nearest }
    })
}

fn spec() -> impl Strategy<Value = MapSpec> {
    let density = || 0.0..=4.0f32;
    let sizes = (50..=1000u32, 40..=200u32, 50..=1000u32);
    let [d0, d1, d2, d3, d4, d5, d6, d7] = std::array::from_fn(|_| (density(), density()));
    let kinds = prop::sample::select(MapKind::all().collect::<Vec<_>>());
    let movers = (d5, d6, d7).prop_map(|((doors, lifts), (platforms, floors), (conveyors, crates))| MoverDensities {
        doors,
        lifts,
        platforms,
        floors,
        conveyors,
        crates,
    });
    let more = (movers, any::<bool>());
    (any::<u64>(), sizes, kinds, (d0, d1, d2, d3, d4), more).prop_map(
        |(seed, (width, height, depth), kind, densities, (movers, repair))| {
            let ((plateaus, buildings), (water, lava), (pads, zip_lines), (ravines, caves), (teleporters, jetpacks)) =
                densities;
            let features =
                Features { plateaus, buildings, water, lava, pads, zip_lines, ravines, caves, teleporters, jetpacks };
            let size = MapSize { width, height, depth };
            MapSpec::try_from(RawMapSpec { seed, size, features, kind, movers, repair }).unwrap()
        },
    )
}

proptest! {
    #![proptest_config(config(5000))]

    #[test]
    fn graphs_keep_their_bits(graph in graph(), probes in any::<u64>()) {
        let built = Built { graph, stats: BuildStats { probes, ..BuildStats::default() } };
        let back = cache::decode_entry(&cache::encode_entry(&built)).unwrap();
        prop_assert_eq!(back.graph.to_data(), built.graph.to_data());
        prop_assert_eq!(back.stats, built.stats);
        let text = export(&built.graph, Format::Json);
        prop_assert_eq!(import_json(&text).unwrap().to_data(), built.graph.to_data());
    }

    #[test]
    fn live_evidence_comes_back(
        graph in graph(),
        traversals in prop::collection::vec((0..12u32, 0..12u32, 0..3, any::<u32>()), 0..200),
    ) {
        let mut live = LiveEvidence::default();
        for (from, to, end, decisions) in traversals {
            let end = [TryEnd::Arrived, TryEnd::Failed, TryEnd::Died][end as usize];
            let reporter = Reporter { name: (from % 3).to_string(), is_trusted: end == TryEnd::Arrived };
            live.note(&graph, &reporter, &Traversal { edge: EdgeKey::new(from, to), end, decisions });
        }
        prop_assert_eq!(&cache::decode_live(&cache::encode_live(&live)).unwrap(), &live);
        prop_assert_eq!(live.apply_to(&graph).edge_count(), graph.edge_count());
    }

    #[test]
    fn layers_come_back_from_the_cache_and_from_the_wire(layer in layer()) {
        prop_assert_eq!(layer.validate(), Ok(()));
        prop_assert_eq!(&cache::decode_layer(&cache::encode_layer(&layer)).unwrap(), &layer);
        let on_wire = layer_to_wire(&layer);
        prop_assert_eq!(layer_from_wire(Some(&on_wire)).unwrap(), layer);
    }

    #[test]
    fn settings_plans_and_specs_come_back_from_the_wire(settings in settings(), plan in plan(), spec in spec()) {
        let on_wire = settings_to_wire(&settings);
        prop_assert_eq!(settings_from_wire(Some(&on_wire), &PlannerConfig::default()).unwrap(), settings);
        prop_assert_eq!(plans::plan(&plan_to_wire(&plan)).unwrap(), plan);
        prop_assert_eq!(convert::map_spec(Some(&convert::map_spec_to_wire(&spec))).unwrap(), spec);
    }

    #[test]
    fn a_leg_without_a_valid_duration_is_refused(
        plan in plan(),
        seconds in prop::sample::select(vec![f32::NAN, f32::INFINITY, -1.0]),
    ) {
        let mut on_wire = plan_to_wire(&plan);
        on_wire.legs[0].seconds = seconds;
        let error = plans::plan(&on_wire).unwrap_err();
        prop_assert!(matches!(error, FieldError::Range { field: "plan.legs.seconds", .. }), "{error}");
    }

    #[test]
    fn packed_numbers_keep_their_bits(values in prop::collection::vec(any::<u32>(), 0..50)) {
        let packed = convert::pack(values.iter().copied().map(f32::from_bits));
        let unpacked = convert::unpack(&packed, values.len(), "values");
        prop_assert_eq!(unpacked.unwrap().into_iter().map(f32::to_bits).collect::<Vec<_>>(), values);
    }
}
