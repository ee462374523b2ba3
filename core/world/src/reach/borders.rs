//! The causes of the borders between islands: what keeps a walking character from going on.

use super::Reach;
use super::ground::NEIGHBOURS;
use crate::float::hypot;
use crate::map::{Liquid, Map};
use crate::{Vec3, navigable};
use serde::Serialize;
use strum::VariantArray;

/// Why a character cannot walk from a place to a neighbouring one.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, strum::VariantArray, strum::IntoStaticStr,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Cause {
    /// The map ends.
    Rim,
    /// Water.
    Water,
    /// Lava.
    Lava,
    /// A pad, a zip line's station, a teleporter or a jetpack.
    Device,
    /// A wall, or the edge of a floor or roof.
    Building,
    /// The edge of a plateau.
    Plateau,
    /// The wall of a ravine.
    Ravine,
    /// The wall of a cave.
    Cave,
    /// A cliff, a ledge or a slope of the terrain itself.
    Terrain,
}

impl Cause {
    /// Lower-case name as used in reports.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

impl Reach {
    /// Counts cell borders by cause; a cell has one border for each neighbour that it cannot walk to.
    pub fn border_causes(&self, map: &Map) -> Vec<(Cause, u64)> {
        let mut counts: Vec<(Cause, u64)> = Cause::VARIANTS.iter().map(|cause| (*cause, 0)).collect();
        for (idx, cell) in self.ground.cells().iter().enumerate() {
            for (neighbour, (dx, dz)) in NEIGHBOURS.into_iter().enumerate() {
                if !self.ground.walks_to(idx, neighbour) {
                    let ahead = cell.feet + Vec3::new(dx as f32, 0.0, dz as f32) * super::ground::SPACING_M;
                    let cause = cause_of(map, cell.feet, ahead);
                    counts.iter_mut().filter(|(other, _)| *other == cause).for_each(|(_, count)| *count += 1);
                }
            }
        }
        counts
    }
}

fn cause_of(map: &Map, feet: Vec3, ahead: Vec3) -> Cause {
    let extent = map.extent();
    if ahead.x < 1.0 || ahead.z < 1.0 || ahead.x > extent.x - 1.0 || ahead.z > extent.z - 1.0 {
        return Cause::Rim;
    }
    let placed = map.placed();
    // The ground ahead may be a little lower or higher: the liquid above it counts.
    let above = ahead + Vec3::new(0.0, 1.2, 0.0);
    let below =
        map.mesh().cast_ray(above, navigable::DOWN, 3.0).map_or(ahead, |hit| above + navigable::DOWN * hit.distance);
    let liquid = [ahead, below - Vec3::new(0.0, 0.05, 0.0)].into_iter().find_map(|point| map.liquid_at(point, -0.1));
    match liquid {
        Some(Liquid::Water) => return Cause::Water,
        Some(Liquid::Lava) => return Cause::Lava,
        None => {}
    }
    if map.device_at(ahead).is_some() || map.device_at(below).is_some() {
        return Cause::Device;
    }
    let on = |point: Vec3| {
        placed.buildings.iter().any(|building| {
            let roof = building.base.y + building.height + 1.0;
            building.covers(point.x, point.z) && (building.base.y - 4.0..roof).contains(&point.y)
        })
    };
    if on(ahead) || on(feet) {
        return Cause::Building;
    }
    let near = |centre: Vec3, reach: f32| hypot(ahead.x - centre.x, ahead.z - centre.z) < reach;
    if placed.plateaus.iter().any(|plateau| near(plateau.top, plateau.radius + 2.0) && feet.y < plateau.top.y + 1.0) {
        return Cause::Plateau;
    }
    if placed.ravines.iter().any(|ravine| ravine.path.iter().any(|&point| near(point, 0.5 * ravine.width + 4.0))) {
        return Cause::Ravine;
    }
    let in_cave = placed.caves.iter().any(|cave| {
        let axis = cave.to - cave.from;
        let t = ((ahead - cave.from).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
        (cave.from + axis * t).distance(ahead) < cave.radius + 1.5
    });
    if in_cave { Cause::Cave } else { Cause::Terrain }
}
