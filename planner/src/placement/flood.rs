//! Flooding, built by the paper's authors but left out of its text: our reading.
//!
//! From one vertex the policy is sent to points around; where it arrives and no vertex is near, there is a new one, and
//! it goes on from there, breadth first, until all vertices are placed or nothing new is found. Parents and children
//! are tried both ways; with grandchild edges, grandparents and grandchildren too, which lets plans cut corners. What
//! cannot be got to from the first vertex is started again from another place.

use super::{Draft, Placing, even_spacing};
use crate::candidates::Candidate;
use crate::grid::PointGrid;
use crate::ids::EdgeKey;
use crate::probe::Trial;
use crate::settings::BuildError;
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use std::collections::BTreeSet;
use surefoot_world::{Vec3, navigable};

/// Points that each vertex sends the policy to.
const SPOKES: usize = 10;
/// How far they are, in even spacings.
const SPOKE: std::ops::Range<f32> = 0.7..1.6;
/// Least distance between vertices, in even spacings.
const APART: f32 = 0.75;
/// Points that may be sent to, for each vertex.
const POOL: usize = 10;

/// Vertices where the policy gets to, with the pairs to try.
///
/// # Errors
/// If the map has no ground to stand on, or the build was cancelled.
pub fn place(placing: &Placing<'_>, grandchildren: bool, rng: &mut ChaCha8Rng) -> Result<Draft, BuildError> {
    let Placing { site, settings, executor, progress, cancel } = placing;
    let pool = navigable::sample_many(&site.map, &site.profile, POOL * settings.vertices, rng)?;
    let spacing = even_spacing(&site.map, settings.vertices);
    let apart = APART * spacing;
    let grid = PointGrid::new(&pool, spacing);
    let mut draft = Draft::default();
    let mut parents: Vec<Option<u32>> = Vec::new();
    let mut candidates: BTreeSet<Candidate> = BTreeSet::new();
    let (mut front, mut stream) = (Vec::new(), 0);
    while draft.vertices.len() < settings.vertices {
        if front.is_empty() {
            let start = pool[rng.random_range(0..pool.len())];
            front.push(draft.vertices.len() as u32);
            draft.vertices.push(start);
            parents.push(None);
            continue;
        }
        let mut sources = Vec::new();
        let mut trials = Vec::new();
        for &source in &front {
            let from = draft.vertices[source as usize];
            let mut goals: Vec<u32> = grid
                .within(from, SPOKE.end * spacing)
                .filter(|&goal| {
                    let at = pool[goal as usize];
                    let distance = at.distance(from) / spacing;
                    SPOKE.contains(&distance) && is_far(&draft.vertices, at, apart)
                })
                .collect();
            for _ in 0..SPOKES.min(goals.len()) {
                let goal = pool[goals.swap_remove(rng.random_range(0..goals.len())) as usize];
                stream += 1;
                sources.push(source);
                trials.push(Trial { start: from, goal, stream, keep_track: false });
            }
        }
        let outcomes = executor.run(&trials, settings.seed, progress, cancel).ok_or(BuildError::Cancelled)?;
        draft.episodes += outcomes.len() as u64;
        front.clear();
        for ((trial, outcome), &source) in trials.iter().zip(&outcomes).zip(&sources) {
            if !outcome.reached {
                continue;
            }
            let near = (0..).zip(&draft.vertices).find(|(_, vertex)| vertex.distance(trial.goal) < apart);
            let reached = match near {
                Some((vertex, _)) => vertex,
                None if draft.vertices.len() < settings.vertices => {
                    draft.vertices.push(trial.goal);
                    parents.push(Some(source));
                    front.push(draft.vertices.len() as u32 - 1);
                    draft.vertices.len() as u32 - 1
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
    draft.candidates = Some(candidates.into_iter().collect());
    Ok(draft)
}

fn is_far(vertices: &[Vec3], point: Vec3, apart: f32) -> bool {
    vertices.iter().all(|vertex| vertex.distance_squared(point) >= apart * apart)
}
