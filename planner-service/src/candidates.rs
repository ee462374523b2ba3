//! Which pairs of vertices are worth a try.

use surefoot_world::Vec3;

/// An ordered pair of vertex indices.
pub type Candidate = (u32, u32);

/// Each vertex with its `neighbours` nearest others, in the order of the vertices, nearest first.
pub fn nearest(vertices: &[Vec3], neighbours: usize) -> Vec<Candidate> {
    let mut candidates = Vec::with_capacity(vertices.len() * neighbours);
    let mut others: Vec<u32> = Vec::with_capacity(vertices.len());
    for (from, position) in vertices.iter().enumerate() {
        others.clear();
        others.extend((0..vertices.len() as u32).filter(|&to| to as usize != from));
        let distance = |to: &u32| position.distance_squared(vertices[*to as usize]);
        others.sort_unstable_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)));
        candidates.extend(others.iter().take(neighbours).map(|&to| (from as u32, to)));
    }
    candidates
}
