//! All triangles of a map: the built ones, whose index edited maps share, and the added ones.

use super::added::Added;
use super::climbed::{self, ClimbSpot, WallFace};
use super::grid::Grid;
use super::ray::RayHit;
use super::triangle::Triangle;
use crate::Vec3;
use std::ops::Index;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// Least share of a wall that is solid.
const LEAST_DENSITY: f32 = 0.3;

static NEXT_ID: AtomicU64 = AtomicU64::new(0);

/// Indexed triangles.
#[derive(Debug)]
pub struct Mesh {
    built: Arc<Grid>,
    added: Option<Added>,
    climb_spots: OnceLock<Vec<ClimbSpot>>,
    /// Unique among all meshes of this process.
    id: u64,
}

/// The triangles of a mesh, in a fixed order.
#[derive(Debug, Clone, Copy)]
pub struct Triangles<'a> {
    built: &'a [Triangle],
    added: &'a [Triangle],
}

type Iter<'a> = std::iter::Chain<std::slice::Iter<'a, Triangle>, std::slice::Iter<'a, Triangle>>;

impl<'a> Triangles<'a> {
    /// Number of triangles.
    pub fn len(self) -> usize {
        self.built.len() + self.added.len()
    }

    /// Whether there are no triangles.
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// All triangles in order.
    pub fn iter(self) -> Iter<'a> {
        self.built.iter().chain(self.added)
    }
}

impl<'a> IntoIterator for Triangles<'a> {
    type Item = &'a Triangle;
    type IntoIter = Iter<'a>;

    fn into_iter(self) -> Iter<'a> {
        self.iter()
    }
}

impl Index<usize> for Triangles<'_> {
    type Output = Triangle;

    fn index(&self, idx: usize) -> &Triangle {
        self.built.get(idx).unwrap_or_else(|| &self.added[idx - self.built.len()])
    }
}

impl Mesh {
    /// Indexes `triangles` inside the box from the origin to `extent`.
    pub fn new(triangles: Vec<Triangle>, extent: Vec3) -> Self {
        Self::of(Arc::new(Grid::new(triangles, extent)), None)
    }

    fn of(built: Arc<Grid>, added: Option<Added>) -> Self {
        Self { built, added, climb_spots: OnceLock::new(), id: NEXT_ID.fetch_add(1, Ordering::Relaxed) }
    }

    /// The built triangles of this mesh with others added. The time does not depend on the size of the mesh.
    pub(crate) fn with_added(&self, triangles: Vec<Triangle>) -> Self {
        Self::of(self.built.clone(), Added::new(triangles))
    }

    /// Identity of this mesh among all meshes of the process.
    pub(crate) fn id(&self) -> u64 {
        self.id
    }

    /// All triangles.
    pub fn triangles(&self) -> Triangles<'_> {
        let added = self.added.as_ref().map_or(&[][..], |added| &added.triangles);
        Triangles { built: &self.built.triangles, added }
    }

    /// The spots at the upright faces that bodies climb, in a fixed order.
    pub fn climb_spots(&self) -> &[ClimbSpot] {
        self.climb_spots.get_or_init(|| climbed::spots(self.triangles()))
    }

    /// The solid upright faces of at least this height and length, m, in a fixed order. Planes in which little is solid
    /// are left out, as those of rock.
    pub fn wall_faces(&self, height: f32, length: f32) -> impl Iterator<Item = WallFace> {
        let solid = self.triangles().iter().filter(|triangle| triangle.surface().is_solid());
        climbed::faces(solid)
            .filter(move |face| face.height >= height && face.length() >= length && face.density() >= LEAST_DENSITY)
    }

    /// The triangles that the mesh was built from.
    pub(crate) fn built_triangles(&self) -> &[Triangle] {
        &self.built.triangles
    }

    /// The triangles that were added since.
    pub(super) fn added(&self) -> Option<&Added> {
        self.added.as_ref()
    }

    /// Returns the triangles that it was built of.
    pub(crate) fn into_built_triangles(self) -> Vec<Triangle> {
        Arc::unwrap_or_clone(self.built).triangles
    }

    /// Memory of the triangles and their index, in bytes.
    pub fn memory_bytes(&self) -> usize {
        self.built.memory_bytes() + self.added.as_ref().map_or(0, Added::memory_bytes)
    }

    /// Finds the first triangle along the ray within `max_distance` metres; `direction` must have unit length.
    pub fn cast_ray(&self, origin: Vec3, direction: Vec3, max_distance: f32) -> Option<RayHit> {
        let hit = self.built.cast_ray(origin, direction, max_distance);
        let Some(added) = &self.added else { return hit };
        let nearer = added.cast_ray(origin, direction, hit.map_or(max_distance, |hit| hit.distance));
        let first = self.built.triangles.len() as u32;
        nearer.map(|hit| RayHit { triangle_idx: first + hit.triangle_idx, ..hit }).or(hit)
    }

    /// Whether no solid face lies between two points. Liquids and devices hide nothing.
    pub fn is_in_sight(&self, from: Vec3, to: Vec3) -> bool {
        let (mut origin, mut left) = (from, from.distance(to));
        let direction = (to - from) / left.max(f32::MIN_POSITIVE);
        while left > 0.0
            && let Some(hit) = self.cast_ray(origin, direction, left)
        {
            if hit.surface.is_solid() {
                return false;
            }
            let step = hit.distance + 1.0e-3;
            (origin, left) = (origin + direction * step, left - step);
        }
        true
    }

    /// Number of solids that contain `point`: 0 in the open. Solids must be closed and may overlap.
    ///
    /// Counts the faces through which a ray to the sky leaves and enters solids. The result is the median of three
    /// rays, because one ray may graze an edge or hit two coincident faces.
    pub fn solid_depth_at(&self, point: Vec3) -> u32 {
        let tilts = [Vec3::new(0.017_3, 1.0, 0.020_1), Vec3::new(-0.151, 1.0, 0.083), Vec3::new(0.061, 1.0, -0.217)];
        let mut depths = tilts.map(|tilt| self.faces_left(point, tilt.normalize()));
        depths.sort_unstable();
        depths[1].max(0) as u32
    }

    /// Number of solid faces through which a ray leaves, minus those through which it enters.
    fn faces_left(&self, mut origin: Vec3, direction: Vec3) -> i32 {
        let mut count = 0;
        while let Some(hit) = self.cast_ray(origin, direction, f32::MAX) {
            let triangle = &self.triangles()[hit.triangle_idx as usize];
            if triangle.surface().is_solid() {
                count += if triangle.normal().dot(direction) > 0.0 { 1 } else { -1 };
            }
            origin += direction * (hit.distance + 1.0e-3);
        }
        count
    }

    /// Replaces the content of `found` with the indices of the solid triangles whose bounds touch the box, ascending
    /// and unique.
    pub fn gather_solids(&self, low: Vec3, high: Vec3, found: &mut Vec<u32>) {
        self.built.gather_solids(low, high, found);
        if let Some(added) = &self.added {
            added.gather_solids(low, high, self.built.triangles.len() as u32, found);
        }
    }
}
