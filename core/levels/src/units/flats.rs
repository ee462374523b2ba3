//! Finds the flat pieces of a level's surface: floors, treads and undersides.

use crate::inspect::weld;
use crate::joined::Joined;
use surefoot_world::{Aabb, Vec3};

/// Upright component of the normal from which a face is flat.
const FLAT: f32 = 0.99;

/// A flat piece of surface: triangles that share corners and all face up, or all face down.
pub(super) struct Flat {
    pub(super) bounds: Aabb,
    pub(super) area: f32,
    pub(super) faces_up: bool,
}

impl Flat {
    pub(super) fn centre(&self) -> Vec3 {
        (self.bounds.low + self.bounds.high) * 0.5
    }
}

pub(super) fn normal(&[a, b, c]: &[Vec3; 3]) -> Vec3 {
    (b - a).cross(c - a).normalize_or_zero()
}

/// The flat pieces of a level.
pub(super) struct Flats<'a> {
    pub(super) triangles: &'a [[Vec3; 3]],
    pub(super) pieces: Vec<Flat>,
    /// For each triangle, the piece that it is part of.
    pub(super) of_triangles: Vec<Option<u32>>,
}

/// Finds the flat pieces of a level.
pub(super) fn flats(triangles: &[[Vec3; 3]]) -> Flats<'_> {
    let upright = |corners: &[Vec3; 3]| normal(corners).y;
    let flat: Vec<usize> = (0..triangles.len()).filter(|&idx| upright(&triangles[idx]).abs() >= FLAT).collect();
    let vertices = weld(&flat.iter().map(|&idx| triangles[idx]).collect::<Vec<_>>());
    let vertex_count = vertices.iter().flatten().max().map_or(0, |&most| most + 1);
    // Faces up and down do not join, so each vertex counts twice.
    let side = |idx: usize| if upright(&triangles[idx]) > 0.0 { 0 } else { vertex_count };
    let mut joined = Joined::new(2 * vertex_count as usize);
    for (&idx, &[a, b, c]) in flat.iter().zip(&vertices) {
        let side = side(idx);
        joined.join(a + side, b + side);
        joined.join(a + side, c + side);
    }
    let mut numbers: Vec<Option<u32>> = vec![None; 2 * vertex_count as usize];
    let mut pieces: Vec<Flat> = Vec::new();
    let mut of_triangles = vec![None; triangles.len()];
    for (&idx, vertices) in flat.iter().zip(&vertices) {
        let [a, b, c] = triangles[idx];
        let area = (b - a).cross(c - a).length() * 0.5;
        let bounds = [b, c].into_iter().map(Aabb::at).fold(Aabb::at(a), Aabb::union);
        let side = side(idx);
        let number = &mut numbers[joined.root(vertices[0] + side) as usize];
        let piece = *number.get_or_insert(pieces.len() as u32);
        match pieces.get_mut(piece as usize) {
            Some(flat) => (flat.bounds, flat.area) = (flat.bounds.union(bounds), flat.area + area),
            None => pieces.push(Flat { bounds, area, faces_up: side == 0 }),
        }
        of_triangles[idx] = Some(piece);
    }
    Flats { triangles, pieces, of_triangles }
}
