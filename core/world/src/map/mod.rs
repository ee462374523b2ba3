//! A map: geometry with hazards, devices and movers.
//!
//! A [`Map`] is immutable once built and shared behind an `Arc` by all worlds, probes and trainers that
//! use it. A map is identified by the hash of its content, never by its seed.

mod block;
mod collision;
mod device;
pub mod features;
mod frame;
mod hash;
pub mod mover;
pub mod piece;
pub mod spec;
pub mod spot;
pub(crate) mod standing;
mod surfaces;
pub mod zones;

use crate::mesh::{Cones, Triangle};
pub use block::Block;
pub use collision::CollisionMap;
pub use device::{DEVICE_RANGE_M, Device, DeviceKind};
pub use features::{
    Building, CATCH_HEIGHT_M, Cave, DISC_RADIUS_M, Jetpack, Liquid, Outline, Pad, Placed, Plateau, Pool, Ravine,
    Teleporter, ZipLine,
};
pub use frame::{LevelFrame, UpAxis};
pub use hash::MapHash;
pub use mover::{Mover, MoverError, MoverKind, MoverStop};
pub use piece::{Piece, PieceError, PieceShape};
pub use spec::{Features, MapKind, MapSize, MapSpec, MoverDensities, RawMapSpec, SpecError};
pub use spot::Spot;
use standing::KeptPlaces;
use std::ops::Deref;
use std::sync::Arc;
use zones::Zones;

/// Geometry with everything placed on it, ready for bodies that sense it.
#[derive(Debug)]
pub struct Map {
    collision: CollisionMap,
    cones: Cones,
    places: KeptPlaces,
}

impl Deref for Map {
    type Target = CollisionMap;

    fn deref(&self) -> &CollisionMap {
        &self.collision
    }
}

impl Map {
    /// Indexes a map for sensing.
    pub fn new(collision: CollisionMap) -> Self {
        Self { cones: Cones::new(&collision.mesh), places: KeptPlaces::default(), collision }
    }

    /// Creates a map from solid geometry and features, for imported levels and tests. The surfaces of pools and the
    /// discs of devices are added here.
    pub fn from_parts(size: MapSize, triangles: Vec<Triangle>, placed: Placed) -> Self {
        Self::new(CollisionMap::from_solids(None, size, triangles, placed))
    }

    /// Notes how the coordinates of the level that this map was made from relate to the map's.
    #[must_use]
    pub fn with_frame(mut self, frame: LevelFrame) -> Self {
        self.collision.frame = frame;
        self
    }

    /// Adds movers to a map that has none.
    ///
    /// # Errors
    /// If a mover is not valid, or there are too many.
    pub fn with_movers(mut self, movers: Vec<Mover>) -> Result<Self, MoverError> {
        mover::check(&movers)?;
        if !movers.is_empty() {
            self.collision.hash = self.collision.hash.with(&movers);
            self.collision.built_hash = self.collision.hash;
            self.collision.movers = movers.into();
        }
        Ok(self)
    }

    /// Returns this map with exactly these pieces, sorted by name. Both maps share the index of the built geometry, so
    /// the size of the map does not matter.
    ///
    /// # Errors
    /// If a piece is not valid, or there are too many.
    pub fn with_pieces(&self, mut pieces: Vec<Piece>) -> Result<Self, PieceError> {
        piece::arrange(&mut pieces, self.extent())?;
        let (_, mut placed) = self.without_pieces();
        let pools: Vec<Pool> = pieces.iter().filter_map(Piece::pool).collect();
        let mut triangles: Vec<Triangle> = pieces.iter().flat_map(Piece::triangles).collect();
        surfaces::add_pools(&pools, &mut triangles);
        placed.pools.extend(pools);
        let mesh = self.mesh.with_added(triangles);
        let cones = self.cones.with_added(&mesh);
        let hash = if pieces.is_empty() { self.built_hash } else { self.built_hash.with(&pieces) };
        let zones = Zones::new(self.extent(), &placed);
        let movers = self.movers.clone();
        let collision = CollisionMap { mesh, zones, placed, movers, pieces, hash, ..self.collision };
        Ok(Self { collision, cones, places: KeptPlaces::default() })
    }

    /// Returns a map with exactly these pieces: this map if it has them already, in the order of their names.
    ///
    /// # Errors
    /// If a piece is not valid, or there are too many.
    pub fn holding(self: &Arc<Self>, pieces: &[Piece]) -> Result<Arc<Self>, PieceError> {
        if self.pieces == pieces { Ok(self.clone()) } else { self.with_pieces(pieces.to_vec()).map(Arc::new) }
    }

    /// The index for sensing.
    pub fn cones(&self) -> &Cones {
        &self.cones
    }

    /// Places to stand that searches for walks have found.
    pub(crate) fn places(&self) -> &KeptPlaces {
        &self.places
    }

    /// Memory of the geometry and its indices, in bytes.
    pub fn memory_bytes(&self) -> usize {
        self.mesh.memory_bytes() + self.cones.memory_bytes()
    }
}
