//! [`CollisionMap`]: what bodies move on and what catches them.

use super::device::Device;
use super::features::{Liquid, Placed};
use super::frame::LevelFrame;
use super::hash::MapHash;
use super::mover::Mover;
use super::piece::Piece;
use super::spec::{MapSize, MapSpec};
use super::spot::Spot;
use super::surfaces;
use super::zones::Zones;
use crate::Vec3;
use crate::mesh::{Mesh, Surface, Triangle};
use std::sync::Arc;

/// The solid geometry of a map with its hazards, devices and movers: everything but the index for sensing.
///
/// Bodies move on it, so that a generator can test a draft before it makes a [`Map`](super::Map) of it.
#[derive(Debug)]
pub struct CollisionMap {
    pub(super) spec: Option<MapSpec>,
    pub(super) size: MapSize,
    pub(super) frame: LevelFrame,
    pub(super) mesh: Mesh,
    pub(super) placed: Placed,
    pub(super) zones: Zones,
    pub(super) movers: Arc<[Mover]>,
    pub(super) pieces: Vec<Piece>,
    pub(super) hash: MapHash,
    /// Hash of the map without its pieces.
    pub(super) built_hash: MapHash,
    /// Number of pools that are no pieces; they come first.
    pub(super) built_pool_count: usize,
}

impl CollisionMap {
    /// Indexes complete geometry, which includes the surfaces of pools and devices.
    pub fn new(spec: Option<MapSpec>, size: MapSize, triangles: Vec<Triangle>, placed: Placed) -> Self {
        let extent = size.extent();
        let hash = MapHash::of_content(size, &triangles, &placed);
        Self {
            spec,
            size,
            frame: LevelFrame::default(),
            mesh: Mesh::new(triangles, extent),
            zones: Zones::new(extent, &placed),
            movers: Arc::default(),
            pieces: Vec::new(),
            hash,
            built_hash: hash,
            built_pool_count: placed.pools.len(),
            placed,
        }
    }

    /// Indexes solid geometry, to which this adds the surfaces of pools and devices.
    pub fn from_solids(spec: Option<MapSpec>, size: MapSize, mut triangles: Vec<Triangle>, placed: Placed) -> Self {
        surfaces::add(&placed, &mut triangles);
        Self::new(spec, size, triangles, placed)
    }

    /// This map, without movers and pieces, with these features instead of its own.
    pub fn with_placed(self, placed: Placed) -> Self {
        let mut triangles = self.mesh.into_built_triangles();
        triangles.retain(|triangle| triangle.surface().is_solid());
        Self::from_solids(self.spec, self.size, triangles, placed)
    }

    /// The triangles and features of this map without its pieces.
    pub fn without_pieces(&self) -> (&[Triangle], Placed) {
        let mut placed = self.placed.clone();
        placed.pools.truncate(self.built_pool_count);
        (self.mesh.built_triangles(), placed)
    }

    /// The spec from which the map was generated; `None` for an imported level.
    pub fn spec(&self) -> Option<&MapSpec> {
        self.spec.as_ref()
    }

    /// Extent in whole metres.
    pub fn size(&self) -> MapSize {
        self.size
    }

    /// How the coordinates of the level that this map was made from relate to the map's.
    pub fn frame(&self) -> &LevelFrame {
        &self.frame
    }

    /// The collision and sensing geometry.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// All features of the map.
    pub fn placed(&self) -> &Placed {
        &self.placed
    }

    /// All movers of the map; their indices name them.
    pub fn movers(&self) -> &[Mover] {
        &self.movers
    }

    /// What was added to the map since it was built, by name.
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Content hash: equal for maps with the same geometry, features, movers and pieces.
    pub fn hash(&self) -> MapHash {
        self.hash
    }

    /// Content hash of the map without its pieces.
    pub fn built_hash(&self) -> MapHash {
        self.built_hash
    }

    /// Extent as a vector, m.
    pub fn extent(&self) -> Vec3 {
        self.size.extent()
    }

    /// Whether `feet` is outside the map sideways or below its floor.
    pub fn is_outside(&self, feet: Vec3) -> bool {
        let extent = self.extent();
        feet.y < 0.0 || feet.x < 0.0 || feet.z < 0.0 || feet.x > extent.x || feet.z > extent.z
    }

    /// How far below the surface of water `at` is, m; `None` outside of water.
    pub fn water_above(&self, at: Vec3) -> Option<f32> {
        let pools = self.zones.pools.at(at).iter().map(|idx| &self.placed.pools[*idx as usize]);
        let depths = pools.filter_map(|pool| {
            let offset = at - pool.centre;
            let is_in = pool.outline.contains(offset.x, offset.z) && offset.y < 0.0 && offset.y > -(pool.depth + 1.0);
            (is_in && pool.liquid == Liquid::Water).then_some(-offset.y)
        });
        depths.reduce(f32::max)
    }

    /// Whether a place, m, is in water, and not in the ground that the box of a pool reaches into.
    pub(crate) fn is_open_water(&self, at: Vec3) -> bool {
        self.water_above(at).is_some() && self.mesh.solid_depth_at(at) == 0
    }

    /// The liquid that covers `feet` by more than `depth` metres.
    pub fn liquid_at(&self, feet: Vec3, depth: f32) -> Option<Liquid> {
        self.zones.pools.at(feet).iter().find_map(|idx| {
            let pool = &self.placed.pools[*idx as usize];
            let offset = feet - pool.centre;
            let covered = offset.y < -depth && offset.y > -(pool.depth + 1.0);
            (covered && pool.outline.contains(offset.x, offset.z)).then_some(pool.liquid)
        })
    }

    /// The ways of spots that begin near a place, m, each with its spot.
    pub fn ways_at(&self, feet: Vec3) -> impl Iterator<Item = (&Spot, [Vec3; 2])> {
        self.zones.ways.at(feet).iter().map(|(idx, way)| (&self.placed.spots[*idx as usize], *way))
    }

    /// The device that catches a character with its feet at `feet`; `from` is the end that they are at.
    pub fn device_at(&self, feet: Vec3) -> Option<Device> {
        self.zones.entrances.at(feet).iter().find(|entrance| entrance.catches(feet)).copied()
    }
}

impl From<Liquid> for Surface {
    fn from(liquid: Liquid) -> Self {
        match liquid {
            Liquid::Water => Surface::Water,
            Liquid::Lava => Surface::Lava,
        }
    }
}
