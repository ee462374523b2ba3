//! Links in the fields of `FNavigationLink`, the simple links of a `NavLinkProxy` (Unreal Engine).

use super::{About, Axes, LinkSet, VERSION, name_of};
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct UnrealLinks {
    version: u32,
    axes: String,
    /// The level's own origin on the map, if known. Subtract it from positions to get the level's coordinates.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    origin: Option<Vector>,
    links: Vec<UnrealLink>,
}

/// The fields of `FNavigationLink` under their names, and further ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "PascalCase")]
struct UnrealLink {
    left: Vector,
    right: Vector,
    /// A value of `ENavLinkDirection`.
    direction: String,
    /// Distance from its ends within which a link joins the NavMesh, cm.
    snap_radius: f32,
    /// Ability: the importer maps it to a class of `UNavArea`.
    area: String,
    /// `FixedAreaEnteringCost` for a link of its own area class, cm of walking.
    entering_cost: f32,
    about: About,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Vector {
    x: f32,
    y: f32,
    z: f32,
}

impl From<[f32; 3]> for Vector {
    fn from([x, y, z]: [f32; 3]) -> Self {
        Self { x, y, z }
    }
}

impl UnrealLinks {
    pub(super) fn of(set: &LinkSet) -> Self {
        let axes = Axes::Unreal;
        let centimetres = axes.units_per_metre();
        let links = set.links.iter().map(|link| UnrealLink {
            left: axes.point(link.passage.start).into(),
            right: axes.point(link.passage.end).into(),
            direction: "LeftToRight".to_owned(),
            snap_radius: set.radius * centimetres,
            area: name_of(link.ability).to_owned(),
            entering_cost: link.cost_metres(set.speed) * centimetres,
            about: About::of(link, axes),
        });
        Self {
            version: VERSION,
            axes: axes.words().to_owned(),
            origin: set.origin_on(axes).map(Vector::from),
            links: links.collect(),
        }
    }
}
