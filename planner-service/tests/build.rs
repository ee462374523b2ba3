//! Builds on a small real map with the shipped policy.

use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use surefoot_planner::build::{BuildError, GraphId, Progress, build};
use surefoot_planner::probe::ProbeContext;
use surefoot_planner::{BuildSettings, Placement, vertices};
use surefoot_policy::Policy;
use surefoot_world::{CharacterProfile, Map, MapSpec};

fn context() -> ProbeContext {
    ProbeContext {
        map: Arc::new(Map::generate(&MapSpec::with_side(31, 80)).unwrap()),
        profile: CharacterProfile::default(),
        policy: Policy::shipped().unwrap(),
    }
}

const SETTINGS: BuildSettings =
    BuildSettings { placement: Placement::Spaced, vertices: 30, neighbours: 6, repeats: 2, threshold: 0.5, seed: 4 };

#[test]
fn a_build_proves_edges_and_does_not_depend_on_the_number_of_threads() {
    let context = context();
    let progress = Progress::default();
    let one = build(&context, &SETTINGS, 1, &progress).unwrap();
    let three = build(&context, &SETTINGS, 3, &Progress::default()).unwrap();
    assert_eq!(one.graph.to_data(), three.graph.to_data());
    assert_eq!(one.probes, 30 * 6 * 2);
    assert_eq!(progress.done.load(Ordering::Relaxed), one.probes);
    assert!(one.graph.edge_count() > 90, "only {} of 180 candidates were proved", one.graph.edge_count());
    for edge in one.graph.edges() {
        assert!(
            edge.evidence.tries == 2 && edge.evidence.success_rate() >= 0.5 && edge.evidence.decisions_mean() > 0.0
        );
    }
}

#[test]
fn spaced_vertices_keep_their_distance_where_random_ones_do_not() {
    let context = context();
    let nearest = |points: &[surefoot_world::Vec3]| {
        let mut best = f32::INFINITY;
        for (idx, point) in points.iter().enumerate() {
            for other in &points[idx + 1..] {
                best = best.min(point.distance(*other));
            }
        }
        best
    };
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let spaced = vertices::spaced(&context.map, &context.profile, 40, &mut rng).unwrap();
    let random = vertices::random(&context.map, &context.profile, 40, &mut rng).unwrap();
    assert_eq!((spaced.len(), random.len()), (40, 40));
    assert!(nearest(&spaced) > 5.0, "{}", nearest(&spaced));
    assert!(nearest(&random) < nearest(&spaced));
}

#[test]
fn cancelling_ends_a_build() {
    let progress = Progress::default();
    progress.cancel.store(true, Ordering::Relaxed);
    assert_eq!(build(&context(), &SETTINGS, 2, &progress).unwrap_err(), BuildError::Cancelled);
}

#[test]
fn the_id_of_a_graph_changes_with_everything_that_decides_it() {
    let context = context();
    let id = GraphId::of(&context, &SETTINGS);
    assert_eq!(id, GraphId::of(&context.clone(), &SETTINGS));
    assert_eq!(GraphId::parse(&id.to_string()), Some(id));
    let others = [
        GraphId::of(&context, &BuildSettings { vertices: 31, ..SETTINGS }),
        GraphId::of(&context, &BuildSettings { threshold: 0.6, ..SETTINGS }),
        GraphId::of(
            &ProbeContext {
                profile: CharacterProfile { height: 1.7, ..CharacterProfile::default() },
                ..context.clone()
            },
            &SETTINGS,
        ),
        GraphId::of(
            &ProbeContext { map: Arc::new(Map::generate(&MapSpec::with_side(32, 80)).unwrap()), ..context.clone() },
            &SETTINGS,
        ),
    ];
    assert!(others.iter().all(|other| *other != id));
}

#[test]
fn settings_out_of_range_are_refused_by_name() {
    let field = |settings: BuildSettings| match settings.validate() {
        Err(BuildError::Setting { field, .. }) => field,
        other => panic!("{other:?}"),
    };
    assert_eq!(field(BuildSettings { vertices: 1, ..SETTINGS }), "vertices");
    assert_eq!(field(BuildSettings { neighbours: 65, ..SETTINGS }), "neighbours");
    assert_eq!(field(BuildSettings { repeats: 0, ..SETTINGS }), "repeats");
    assert_eq!(field(BuildSettings { threshold: f64::NAN, ..SETTINGS }), "threshold");
}
