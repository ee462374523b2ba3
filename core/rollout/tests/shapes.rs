//! Shapes of edges, measured on platforms over a void.

use std::sync::Arc;
use surefoot_levels::ImportOptions;
use surefoot_planner::assets::{AssetFormat, LinkSet, Shape, ShapedEdge};
use surefoot_planner::links::NavMesh;
use surefoot_planner::{BuildSettings, Edge, NavGraph, Progress};
use surefoot_policy::Policy;
use surefoot_rollout::graphs::build;
use surefoot_rollout::{ProbeContext, shape};
use surefoot_world::reach::Reach;
use surefoot_world::{Ability, CharacterProfile, Vec3};

/// Low and high corners: a platform, one beyond a gap of 3 m, and one 3 m higher.
const PLATFORMS: [[f32; 6]; 3] =
    [[4.0, 20.0, 4.0, 16.0, 21.0, 16.0], [19.0, 20.0, 4.0, 31.0, 21.0, 16.0], [19.0, 20.0, 18.0, 31.0, 24.0, 30.0]];

fn platforms() -> ProbeContext {
    let mut text = String::new();
    for (idx, [x0, y0, z0, x1, y1, z1]) in PLATFORMS.into_iter().enumerate() {
        for corner in 0..8 {
            let pick = |bit: usize, low: f32, high: f32| if corner >> bit & 1 == 1 { high } else { low };
            text += &format!("v {} {} {}\n", pick(0, x0, x1), pick(1, y0, y1), pick(2, z0, z1));
        }
        for face in [[1, 5, 7, 3], [2, 4, 8, 6], [1, 2, 6, 5], [3, 7, 8, 4], [1, 3, 4, 2], [5, 6, 8, 7]] {
            let corners = face.map(|corner: usize| (corner + 8 * idx).to_string());
            text += &format!("f {}\n", corners.join(" "));
        }
    }
    let map = surefoot_levels::import_obj(text.as_bytes(), None, &ImportOptions::default()).expect("a valid level").map;
    ProbeContext { map: Arc::new(map), profile: CharacterProfile::default(), policy: Policy::shipped().unwrap() }
}

fn graph(context: &ProbeContext) -> NavGraph {
    let settings = BuildSettings::default()
        .with(|it| {
            it.vertices = 30;
            it.neighbours = 10;
        })
        .unwrap();
    build(context, &settings, 2, &Progress::default()).unwrap().graph
}

/// The edges between platforms with their shapes.
fn measured<'g>(
    context: &ProbeContext,
    graph: &'g NavGraph,
    reach: &Reach,
    threads: usize,
) -> Vec<(&'g Edge, Option<Shape>)> {
    let island = |vertex| reach.ground.at(graph.position(vertex)).map(|cell| cell.island);
    let edges: Vec<&Edge> = graph.edges().filter(|edge| island(edge.key.from) != island(edge.key.to)).collect();
    let shapes = shape::measure(context, (graph, &reach.ground), &edges, threads, &|| {});
    edges.into_iter().zip(shapes).collect()
}

/// Where the level begins on the map: importing moves it there.
fn origin(context: &ProbeContext) -> Vec3 {
    let corners = context.map.mesh().triangles().iter().flat_map(|triangle| triangle.corners());
    corners.reduce(Vec3::min).expect("a level has triangles")
}

/// Index of the platform on which a body stands at a place of the level.
fn platform_at(at: Vec3) -> Option<usize> {
    // Bodies stand with less than half of their width beyond a ledge.
    const OVER_M: f32 = 0.35;
    PLATFORMS.iter().position(|&[x0, _, z0, x1, y, z1]| {
        (x0 - OVER_M..x1 + OVER_M).contains(&at.x)
            && (z0 - OVER_M..z1 + OVER_M).contains(&at.z)
            && (at.y - y).abs() < 0.3
    })
}

#[test]
fn leaps_begin_and_end_where_bodies_stand_and_a_plain_controller_repeats_them() {
    let context = platforms();
    let (graph, reach) = (graph(&context), Reach::survey(&context.map, &context.profile, 2));
    let measured = measured(&context, &graph, &reach, 2);
    let found: Vec<&Shape> = measured.iter().filter_map(|(_, shape)| shape.as_ref()).collect();
    assert!(found.len() >= 6 && 4 * found.len() >= 3 * measured.len(), "{} of {}", found.len(), measured.len());
    let from_map =
        PLATFORMS.map(|[x, y, z, ..]| Vec3::new(x, y, z)).into_iter().reduce(Vec3::min).unwrap() - origin(&context);
    let passages = || found.iter().flat_map(|shape| &shape.passages);
    for passage in passages() {
        assert!(!passage.leaps.is_empty(), "{passage:?}");
        for leap in &passage.leaps {
            let (from, to) = (platform_at(leap.take_off + from_map), platform_at(leap.landing + from_map));
            assert!(from.is_some() && to.is_some(), "{leap:?}");
            assert!(leap.apex.y >= leap.take_off.y.max(leap.landing.y) && leap.seconds > 0.1, "{leap:?}");
            assert_eq!(leap.ability == Ability::DOUBLE_JUMP, leap.second_jump.is_some());
        }
    }
    let mean = passages().map(|passage| passage.driven).sum::<f32>() / passages().count() as f32;
    assert!(mean > 0.6, "a plain controller takes {mean}");
}

#[test]
fn shapes_do_not_depend_on_threads_and_links_connect_the_platforms() {
    let context = platforms();
    let (graph, reach) = (graph(&context), Reach::survey(&context.map, &context.profile, 2));
    let measured_by_one = measured(&context, &graph, &reach, 1);
    assert_eq!(measured(&context, &graph, &reach, 2), measured_by_one);
    let shaped: Vec<ShapedEdge<'_>> =
        measured_by_one.into_iter().filter_map(|(edge, shape)| Some(ShapedEdge { edge, shape: shape? })).collect();
    let island_at = |at| reach.ground.at(at).map(|cell| cell.island);
    let islands: Vec<Option<u32>> = graph.vertices().map(|vertex| island_at(graph.position(vertex))).collect();
    let nav_mesh = NavMesh { radius: 0.3, speed: 11.0, islands: &islands };
    let all = LinkSet::of(&graph, &shaped, nav_mesh, None, &island_at);
    let few = LinkSet::of(&graph, &shaped, nav_mesh, Some(3.0), &island_at);
    assert!(few.links.len() < all.links.len(), "{} of {}", few.links.len(), all.links.len());
    assert!(all.connected.without < 0.5 && all.connected.with > all.connected.without);
    assert_eq!(few.connected, all.connected, "the links that are left out are replaced");
    for &format in AssetFormat::ALL {
        assert!(format.write(&few).len() > 100 * few.links.len(), "{}", format.name());
    }
}
