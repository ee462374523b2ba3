//! Links in the fields of `AnimationLink` of the crate landmass (0.9), on the axes of Bevy, which are ours.

use super::{About, Axes, Kind, LinkSet, VERSION, kind_of, kinds};
use serde::{Deserialize, Serialize};
use surefoot_world::Vec3;
use surefoot_world::float::hypot;

/// Length of the edges of a link, m: the distance that a NavMesh keeps from ledges.
const EDGE_M: f32 = 0.75;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct LandmassLinks {
    version: u32,
    axes: String,
    /// The level's own origin on the map, if known. Subtract it from positions to get the level's coordinates.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    origin: Option<[f32; 3]>,
    /// Number of each ability, by which agents permit links.
    kinds: Vec<Kind>,
    links: Vec<LandmassLink>,
}

/// The fields of `AnimationLink` under their names, and further ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct LandmassLink {
    start_edge: [[f32; 3]; 2],
    end_edge: [[f32; 3]; 2],
    kind: u8,
    /// Cost as the length of a walk, m.
    cost: f32,
    bidirectional: bool,
    about: About,
}

impl LandmassLinks {
    pub(super) fn of(set: &LinkSet) -> Self {
        let axes = Axes::Ours;
        let links = set.links.iter().map(|link| {
            let [start_edge, end_edge] = edges(link.passage.start, link.passage.end);
            LandmassLink {
                start_edge: start_edge.map(|point| axes.point(point)),
                end_edge: end_edge.map(|point| axes.point(point)),
                kind: kind_of(link.ability),
                cost: link.cost_metres(set.speed),
                bidirectional: false,
                about: About::of(link, axes),
            }
        });
        Self {
            version: VERSION,
            axes: axes.words().to_owned(),
            origin: set.origin_on(axes),
            kinds: kinds(0),
            links: links.collect(),
        }
    }
}

/// The edges where agents enter and leave a link. They extend it beyond its ends, to the ground of a NavMesh that keeps
/// away from ledges.
fn edges(start: Vec3, end: Vec3) -> [[Vec3; 2]; 2] {
    let way = end - start;
    let length = hypot(way.x, way.z);
    let along = if length > 1.0e-3 { Vec3::new(way.x, 0.0, way.z) / length } else { Vec3::X } * EDGE_M;
    [[start, start - along], [end, end + along]]
}
