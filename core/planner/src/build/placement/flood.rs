//! Placement by flooding. The paper's authors built it but do not describe it. This is our interpretation.
//!
//! The policy is sent from a first vertex to points around it. Each point where it arrives becomes a vertex unless
//! another one is near, and the flood continues from the new vertices, breadth first. If it finds nothing new, it
//! starts again from a random place, until all vertices are placed. Parents and children are candidate edges in both
//! directions; with grandchild edges, so are grandparents and grandchildren, which lets plans cut corners.

use super::{Draft, PlacementContext, even_spacing};
use crate::build::candidates::Candidate;
use crate::build::probe::Trial;
use crate::grid::{GrowingGrid, PointGrid};
use crate::ids::EdgeKey;
use crate::settings::BuildError;
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use std::collections::BTreeSet;
use surefoot_world::Vec3;

/// Number of points that the policy is sent to from each vertex.
const SPOKES: usize = 10;
/// Distances of these points, in even spacings.
const SPOKE_LENGTH: std::ops::Range<f32> = 0.7..1.6;
/// Least distance between vertices, in even spacings.
const MIN_SEPARATION: f32 = 0.75;
/// Number of points in the pool of goals, for each vertex.
const POOL: usize = 10;

/// Places vertices where the policy arrives, and lists the candidate edges between them.
///
/// # Errors
/// If the map has no navigable ground, or the build was cancelled.
pub fn place(placing: &PlacementContext<'_>, grandchildren: bool, rng: &mut ChaCha8Rng) -> Result<Draft, BuildError> {
    let PlacementContext { site, settings, executor, progress, .. } = placing;
    let pool = placing.sample(POOL * settings.vertices, rng)?;
    let spacing = even_spacing(&site.map, settings.vertices);
    let apart = MIN_SEPARATION * spacing;
    let grid = PointGrid::new(&pool, spacing);
    let mut placed = GrowingGrid::new(site.map.extent(), apart, &[]);
    let mut episodes = 0;
    let mut parents: Vec<Option<u32>> = Vec::new();
    let mut candidates: BTreeSet<Candidate> = BTreeSet::new();
    let (mut front, mut stream) = (Vec::new(), 0);
    while placed.points().len() < settings.vertices {
        if front.is_empty() {
            let start = pool[rng.random_range(0..pool.len())];
            front.push(placed.points().len() as u32);
            placed.push(start);
            parents.push(None);
            continue;
        }
        let mut sources = Vec::new();
        let mut trials = Vec::new();
        for &source in &front {
            let from = placed.points()[source as usize];
            let mut goals: Vec<u32> = grid
                .within(from, SPOKE_LENGTH.end * spacing)
                .filter(|&goal| {
                    let at = pool[goal as usize];
                    let distance = at.distance(from) / spacing;
                    SPOKE_LENGTH.contains(&distance) && is_far(&placed, at, apart)
                })
                .collect();
            for _ in 0..SPOKES.min(goals.len()) {
                let goal = pool[goals.swap_remove(rng.random_range(0..goals.len())) as usize];
                stream += 1;
                sources.push(source);
                trials.push(Trial::walk(from, goal, stream));
            }
        }
        let outcomes = executor.run(&trials, settings.seed, *progress).ok_or(BuildError::Cancelled)?;
        episodes += outcomes.len() as u64;
        front.clear();
        for ((trial, outcome), &source) in trials.iter().zip(&outcomes).zip(&sources) {
            if !outcome.reached {
                continue;
            }
            let near = placed.within(trial.goal, apart).filter(|(_, vertex)| vertex.distance(trial.goal) < apart);
            let count = placed.points().len();
            let reached = match near.map(|(vertex, _)| vertex).min() {
                Some(vertex) => vertex,
                None if count < settings.vertices => {
                    placed.push(trial.goal);
                    parents.push(Some(source));
                    front.push(count as u32);
                    count as u32
                }
                None => continue,
            };
            if reached != source {
                candidates.extend([EdgeKey::new(source, reached), EdgeKey::new(reached, source)]);
            }
        }
    }
    if grandchildren {
        let grandparents = (0u32..).zip(&parents).filter_map(|(vertex, parent)| {
            let grandparent = parents[(*parent)? as usize]?;
            (grandparent != vertex).then_some((grandparent, vertex))
        });
        candidates.extend(grandparents.flat_map(|(a, b)| [EdgeKey::new(a, b), EdgeKey::new(b, a)]));
    }
    let (vertices, candidates) = (placed.points().to_vec(), Some(candidates.into_iter().collect()));
    Ok(Draft { vertices, candidates, episodes, ..Draft::default() })
}

fn is_far(vertices: &GrowingGrid, point: Vec3, apart: f32) -> bool {
    vertices.within(point, apart).all(|(_, vertex)| vertex.distance_squared(point) >= apart * apart)
}
