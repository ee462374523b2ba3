//! Features: what stands on a map besides its bare ground.

use super::spot::Spot;
use crate::Vec3;
use crate::float::{hypot, turned};
use serde::{Deserialize, Serialize};

/// What a pool is filled with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Liquid {
    /// Slows characters down, and drowns them after five seconds.
    Water,
    /// Burns characters at once.
    Lava,
}

/// Outline of a pool seen from above, relative to the pool's centre.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Outline {
    /// A disc.
    Round {
        /// Radius, m.
        radius: f32,
    },
    /// A rectangle along the axes.
    Rectangle {
        /// Half of its extent along x, m.
        half_x: f32,
        /// Half of its extent along z, m.
        half_z: f32,
    },
}

impl Outline {
    /// Whether the point `dx`, `dz` metres from the centre lies inside.
    pub fn contains(self, dx: f32, dz: f32) -> bool {
        match self {
            Outline::Round { radius } => dx * dx + dz * dz < radius * radius,
            Outline::Rectangle { half_x, half_z } => dx.abs() < half_x && dz.abs() < half_z,
        }
    }

    /// Half extents (x, z) of the bounding rectangle, m.
    pub fn half_extents(self) -> (f32, f32) {
        match self {
            Outline::Round { radius } => (radius, radius),
            Outline::Rectangle { half_x, half_z } => (half_x, half_z),
        }
    }
}

/// A body of water or lava with a level surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pool {
    /// Centre of the liquid's surface, m.
    pub centre: Vec3,
    /// Shape seen from above.
    pub outline: Outline,
    /// Deepest point below the surface, m.
    pub depth: f32,
    /// Liquid in the pool.
    pub liquid: Liquid,
}

/// A jump pad: a disc that throws characters upwards.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pad {
    /// Centre of the disc, on the ground, m.
    pub centre: Vec3,
    /// Upward speed that the pad gives, m/s: `sqrt(2 g (height + 10))` as in the released environment.
    pub speed: f32,
}

/// A zip line: a cable that takes characters from its upper end to its lower end.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ZipLine {
    /// Centre of the station's disc at the upper end, on the ground, m.
    pub from: Vec3,
    /// Landing place below the lower end, on the ground, m.
    pub to: Vec3,
}

impl ZipLine {
    /// Path of the feet, m: the station, the start of the cable above it, and the end of the cable above the landing.
    pub fn path(&self) -> [Vec3; 3] {
        let lift = Vec3::new(0.0, ZIP_LIFT_M, 0.0);
        [self.from, self.from + lift, self.to + lift]
    }

    /// Length of the path from the station to the end of the cable, m.
    pub fn length(&self) -> f32 {
        ZIP_LIFT_M + self.from.distance(self.to)
    }

    /// Position of the feet after `distance` metres, m, and the unit direction of travel there.
    pub fn at(&self, distance: f32) -> (Vec3, Vec3) {
        let [start, hung, end] = self.path();
        if distance < ZIP_LIFT_M {
            return (start + Vec3::new(0.0, distance, 0.0), Vec3::Y);
        }
        let direction = (end - hung) / hung.distance(end).max(1.0e-3);
        (hung + direction * (distance - ZIP_LIFT_M), direction)
    }
}

/// A teleporter: a disc that moves characters to another place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Teleporter {
    /// Centre of the entrance disc, on the ground, m.
    pub from: Vec3,
    /// Place that the teleporter leads to, on the ground, m.
    pub to: Vec3,
    /// Whether `to` is an entrance too.
    pub two_way: bool,
}

/// A jetpack pick-up: gives a jetpack to every character that touches it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Jetpack {
    /// Centre of the pick-up, on the ground, m.
    pub centre: Vec3,
    /// Thrust that the jetpack gives, s.
    pub fuel: f32,
}

/// A building: a house with storeys, or a solid block.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Building {
    /// Centre of the ground floor, m.
    pub base: Vec3,
    /// Half extents along the building's own axes, m.
    pub half: [f32; 2],
    /// Rotation about the vertical, rad.
    pub yaw: f32,
    /// Height of the roof above the ground floor, m.
    pub height: f32,
    /// Number of storeys; 0 for a solid block.
    pub storeys: u8,
    /// Whether stairs lead from the topmost storey onto the roof.
    pub roof_stairs: bool,
}

impl Building {
    /// Transforms a point from the building's frame (origin at `base`) to the map's.
    pub fn to_map(&self, local: Vec3) -> Vec3 {
        self.base + turned(local, libm::sincosf(self.yaw))
    }

    /// Whether the vertical line through (`x`, `z`) meets the building.
    pub fn covers(&self, x: f32, z: f32) -> bool {
        let (sin, cos) = libm::sincosf(self.yaw);
        let (dx, dz) = (x - self.base.x, z - self.base.z);
        (dx * cos - dz * sin).abs() < self.half[0] && (dx * sin + dz * cos).abs() < self.half[1]
    }

    /// Radius of the circle around the footprint, m.
    pub fn radius(&self) -> f32 {
        hypot(self.half[0], self.half[1])
    }

    /// Centre of the roof, m.
    pub fn roof(&self) -> Vec3 {
        self.base + Vec3::new(0.0, self.height, 0.0)
    }
}

/// A plateau: a flat-topped column of rock.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Plateau {
    /// Centre of the top, m.
    pub top: Vec3,
    /// Radius of the top, m.
    pub radius: f32,
}

/// A ravine: a winding cut in the ground with steep walls.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ravine {
    /// Points along the bottom, m.
    pub path: Vec<Vec3>,
    /// Width at the bottom, m.
    pub width: f32,
}

/// A cave: a tunnel through rock.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cave {
    /// Middle of one mouth, at floor level, m.
    pub from: Vec3,
    /// Middle of the other mouth, at floor level, m.
    pub to: Vec3,
    /// Radius of the vault, m.
    pub radius: f32,
}

/// All features of a map.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Placed {
    /// Pools of water and lava.
    pub pools: Vec<Pool>,
    /// Jump pads.
    pub pads: Vec<Pad>,
    /// Zip lines.
    pub zip_lines: Vec<ZipLine>,
    /// Teleporters.
    pub teleporters: Vec<Teleporter>,
    /// Jetpack pick-ups.
    pub jetpacks: Vec<Jetpack>,
    /// Buildings; part of the ground's triangles.
    pub buildings: Vec<Building>,
    /// Plateaus; part of the ground's triangles.
    pub plateaus: Vec<Plateau>,
    /// Ravines; cut into the ground's triangles.
    pub ravines: Vec<Ravine>,
    /// Caves; cut into the ground's triangles.
    pub caves: Vec<Cave>,
    /// Places for moves that bodies define. Maps are hashed and saved with them after everything else, since maps
    /// without any keep their hashes.
    #[serde(skip)]
    pub spots: Vec<Spot>,
}

/// Gravity for which pad speeds are computed, m/s2.
pub const PAD_GRAVITY: f32 = 20.0;
/// Extra height of a pad's throw, m (released environment).
pub const PAD_EXTRA_M: f32 = 10.0;
/// Default thrust of a jetpack, s.
pub const JETPACK_FUEL_S: f32 = 2.5;
/// Radius of pads, stations, teleporters and jetpack pick-ups, m.
pub const DISC_RADIUS_M: f32 = 1.25;
/// Greatest height of the feet above or below a disc's centre at which the device is triggered, m.
pub const CATCH_HEIGHT_M: f32 = 0.6;
/// Height to which a zip line lifts the feet above the ground, m.
pub const ZIP_LIFT_M: f32 = 1.5;
