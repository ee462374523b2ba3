//! Places on lifts and platforms where NPCs stand, and what edges depend on because of them.

use std::sync::Arc;
use surefoot_planner::export::{Format, export, import_json};
use surefoot_planner::graph::{GraphData, GraphError};
use surefoot_planner::probe::{Outcome, ProbeExecutor, ProbeWatch, Trial};
use surefoot_planner::settings::MAX_VERTICES;
use surefoot_planner::store::{decode_entry, encode_entry};
use surefoot_planner::{
    BuildError, BuildSettings, Builder, Built, MoverAt, NavGraph, Needs, Probing, Progress, Ride, RideStops, Site,
};
use surefoot_world::map::mover::{MAX_MOVERS, MAX_STOPS, cuboid};
use surefoot_world::map::{MapSize, Mover, MoverKind, MoverStop, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{Ability, Map, MoverId, StopIdx, Vec3};

/// Side of the floor, m.
const SIDE_M: u32 = 320;
/// Distance between lifts, m.
const APART_M: f32 = 10.0;

/// A floor with this many lifts in rows; floors are 2.5 m apart.
fn site(lift_count: usize, stop_count: usize) -> Site {
    let side = SIDE_M as f32;
    let [a, b, c, d] = [[0.0, 0.0], [0.0, side], [side, side], [side, 0.0]].map(|[x, z]| Vec3::new(x, 1.0, z));
    let triangles = [[a, b, c], [a, c, d]].map(|corners| Triangle::new(corners, Surface::Ground).unwrap()).to_vec();
    let map = Map::from_parts(MapSize { width: SIDE_M, height: 60, depth: SIDE_M }, triangles, Placed::default());
    let per_row = (side / APART_M) as usize;
    let lift = |idx: usize| {
        let low = Vec3::new((idx % per_row) as f32 * APART_M + 4.0, 1.2, (idx / per_row) as f32 * APART_M + 4.0);
        let stop = |stop: usize| MoverStop { offset: Vec3::Y * (2.5 * stop as f32), yaw: 0.0, is_there: true };
        Mover {
            name: format!("lift {idx}"),
            kind: MoverKind::Lift,
            triangles: cuboid(low, low + Vec3::new(2.0, 0.3, 2.0)),
            pivot: low,
            stops: (0..stop_count).map(stop).collect(),
            start: StopIdx(0),
            travel_s: 2.0,
            dwell_s: 1.0,
            cycles: false,
            belt: Vec3::ZERO,
        }
    };
    Site::new(Arc::new(map.with_movers((0..lift_count).map(lift).collect()).unwrap()))
}

/// Every ride arrives, and every other probe that keeps its height.
struct Lifts;

impl ProbeExecutor for Lifts {
    fn run(&self, trials: &[Trial], _: u64, watch: &dyn ProbeWatch) -> Option<Vec<Outcome>> {
        let outcomes: Vec<Outcome> = trials.iter().map(outcome).collect();
        outcomes.iter().enumerate().for_each(|(idx, outcome)| watch.finished(idx, outcome));
        (!watch.is_cancelled()).then_some(outcomes)
    }
}

fn outcome(trial: &Trial) -> Outcome {
    Outcome {
        reached: trial.ride.is_some() || (trial.start.y - trial.goal.y).abs() < 1.0,
        decisions: 5,
        ability: Ability::WALK,
        bounds: [trial.start.min(trial.goal), trial.start.max(trial.goal)],
        needs: trial.ride.map_or_else(Needs::default, Needs::of_ride),
        ..Outcome::begin(trial.start)
    }
}

fn build(site: &Site, vertices: usize) -> Result<Built, BuildError> {
    let settings = BuildSettings::default()
        .with(|it| (it.vertices, it.repeats, it.probing, it.special_moves) = (vertices, 1, Probing::Exhaustive, false))
        .unwrap();
    let progress = Progress::default();
    Builder { site, settings: &settings, executor: &Lifts, thread_count: 2, clock: &|| 0.0, progress: &progress }
        .build()
}

fn at(mover: u16, stop: u8) -> Option<MoverAt> {
    Some(MoverAt { mover: MoverId(mover), stop: StopIdx(stop) })
}

fn rides(graph: &NavGraph) -> Vec<Ride> {
    graph.edges().filter_map(|edge| edge.evidence.needs.ride).collect()
}

/// With a scan of all ride_stops for each of them and each vertex, this build would take hours.
#[test]
fn a_thousand_lifts_of_sixteen_floors_are_built() {
    let (lift_count, vertices) = (1000, 300);
    let site = site(lift_count, MAX_STOPS);
    let Built { graph, .. } = build(&site, vertices).unwrap();
    let mut rides = rides(&graph);
    assert_eq!(rides.len(), lift_count * MAX_STOPS * (MAX_STOPS - 1), "each stop of a lift is joined to all others");
    rides.sort_by_key(|ride| (ride.mover, ride.from, ride.to));
    rides.dedup();
    assert_eq!(rides.len(), lift_count * MAX_STOPS * (MAX_STOPS - 1));
    let ride_stops = RideStops::on(&site.map, &site.profile);
    for edge in graph.edges() {
        let ends = [edge.key.from, edge.key.to].map(|end| ride_stops.at(graph.position(end)));
        let ride = ends[0].zip(ends[1]).and_then(|(from, to)| Ride::between(from, to));
        assert_eq!(edge.evidence.needs.ride, ride);
        assert!(ride.is_some() || ends.contains(&None), "nobody leaps from lift to lift");
    }
}

#[test]
fn a_map_with_more_places_on_lifts_than_a_graph_has_vertices_is_refused() {
    let ride_stops = MAX_MOVERS * MAX_STOPS;
    let refused = build(&site(MAX_MOVERS, MAX_STOPS), 300).unwrap_err();
    assert_eq!(refused, BuildError::TooManyRideStops { vertices: 300, ride_stops });
    assert!(refused.to_string().contains("together they may be at most 16384"), "{refused}");
    assert_eq!(
        build(&site(1, 2), MAX_VERTICES).unwrap_err(),
        BuildError::TooManyRideStops { vertices: MAX_VERTICES, ride_stops: 2 }
    );
}

#[test]
fn each_ride_stop_belongs_to_the_first_vertex_there_and_lookups_agree() {
    let site = site(3, 4);
    let ride_stops = RideStops::on(&site.map, &site.profile);
    let places: Vec<Vec3> = ride_stops.places().collect();
    assert_eq!(places.len(), 12);
    let beside = Vec3::new(0.008, 0.0, -0.005);
    for (idx, place) in places.iter().enumerate() {
        let name = at((idx / 4) as u16, (idx % 4) as u8);
        assert_eq!((ride_stops.at(*place), ride_stops.at(*place + beside)), (name, name));
        assert_eq!(ride_stops.at(*place + Vec3::X * 0.011), None);
    }
    let vertices = [Vec3::ZERO, places[5] + beside, places[5], places[2]];
    assert_eq!(ride_stops.of_vertices(&vertices), [None, at(1, 1), None, at(0, 2)]);
    assert_eq!(ride_stops.at(Vec3::splat(1.0e30)), None);
}

#[test]
fn lifts_that_share_a_floor_have_a_ride_stop_each() {
    // Two shafts in one: the upper lift begins where the lower one ends.
    let site = site(2, 2);
    let mut lifts = site.map.movers().to_vec();
    let low = lifts[0].pivot + Vec3::Y * 2.5;
    lifts[1].triangles = cuboid(low, low + Vec3::new(2.0, 0.3, 2.0));
    lifts[1].pivot = low;
    let plain =
        Map::from_parts(site.map.size(), site.map.mesh().triangles().iter().copied().collect(), Placed::default());
    let site = Site::new(Arc::new(plain.with_movers(lifts).unwrap()));
    let ride_stops = RideStops::on(&site.map, &site.profile);
    let vertices: Vec<Vec3> = ride_stops.places().collect();
    assert_eq!(ride_stops.of_vertices(&vertices), [at(0, 0), at(0, 1), at(1, 0), at(1, 1)]);
    assert_eq!(rides(&build(&site, 40).unwrap().graph).len(), 4, "both lifts go up and down");
}

#[test]
fn a_graph_that_depends_on_what_no_map_has_is_refused() {
    let built = build(&site(1, 2), 20).unwrap();
    let key = built.graph.edges().find(|edge| edge.evidence.needs.ride.is_some()).unwrap().key;
    let entry = |data: &GraphData| {
        let content = postcard::to_stdvec(&(data, built.stats)).unwrap();
        [blake3::hash(&content).as_bytes().as_slice(), &content].concat()
    };
    assert_eq!(entry(&built.graph.to_data()), encode_entry(&built));
    let changes: [(&str, usize); 6] = [
        ("/ride/to", MAX_STOPS),
        ("/ride/to", 0),
        ("/ride/from", MAX_STOPS),
        ("/ride/mover", MAX_MOVERS),
        ("/list/0/mover", MAX_MOVERS),
        ("/list/1/stops", 1),
    ];
    for (path, value) in changes {
        let mut data = serde_json::to_value(built.graph.to_data()).unwrap();
        let mut edges = data["edges"].as_array_mut().unwrap().iter_mut();
        let edge = edges.find(|edge| !edge["evidence"]["needs"]["ride"].is_null()).unwrap();
        *edge["evidence"]["needs"].pointer_mut(path).unwrap() = value.into();
        let data: GraphData = serde_json::from_value(data).unwrap();
        assert!(decode_entry(&entry(&data)).unwrap_err().contains("no map has"), "{path} = {value}");
        assert_eq!(NavGraph::check(data).unwrap_err(), GraphError::BadNeeds(key), "{path} = {value}");
    }
    let text = export(&built.graph, Format::Json);
    let changed = text.replacen("\"to\": 1\n", "\"to\": 16\n", 1);
    assert_ne!(text, changed);
    assert!(import_json(&changed).unwrap_err().to_string().contains("no map has"));
}
