//! Builds on a small real map with the shipped policy.

use super::stage::of_boxes;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use surefoot_planner::candidates;
use surefoot_planner::probe::{Outcome, ProbeWatch, Trial};
use surefoot_planner::{
    BuildError, BuildSettings, GraphId, MoverAt, NavGraph, Needs, Placement, Probing, Progress, Query,
    RawBuildSettings, Ride, Router,
};
use surefoot_policy::Policy;
use surefoot_rollout::graphs::{self, build};
use surefoot_rollout::{Goal, ProbeContext, Rollout};
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{MapSize, Mover, MoverKind, MoverStop, Pad, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{CharacterProfile, End, Map, MapSpec, MoverId, StopIdx, StopSet, TaskConfig, Vec3, navigable};

fn context() -> ProbeContext {
    ProbeContext {
        map: Arc::new(surefoot_generate::generate(&MapSpec::with_side(31, 80).unwrap())),
        profile: CharacterProfile::default(),
        policy: Policy::shipped().unwrap(),
    }
}

/// The paper's settings: every candidate is probed, every time.
fn settings() -> BuildSettings {
    BuildSettings::of_paper(Placement::Spaced)
        .with(|it| {
            it.vertices = 30;
            it.neighbours = 6;
            it.seed = 4;
        })
        .unwrap()
}

#[test]
fn a_build_proves_edges_and_does_not_depend_on_the_number_of_threads() {
    let context = context();
    let progress = Progress::default();
    let one = build(&context, &settings(), 1, &progress).unwrap();
    let three = build(&context, &settings(), 3, &Progress::default()).unwrap();
    assert_eq!(one.graph.to_data(), three.graph.to_data());
    assert_eq!(one.stats.probes, 30 * 6 * 2);
    assert_eq!(progress.done.load(Ordering::Relaxed), one.stats.probes);
    assert!(one.graph.edge_count() > 90, "only {} of 180 candidates were proved", one.graph.edge_count());
    for edge in one.graph.edges() {
        assert!(
            edge.evidence.tries == 2 && edge.evidence.success_rate() >= 0.5 && edge.evidence.decisions_mean().0 > 0.0
        );
    }
}

fn nearest_pair(graph: &NavGraph) -> f32 {
    let mut best = f32::INFINITY;
    for a in graph.vertices() {
        for b in graph.vertices().skip(a.idx() + 1) {
            best = best.min(graph.position(a).distance(graph.position(b)));
        }
    }
    best
}

#[test]
fn every_builder_joins_most_of_a_small_map() {
    let context = context();
    let points = navigable::sample_many(&context.map, &context.profile, 60, &mut ChaCha8Rng::seed_from_u64(2)).unwrap();
    let mut nearest = Vec::new();
    for &placement in Placement::ALL {
        let settings = settings()
            .with(|it| {
                it.placement = placement;
                it.vertices = 40;
            })
            .unwrap();
        let built = build(&context, &settings, 2, &Progress::default()).unwrap();
        let graph = &built.graph;
        let name = placement.name();
        assert_eq!(name.parse::<Placement>(), Ok(placement));
        assert_eq!(graph.vertex_count(), 40, "{name}");
        assert!(graph.connected_share() > 0.5, "{name}: {:.2} connected", graph.connected_share());
        assert!(built.stats.probes > 0, "{name}");
        // Each edge keeps the bounds of its probes.
        let spread = graph.edges().filter(|edge| edge.evidence.bounds.is_some()).count();
        assert_eq!(spread, graph.edge_count(), "{name}");
        let router = Router::new(graph.clone(), 4096, 1);
        let found = points
            .chunks_exact(2)
            .filter(|pair| {
                let query = Query::new(pair[0], pair[1]);
                router.find_path(&query).no_path.is_none()
            })
            .count();
        assert!(found >= 20, "{name}: plans for {found} of 30 goals");
        nearest.push(nearest_pair(graph));
    }
    // Random placement, then spaced placement.
    assert!(nearest[1] > 4.0 && nearest[0] < nearest[1], "{nearest:?}");
}

#[test]
fn builders_that_run_the_policy_do_not_depend_on_the_number_of_threads_either() {
    let context = context();
    for placement in [Placement::Trajectories, Placement::FloodGrandchildren] {
        let settings = settings().with(|it| it.placement = placement).unwrap();
        let one = build(&context, &settings, 1, &Progress::default()).unwrap();
        let two = build(&context, &settings, 2, &Progress::default()).unwrap();
        assert_eq!(one.graph.to_data(), two.graph.to_data(), "{}", placement.name());
    }
}

#[test]
fn frugal_probing_saves_probes_and_loses_no_connection() {
    let context = context();
    let settings = settings()
        .with(|it| {
            it.vertices = 80;
            it.neighbours = 16;
        })
        .unwrap();
    let all = build(&context, &settings, 2, &Progress::default()).unwrap();
    let frugal = settings.with(|it| it.probing = Probing::Frugal).unwrap();
    let few = build(&context, &frugal, 2, &Progress::default()).unwrap();
    assert!(few.stats.probes * 10 < all.stats.probes * 7, "{} of {} probes", few.stats.probes, all.stats.probes);
    assert!(few.stats.untried > 0);
    let (less, more) = (few.graph.connected_share(), all.graph.connected_share());
    assert!(less > more - 0.03, "{less:.3} instead of {more:.3} of pairs connected");
}

/// A pad at the foot of a cliff, too high for two jumps, with ground on both sides.
fn cliff() -> Map {
    let corner = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    let mut triangles = Vec::new();
    let mut quad = |a: Vec3, b: Vec3, c: Vec3, d: Vec3| {
        for corners in [[a, b, c], [a, c, d]] {
            triangles.push(Triangle::new(corners, Surface::Ground).unwrap());
        }
    };
    quad(corner(0.0, 5.0, 0.0), corner(0.0, 5.0, 60.0), corner(30.0, 5.0, 60.0), corner(30.0, 5.0, 0.0));
    quad(corner(30.0, 13.0, 0.0), corner(30.0, 13.0, 60.0), corner(60.0, 13.0, 60.0), corner(60.0, 13.0, 0.0));
    quad(corner(30.0, 5.0, 0.0), corner(30.0, 5.0, 60.0), corner(30.0, 13.0, 60.0), corner(30.0, 13.0, 0.0));
    let size = MapSize { width: 60, height: 40, depth: 60 };
    let speed = (2.0f32 * 20.0 * 18.0).sqrt();
    let pads = vec![Pad { centre: Vec3::new(22.0, 5.0, 30.0), speed }];
    Map::from_parts(size, triangles, Placed { pads, ..Placed::default() })
}

#[test]
fn a_pad_is_joined_to_its_landing_without_luck() {
    let context = ProbeContext { map: Arc::new(cliff()), ..context() };
    // Each vertex has two neighbours; the nearest are on the same level.
    let settings = settings()
        .with(|it| {
            it.vertices = 40;
            it.neighbours = 2;
            it.special_moves = true;
            it.seed = 2;
        })
        .unwrap();
    let up = |graph: &NavGraph| {
        graph.edges().filter(|edge| graph.position(edge.key.to).y - graph.position(edge.key.from).y > 6.0).count()
    };
    let with = build(&context, &settings, 2, &Progress::default()).unwrap();
    assert!(with.stats.special > 0);
    let vertices = with.graph.to_data().vertices;
    let special = candidates::by_features(&context.map, &context.profile, &vertices, &[]);
    let pad = Vec3::new(22.0, 5.0, 30.0);
    let thrown =
        special.iter().filter(|key| vertices[key.from.idx()].distance(pad) < 14.0 && vertices[key.to.idx()].y > 12.0);
    assert!(thrown.count() >= 3, "{special:?}");
    assert!(up(&with.graph) > 0, "no edge leads up");
    let without =
        build(&context, &settings.with(|it| it.special_moves = false).unwrap(), 2, &Progress::default()).unwrap();
    assert!(up(&without.graph) < up(&with.graph));
}

#[test]
fn cancelling_ends_a_build() {
    let progress = Progress::default();
    progress.cancel.store(true, Ordering::Relaxed);
    assert_eq!(build(&context(), &settings(), 2, &progress).unwrap_err(), BuildError::Cancelled);
}

/// Sees nothing, and has cancelled.
struct Cancelled;

impl ProbeWatch for Cancelled {
    fn finished(&self, _: usize, outcome: &Outcome) {
        panic!("{outcome:?} comes too late");
    }

    fn is_cancelled(&self) -> bool {
        true
    }
}

#[test]
fn cancelling_ends_a_ride_that_takes_ten_minutes() {
    let low = Vec3::new(20.0, 5.0, 30.0);
    let stops = [0.0, 8.0].map(|rise| MoverStop { offset: Vec3::Y * rise, yaw: 0.0, is_there: true });
    let lift = Mover {
        name: "lift".to_owned(),
        kind: MoverKind::Lift,
        triangles: cuboid(low, low + Vec3::new(2.0, 0.3, 2.0)),
        pivot: low,
        stops: stops.to_vec(),
        start: StopIdx(0),
        travel_s: 600.0,
        dwell_s: 1.0,
        cycles: false,
        belt: Vec3::ZERO,
    };
    let context = ProbeContext { map: Arc::new(cliff().with_movers(vec![lift]).unwrap()), ..context() };
    let start = low + Vec3::new(1.0, 0.3, 1.0);
    let ride = Ride { mover: MoverId(0), from: StopIdx(0), to: StopIdx(1) };
    let held = Some(MoverAt { mover: MoverId(0), stop: StopIdx(0) });
    let trial = Trial { held, ride: Some(ride), ..Trial::walk(start, start + Vec3::Y * 8.0, 0) };
    assert_eq!(context.run_chunk(&[trial], 0, &Cancelled), None);
    let arrived = &context.run_chunk(&[trial], 0, &Progress::default()).unwrap()[0];
    assert!(arrived.reached && arrived.decisions >= 600 * 6 && arrived.needs == Needs::of_ride(ride), "{arrived:?}");
}

#[test]
fn an_npc_that_could_walk_below_a_lift_still_boards_it_only_while_it_is_there() {
    let boxes = [
        [Vec3::new(2.0, 1.0, 2.0), Vec3::new(30.0, 2.0, 22.0)],
        [Vec3::new(16.0, 2.0, 2.0), Vec3::new(30.0, 8.0, 22.0)],
    ];
    let map = of_boxes(MapSize { width: 32, height: 30, depth: 24 }, boxes);
    let stops = [0.0, 5.95].map(|rise| MoverStop { offset: Vec3::Y * rise, yaw: 0.0, is_there: true });
    // The top of the lift is 5 cm above the floor, less than the body's steps.
    let low = Vec3::new(12.9, 1.9, 10.0);
    let lift = Mover {
        name: "lift".to_owned(),
        kind: MoverKind::Lift,
        triangles: cuboid(low, Vec3::new(15.95, 2.05, 14.0)),
        pivot: low,
        stops: stops.to_vec(),
        start: StopIdx(0),
        travel_s: 2.0,
        dwell_s: 4.0,
        cycles: false,
        belt: Vec3::ZERO,
    };
    let map = Arc::new(Arc::into_inner(map).unwrap().with_movers(vec![lift]).unwrap());
    let context = ProbeContext::new(map.clone(), Policy::shipped().unwrap());
    let middle = Vec3::new(14.425, 2.05, 12.0);
    let held = Some(MoverAt { mover: MoverId(0), stop: StopIdx(0) });
    let trial = Trial { held, ..Trial::walk(Vec3::new(8.0, 2.0, 12.0), middle, 0) };
    let boarding = &context.run_chunk(&[trial], 0, &Progress::default()).unwrap()[0];
    let needs: Vec<(MoverId, StopSet)> = boarding.needs.iter().map(|need| (need.mover, need.stops)).collect();
    assert!(boarding.reached);
    assert_eq!(needs, [(MoverId(0), StopSet::only(StopIdx(0)))]);

    // NPCs from the floor to the deck and back, with one lift.
    let graph = build(&context, &BuildSettings::default(), 2, &Progress::default()).unwrap().graph;
    let router = Router::new(graph, 1000, 2);
    let (floor, deck) = (|idx| Vec3::new(5.0, 2.0, 4.0 + idx), |idx| Vec3::new(24.0, 8.0, 4.0 + idx));
    let way = |idx: u8| {
        let (start, goal) = (floor(f32::from(idx)), deck(f32::from(idx)));
        if idx.is_multiple_of(2) { Goal { start, yaw: 0.0, goal } } else { Goal { start: goal, yaw: 0.0, goal: start } }
    };
    let goals: Vec<Goal> = (0..16).map(way).collect();
    let rollout = Rollout::new(map, CharacterProfile::default(), TaskConfig::default());
    let attempts = rollout.live(&context.policy, &router, &goals, |_, _| {});
    let ends: Vec<End> = attempts.iter().map(|attempt| attempt.end).collect();
    assert_eq!(ends, [End::Reached; 16]);
}

#[test]
fn the_id_of_a_graph_changes_with_everything_that_decides_it() {
    let context = context();
    let id = graphs::id_of(&context, &settings());
    assert_eq!(id, graphs::id_of(&context.clone(), &settings()));
    assert_eq!(GraphId::parse(&id.to_string()), Some(id));
    let others = [
        graphs::id_of(&context, &settings().with(|it| it.vertices = 31).unwrap()),
        graphs::id_of(&context, &settings().with(|it| it.threshold = 0.6).unwrap()),
        graphs::id_of(
            &ProbeContext {
                profile: CharacterProfile::default().with(|it| it.height = 1.7).unwrap(),
                ..context.clone()
            },
            &settings(),
        ),
        graphs::id_of(
            &ProbeContext {
                map: Arc::new(surefoot_generate::generate(&MapSpec::with_side(32, 80).unwrap())),
                ..context.clone()
            },
            &settings(),
        ),
    ];
    assert!(others.iter().all(|other| *other != id));
}

#[test]
fn settings_out_of_range_are_refused_by_name() {
    let field = |change: fn(&mut RawBuildSettings)| BuildSettings::default().with(change).unwrap_err().field;
    assert_eq!(field(|it| it.vertices = 1), "vertices");
    assert_eq!(field(|it| it.neighbours = 65), "neighbours");
    assert_eq!(field(|it| it.repeats = 0), "repeats");
    assert_eq!(field(|it| it.threshold = f64::NAN), "threshold");
}
