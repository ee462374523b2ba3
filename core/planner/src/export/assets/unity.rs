//! Links for an importer that makes `NavMeshLink` components (Unity, package AI Navigation).

use super::{About, Axes, Kind, LinkSet, VERSION, kind_of, kinds};
use serde::{Deserialize, Serialize};

/// Area of drops; the other abilities follow. Unity's own areas are 0 to 2, and the last one is 31.
const FIRST_AREA: u8 = 3;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct UnityLinks {
    version: u32,
    axes: String,
    /// The level's own origin on the map, if known. Subtract it from positions to get the level's coordinates.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    origin: Option<Vector3>,
    /// Area of each ability.
    areas: Vec<Kind>,
    links: Vec<UnityLink>,
}

/// The fields of `NavMeshLink` under their names, and further ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
struct UnityLink {
    start_point: Vector3,
    end_point: Vector3,
    /// 0: only the line itself was proved.
    width: f32,
    bidirectional: bool,
    /// Cost of a metre of the link against a metre of walking.
    cost_modifier: f32,
    area: u8,
    about: About,
}

/// A vector in the fields that `JsonUtility` reads.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Vector3 {
    x: f32,
    y: f32,
    z: f32,
}

impl From<[f32; 3]> for Vector3 {
    fn from([x, y, z]: [f32; 3]) -> Self {
        Self { x, y, z }
    }
}

impl UnityLinks {
    pub(super) fn of(set: &LinkSet) -> Self {
        let axes = Axes::Unity;
        let links = set.links.iter().map(|link| UnityLink {
            start_point: axes.point(link.passage.start).into(),
            end_point: axes.point(link.passage.end).into(),
            width: 0.0,
            bidirectional: false,
            cost_modifier: link.cost_ratio(set.speed),
            area: FIRST_AREA + kind_of(link.ability),
            about: About::of(link, axes),
        });
        Self {
            version: VERSION,
            axes: axes.words().to_owned(),
            origin: set.origin_on(axes).map(Vector3::from),
            areas: kinds(FIRST_AREA),
            links: links.collect(),
        }
    }
}
