//! A map: static geometry with hazards and devices.
//!
//! A [`Map`] is immutable once built and shared behind an `Arc` by all worlds, probes and trainers that
//! use it. A map is identified by the hash of its content, never by its seed.

mod built;
pub mod features;
mod furnish;
pub mod generate;
pub mod mover;
pub mod piece;
mod repair;
pub mod spec;
pub mod stage;
mod structures;
mod terrain;
pub(crate) mod zones;

use crate::Vec3;
use crate::mesh::{Mesh, Surface, Triangle};
pub use features::{
    Building, CATCH_HEIGHT_M, Cave, DEVICE_RANGE_M, DISC_RADIUS_M, Jetpack, Liquid, Outline, Pad, Placed, Plateau,
    Pool, Ravine, Teleporter, ZipLine,
};
pub use mover::{Mover, MoverError, MoverKind, MoverStop};
pub use piece::{Piece, PieceError, PieceShape};
use serde::{Deserialize, Serialize};
pub use spec::{Features, MapKind, MapSize, MapSpec, MoverDensities, RawMapSpec, SpecError};
use std::fmt;
use std::sync::Arc;
pub use zones::Zone;
use zones::ZoneGrid;

/// Static geometry with everything placed on it.
#[derive(Debug)]
pub struct Map {
    spec: Option<MapSpec>,
    size: MapSize,
    mesh: Mesh,
    placed: Placed,
    zones: ZoneGrid,
    movers: Arc<[Mover]>,
    pieces: Vec<Piece>,
    hash: MapHash,
    built: Built,
}

/// What is known of a map without its pieces, besides its mesh.
#[derive(Debug, Clone, Copy)]
struct Built {
    hash: MapHash,
    pool_count: usize,
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

impl Map {
    /// Creates a map from solid geometry and features, for imported levels and tests. The surfaces of pools and the discs
    /// of devices are added here.
    pub fn from_parts(size: MapSize, mut triangles: Vec<Triangle>, placed: Placed) -> Self {
        structures::add_surfaces(&placed, &mut triangles);
        Self::assemble(None, size, triangles, placed)
    }

    /// Indexes complete geometry, including the surfaces of pools and devices.
    pub(crate) fn assemble(spec: Option<MapSpec>, size: MapSize, triangles: Vec<Triangle>, placed: Placed) -> Self {
        Self::draft(spec, size, triangles, placed).complete()
    }

    /// Makes a draft ready for sensing.
    fn complete(self) -> Self {
        Self { mesh: self.mesh.complete(), ..self }
    }

    /// Indexes geometry that generation may still change: bodies can move on it, but not sense it.
    fn draft(spec: Option<MapSpec>, size: MapSize, triangles: Vec<Triangle>, placed: Placed) -> Self {
        let extent = size.extent();
        let hash = content_hash(size, &triangles, &placed);
        let zones = ZoneGrid::new(extent, &placed);
        let built = Built { hash, pool_count: placed.pools.len() };
        let (movers, pieces) = (Arc::default(), Vec::new());
        Self { spec, size, mesh: Mesh::draft(triangles, extent), placed, zones, movers, pieces, hash, built }
    }

    /// Adds movers to a map without, whose hash then tells of them.
    ///
    /// # Errors
    /// If one of them is not valid, or they are too many.
    pub fn with_movers(self, movers: Vec<Mover>) -> Result<Self, MoverError> {
        mover::check(&movers)?;
        if movers.is_empty() {
            return Ok(self);
        }
        let hash = hash_with(self.hash, &movers);
        Ok(Self { hash, built: Built { hash, ..self.built }, movers: movers.into(), ..self })
    }

    /// This map with exactly these pieces, in the order of their names, instead of those that it has. The index of what the map was built of
    /// is shared, so this takes no longer on a large map.
    ///
    /// # Errors
    /// If one of them is not valid, or they are too many.
    pub fn with_pieces(&self, mut pieces: Vec<Piece>) -> Result<Self, PieceError> {
        piece::arrange(&mut pieces, self.extent())?;
        let mut placed = self.placed.clone();
        placed.pools.truncate(self.built.pool_count);
        placed.pools.extend(pieces.iter().filter_map(Piece::pool));
        let mut triangles: Vec<Triangle> = pieces.iter().flat_map(Piece::triangles).collect();
        structures::add_pools(&placed.pools[self.built.pool_count..], &mut triangles);
        let hash = if pieces.is_empty() { self.built.hash } else { hash_with(self.built.hash, &pieces) };
        Ok(Self {
            spec: self.spec,
            size: self.size,
            mesh: self.mesh.with_added(triangles),
            zones: ZoneGrid::new(self.extent(), &placed),
            placed,
            movers: self.movers.clone(),
            pieces,
            hash,
            built: self.built,
        })
    }

