//! A map: static geometry plus the hazards and devices on it.
//!
//! A [`Map`] is immutable once built and shared behind an `Arc` by every world, prober and trainer that
//! uses it. Its identity is the hash of its generated content, never its seed.

pub mod generate;
pub mod spec;
mod terrain;

use crate::Vec3;
use crate::mesh::{Mesh, Surface};
use serde::{Deserialize, Serialize};
pub use spec::{Features, MapSize, MapSpec, SpecError};
use std::fmt;

/// A generated map.
#[derive(Debug)]
pub struct Map {
    spec: MapSpec,
    mesh: Mesh,
    pools: Vec<Pool>,
    pads: Vec<Pad>,
    buildings: Vec<Building>,
    plateaus: Vec<Plateau>,
    hash: MapHash,
}

/// Hash of a map's geometry and features.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct MapHash(pub [u8; 32]);

impl MapHash {
    /// All 64 hexadecimal digits; `Display` shows the first 16.
    pub fn to_hex(self) -> String {
        blake3::Hash::from_bytes(self.0).to_hex().to_string()
    }
}

impl fmt::Display for MapHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for byte in &self.0[..8] {
            write!(f, "{byte:02x}")?;
        }
        Ok(())
    }
}

impl fmt::Debug for MapHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "MapHash({self})")
    }
}

/// What a pool is filled with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Liquid {
    /// Slows down; drowns after five seconds.
    Water,
    /// Burns at once.
    Lava,
}

/// A round pool in a bowl of the terrain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pool {
    /// Centre of the liquid's surface.
    pub centre: Vec3,
    /// Radius of the bowl in metres.
    pub radius: f32,
    /// Deepest point below the surface in metres.
    pub depth: f32,
    /// What it holds.
    pub liquid: Liquid,
}

/// A disc that throws upwards whoever steps on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pad {
    /// Centre of the disc, on the ground.
    pub centre: Vec3,
    /// Upward speed given, m/s: `sqrt(2 g (height + 10))` as in the released environment.
    pub speed: f32,
}

/// Radius of every pad in metres.
pub const PAD_RADIUS_M: f32 = 1.25;
/// How far above its disc a pad still catches a character's feet, in metres.
pub const PAD_CATCH_HEIGHT_M: f32 = 0.6;

/// An upright box with a walkable roof.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Building {
    /// Corner with the smallest coordinates (below the ground).
    pub min: Vec3,
    /// Corner with the largest coordinates; its y is the roof.
    pub max: Vec3,
}

/// A flat-topped column of rock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plateau {
    /// Centre of the top.
    pub top: Vec3,
    /// Radius of the top in metres.
    pub radius: f32,
}

impl Map {
    /// The spec that this map was generated from.
    pub fn spec(&self) -> &MapSpec {
        &self.spec
    }

    /// The collision and sensing geometry.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Water and lava pools.
    pub fn pools(&self) -> &[Pool] {
        &self.pools
    }

    /// Jump pads.
    pub fn pads(&self) -> &[Pad] {
        &self.pads
    }

    /// Buildings.
    pub fn buildings(&self) -> &[Building] {
        &self.buildings
    }

    /// Plateaus.
    pub fn plateaus(&self) -> &[Plateau] {
        &self.plateaus
    }

    /// Content hash: equal for maps on which every character moves alike.
    pub fn hash(&self) -> MapHash {
        self.hash
    }

    /// Extent as a vector of metres.
    pub fn extent(&self) -> Vec3 {
        let MapSize { width, height, depth } = self.spec.size;
        Vec3::new(width as f32, height as f32, depth as f32)
    }

    /// Whether `feet` has left the map sideways or through the floor.
    pub fn is_outside(&self, feet: Vec3) -> bool {
        let extent = self.extent();
        feet.y < 0.0 || feet.x < 0.0 || feet.z < 0.0 || feet.x > extent.x || feet.z > extent.z
    }

    /// The pool whose liquid covers `feet` by more than `depth` metres.
    pub fn liquid_at(&self, feet: Vec3, depth: f32) -> Option<Liquid> {
        self.pools
            .iter()
            .find(|pool| {
                let offset = feet - pool.centre;
                offset.y < -depth
                    && offset.y > -(pool.depth + 1.0)
                    && offset.x * offset.x + offset.z * offset.z < pool.radius * pool.radius
            })
            .map(|pool| pool.liquid)
    }

    /// The pad that catches a character with its feet at `feet`.
    pub fn pad_at(&self, feet: Vec3) -> Option<&Pad> {
        self.pads.iter().find(|pad| {
            let offset = feet - pad.centre;
            offset.y.abs() < PAD_CATCH_HEIGHT_M
                && offset.x * offset.x + offset.z * offset.z < PAD_RADIUS_M * PAD_RADIUS_M
        })
    }

    /// The pad nearest to `point`, if the map has any.
    pub fn nearest_pad(&self, point: Vec3) -> Option<&Pad> {
        self.pads.iter().min_by(|a, b| a.centre.distance_squared(point).total_cmp(&b.centre.distance_squared(point)))
    }

    /// A map of given geometry: levels made elsewhere, and tests.
    pub fn from_parts(size: MapSize, triangles: Vec<crate::mesh::Triangle>, pools: Vec<Pool>, pads: Vec<Pad>) -> Self {
        let spec = MapSpec { size, ..MapSpec::new(0) };
        let extent = Vec3::new(size.width as f32, size.height as f32, size.depth as f32);
        Self::assemble(spec, Mesh::new(triangles, extent), pools, pads, Vec::new(), Vec::new())
    }

    fn assemble(
        spec: MapSpec,
        mesh: Mesh,
        pools: Vec<Pool>,
        pads: Vec<Pad>,
        buildings: Vec<Building>,
        plateaus: Vec<Plateau>,
    ) -> Self {
        let hash = content_hash(&spec, &mesh, &pools, &pads);
        Self { spec, mesh, pools, pads, buildings, plateaus, hash }
    }
}

fn content_hash(spec: &MapSpec, mesh: &Mesh, pools: &[Pool], pads: &[Pad]) -> MapHash {
    let mut hasher = blake3::Hasher::new();
    let mut put = |values: &[f32]| {
        for value in values {
            hasher.update(&value.to_bits().to_le_bytes());
        }
    };
    let MapSize { width, height, depth } = spec.size;
    put(&[width as f32, height as f32, depth as f32]);
    for triangle in mesh.triangles() {
        for corner in triangle.corners() {
            put(&corner.to_array());
        }
        put(&[f32::from(triangle.surface() as u8)]);
    }
    for pool in pools {
        put(&pool.centre.to_array());
        put(&[pool.radius, pool.depth, if pool.liquid == Liquid::Lava { 1.0 } else { 0.0 }]);
    }
    for pad in pads {
        put(&pad.centre.to_array());
        put(&[pad.speed]);
    }
    MapHash(*hasher.finalize().as_bytes())
}

impl From<Liquid> for Surface {
    fn from(liquid: Liquid) -> Self {
        match liquid {
            Liquid::Water => Surface::Water,
            Liquid::Lava => Surface::Lava,
        }
    }
}
