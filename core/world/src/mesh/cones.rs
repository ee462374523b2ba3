//! The index through which NPCs cast their cones of rays: one for the built triangles of a map, which edited maps
//! share, and one for the triangles that were added.

use super::columns::Columns;
use super::fan::{ConeHits, Elevations};
use super::lanes::LANES;
use super::layers::Mesh;
use crate::Vec3;
use std::sync::Arc;

/// Triangles indexed for cones of rays.
#[derive(Debug)]
pub struct Cones {
    built: Arc<Columns>,
    added: Option<AddedColumns>,
}

#[derive(Debug)]
struct AddedColumns {
    low: Vec3,
    high: Vec3,
    columns: Columns,
}

impl AddedColumns {
    fn new(mesh: &Mesh) -> Option<Self> {
        mesh.added().map(|it| Self { low: it.low, high: it.high, columns: Columns::new(&it.triangles) })
    }

    /// Whether a triangle may lie within `reach` metres of `point`.
    fn is_near(&self, point: Vec3, reach: f32) -> bool {
        let reach = Vec3::splat(reach);
        (point + reach).cmpge(self.low).all() && (point - reach).cmple(self.high).all()
    }
}

impl Cones {
    /// Indexes all triangles of a mesh.
    pub fn new(mesh: &Mesh) -> Self {
        Self { built: Arc::new(Columns::new(mesh.built_triangles())), added: AddedColumns::new(mesh) }
    }

    /// The index of a mesh that has the same built triangles, but others added to them.
    pub(crate) fn with_added(&self, mesh: &Mesh) -> Self {
        Self { built: self.built.clone(), added: AddedColumns::new(mesh) }
    }

    /// Memory of the index, in bytes.
    pub fn memory_bytes(&self) -> usize {
        self.built.memory_bytes() + self.added.as_ref().map_or(0, |added| added.columns.memory_bytes())
    }

    /// Casts a cone of rays from `eye`: at each heading, a horizontal unit vector (x, z), a ray at each elevation.
    pub fn cast(&self, elevations: &Elevations, eye: Vec3, headings: &[(f32, f32); LANES]) -> ConeHits {
        let mut hits = self.built.cast_cone(elevations, eye, headings);
        if let Some(added) = self.added.as_ref().filter(|added| added.is_near(eye, elevations.range())) {
            let others = added.columns.cast_cone(elevations, eye, headings);
            for (hit, other) in hits.as_flattened_mut().iter_mut().zip(others.as_flattened()) {
                if other.is_some_and(|other| hit.is_none_or(|hit| other.distance < hit.distance)) {
                    *hit = *other;
                }
            }
        }
        hits
    }
}