    /// This map with exactly these pieces; the map itself if it has them already, in the order of their names.
    ///
    /// # Errors
    /// If one of them is not valid, or they are too many.
    pub fn holding(self: &Arc<Self>, pieces: &[Piece]) -> Result<Arc<Self>, PieceError> {
        if self.pieces == pieces { Ok(self.clone()) } else { self.with_pieces(pieces.to_vec()).map(Arc::new) }
    }

    /// The triangles and features of this map without its pieces.
    pub(crate) fn without_pieces(&self) -> (&[Triangle], Placed) {
        let mut placed = self.placed.clone();
        placed.pools.truncate(self.built.pool_count);
        (self.mesh.built_triangles(), placed)
    }

    /// Returns the triangles of the mesh.
    fn into_triangles(self) -> Vec<Triangle> {
        self.mesh.into_triangles()
    }

    /// The spec from which the map was generated; `None` for an imported level.
    pub fn spec(&self) -> Option<&MapSpec> {
        self.spec.as_ref()
    }

    /// Extent in whole metres.
    pub fn size(&self) -> MapSize {
        self.size
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
        self.built.hash
    }

    /// Memory of the geometry and its index, in bytes.
    pub fn memory_bytes(&self) -> usize {
        self.mesh.memory_bytes()
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

    /// Pools and devices near `point` that may contain it; most places have none.
    pub fn zones_near(&self, point: Vec3) -> &[Zone] {
        self.zones.near(point.x, point.z)
    }

    /// The liquid that covers `feet` by more than `depth` metres.
    pub fn liquid_at(&self, feet: Vec3, depth: f32) -> Option<Liquid> {
        self.zones_near(feet).iter().find_map(|zone| {
            let Zone::Pool(idx) = zone else { return None };
            let pool = &self.placed.pools[*idx as usize];
            let offset = feet - pool.centre;
            let covered = offset.y < -depth && offset.y > -(pool.depth + 1.0);
            (covered && pool.outline.contains(offset.x, offset.z)).then_some(pool.liquid)
        })
    }

    /// The device that catches a character with its feet at `feet`; never a [`Zone::Pool`].
    pub fn device_at(&self, feet: Vec3) -> Option<Zone> {
        self.zones_near(feet).iter().copied().find(|&zone| self.device_centre(zone).is_some_and(|c| catches(c, feet)))
    }

    /// Centre of the disc where a device is entered, m; `None` for a pool.
    pub fn device_centre(&self, zone: Zone) -> Option<Vec3> {
        Some(match zone {
            Zone::Pool(_) => return None,
            Zone::Pad(idx) => self.placed.pads[idx as usize].centre,
            Zone::ZipLine(idx) => self.placed.zip_lines[idx as usize].from,
            Zone::Teleporter(idx) => self.placed.teleporters[idx as usize].from,
            Zone::TeleporterBack(idx) => self.placed.teleporters[idx as usize].to,
            Zone::Jetpack(idx) => self.placed.jetpacks[idx as usize].centre,
        })
    }

    /// The pad nearest to `point` within [`DEVICE_RANGE_M`].
    pub fn nearest_pad(&self, point: Vec3) -> Option<&Pad> {
        self.placed.nearest_pad(point)
    }

    /// The jetpack nearest to `point` within [`DEVICE_RANGE_M`].
    pub fn nearest_jetpack(&self, point: Vec3) -> Option<&Jetpack> {
        self.placed.nearest_jetpack(point)
    }

    /// Entrance and exit of the zip line or teleporter that brings `goal` nearest to `point`; see [`Placed::best_transport`].
    pub fn best_transport(&self, point: Vec3, goal: Vec3) -> Option<(Vec3, Vec3)> {
        self.placed.best_transport(point, goal)
    }
}

fn catches(centre: Vec3, feet: Vec3) -> bool {
    let offset = feet - centre;
    offset.y.abs() < CATCH_HEIGHT_M && offset.x * offset.x + offset.z * offset.z < DISC_RADIUS_M * DISC_RADIUS_M
}

fn content_hash(size: MapSize, triangles: &[Triangle], placed: &Placed) -> MapHash {
    let mut hasher = blake3::Hasher::new();
    let mut record = [0u8; 37];
    for triangle in triangles {
        for (bytes, value) in record.chunks_exact_mut(4).zip(triangle.corners().iter().flat_map(|c| c.to_array())) {
            bytes.copy_from_slice(&value.to_bits().to_le_bytes());
        }
        record[36] = triangle.surface() as u8;
        hasher.update(&record);
    }
    hasher.update(&postcard::to_stdvec(&(size, placed)).expect("plain data"));
    MapHash(*hasher.finalize().as_bytes())
}

/// The hash of a map of that hash with something on it.
fn hash_with(map: MapHash, more: &(impl Serialize + ?Sized)) -> MapHash {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&map.0).update(&postcard::to_stdvec(more).expect("plain data"));
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
