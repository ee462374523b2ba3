//! Loads links of `surefoot graph export --format landmass` into landmass. Measures the share of pairs of places that
//! landmass connects, without and with the links, and compares it with the exporter's.
//!
//!     landmass-check SEARCH LINKS     the files that `platforms.mjs` writes

use landmass::{
    AnimationLink, Archipelago, ArchipelagoOptions, CoordinateSystem, FromAgentRadius, Island, NavigationMesh,
    PermittedAnimationLinks, PointSampleDistance3d, Transform, Vec3,
};
use serde::Deserialize;
use std::collections::HashMap;
use std::sync::Arc;

/// The axes of the export: y up, as in Bevy.
struct YUp;

impl CoordinateSystem for YUp {
    type Coordinate = [f32; 3];
    type SampleDistance = PointSampleDistance3d;

    const FLIP_POLYGONS: bool = false;

    fn to_landmass(&[x, y, z]: &[f32; 3]) -> Vec3 {
        Vec3::new(x, -z, y)
    }

    fn from_landmass(at: &Vec3) -> [f32; 3] {
        [at.x, at.z, -at.y]
    }
}

#[derive(Deserialize)]
struct Search {
    /// Low and high corners of boxes, m.
    platforms: Vec<[f32; 6]>,
    places: Vec<[f32; 3]>,
    connected: Connected,
}

#[derive(Deserialize)]
struct Connected {
    without: f64,
    with: f64,
}

#[derive(Deserialize)]
struct Links {
    links: Vec<Link>,
}

#[derive(Deserialize)]
struct Link {
    start_edge: [[f32; 3]; 2],
    end_edge: [[f32; 3]; 2],
    kind: usize,
    cost: f32,
    bidirectional: bool,
}

fn read<T: for<'a> Deserialize<'a>>(path: &str) -> T {
    let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("cannot read {path}: {error}"));
    serde_json::from_slice(&bytes).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// An archipelago with an island for each platform, as far from its ledges as the agents' radius.
fn archipelago(platforms: &[[f32; 6]], links: Vec<Link>) -> Archipelago<YUp> {
    const RADIUS: f32 = 0.3;
    let mut archipelago = Archipelago::new(ArchipelagoOptions::from_agent_radius(RADIUS));
    for &[low_x, _, low_z, high_x, y, high_z] in platforms {
        let ([x0, z0], [x1, z1]) = ([low_x + RADIUS, low_z + RADIUS], [high_x - RADIUS, high_z - RADIUS]);
        let mesh = NavigationMesh::<YUp> {
            vertices: vec![[x0, y, z1], [x1, y, z1], [x1, y, z0], [x0, y, z0]],
            polygons: vec![vec![0, 1, 2, 3]],
            polygon_type_indices: vec![0],
            height_mesh: None,
        };
        let mesh = Arc::new(mesh.validate().expect("a rectangle"));
        archipelago.add_island(Island::new(Transform { translation: [0.0; 3], rotation: 0.0 }, mesh));
    }
    for Link { start_edge: [a, b], end_edge: [c, d], kind, cost, bidirectional } in links {
        archipelago.add_animation_link(AnimationLink {
            start_edge: (a, b),
            end_edge: (c, d),
            kind,
            cost,
            bidirectional,
        });
    }
    archipelago.update(0.1);
    archipelago
}

/// The share of ordered pairs of different places between which a path leads.
fn connected(archipelago: &Archipelago<YUp>, places: &[[f32; 3]]) -> f64 {
    let distance = PointSampleDistance3d {
        horizontal_distance: 1.0,
        distance_above: 1.0,
        distance_below: 1.0,
        vertical_preference_ratio: 1.0,
        animation_link_max_vertical_distance: 1.0,
    };
    let sample = |place: &[f32; 3]| archipelago.sample_point(*place, &distance).expect("a place on a platform");
    let sampled: Vec<_> = places.iter().map(sample).collect();
    let leads = |from: usize, to: usize| {
        let all = PermittedAnimationLinks::All;
        archipelago.find_path(&sampled[from], &sampled[to], &HashMap::new(), all).is_ok()
    };
    let pairs = (0..places.len()).flat_map(|from| (0..places.len()).map(move |to| (from, to)));
    let pairs = pairs.filter(|(from, to)| from != to);
    let count = pairs.filter(|&(from, to)| leads(from, to)).count();
    count as f64 / (places.len() * (places.len() - 1)) as f64
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [search, links] = arguments.as_slice() else { panic!("usage: landmass-check SEARCH LINKS") };
    let search: Search = read(search);
    let links: Links = read(links);
    let count = links.links.len();
    let shares =
        [Vec::new(), links.links].map(|links| connected(&archipelago(&search.platforms, links), &search.places));
    let [without, with] = shares.map(|share| 100.0 * share);
    println!("landmass: {without:.2} % and {with:.2} % of pairs connected without and with {count} links");
    let expected = [search.connected.without, search.connected.with];
    assert_eq!(shares, expected, "what landmass connects is what the exporter says");
}
