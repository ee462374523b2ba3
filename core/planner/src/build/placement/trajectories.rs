//! Placement by merging trajectories. The paper's authors built it but do not describe it; this is our interpretation.
//!
//! The policy runs between random points, and places where it stood become vertices, merged with those nearby. Vertices
//! that a run passed one after the other are joined by an edge, whose evidence counts and times the passages. Without
//! edge tests, these edges form the graph; with them, each vertex is probed against its nearest neighbours instead.
//! Related to the observation graphs of "Semi-parametric topological memory" (Savinov et al., ICLR 2018).

use super::{Draft, PlacementContext, even_spacing};
use crate::build::candidates::Candidate;
use crate::build::probe::{Outcome, Trial};
use crate::evidence::{Evidence, TryEnd};
use crate::grid::{GrowingGrid, PointGrid};
use crate::ids::EdgeKey;
use crate::settings::BuildError;
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use std::collections::BTreeMap;
use surefoot_world::Vec3;

/// Number of runs in a round.
const ROUND: usize = 256;
/// Number of consecutive rounds without a new vertex after which the remaining vertices are placed at random.
const MAX_IDLE_ROUNDS: usize = 3;
/// Straight-line distance from start to goal of a run, m.
const RUN_M: std::ops::Range<f32> = 25.0..80.0;
/// Distance within which places are merged, in even spacings: on a plane, such discs cover about as much as
/// distance-constrained vertices do.
const MERGE: f32 = 0.8;
/// Number of rounds that only add evidence once all vertices are placed.
const EXTRA_ROUNDS: usize = 2;
/// Maximum number of points that runs start from and head for.
const POOL: usize = 4096;

/// Places vertices along runs, with the edges that the runs passed.
pub fn place(placing: &PlacementContext<'_>, rng: &mut ChaCha8Rng) -> Result<Draft, BuildError> {
    let PlacementContext { site, settings, executor, progress, .. } = placing;
    let pool = placing.sample(POOL.min(8 * settings.vertices), rng)?;
    let merge_m = MERGE * even_spacing(&site.map, settings.vertices);
    let grid = PointGrid::new(&pool, RUN_M.end);
    let vertices = GrowingGrid::new(site.map.extent(), merge_m, &[]);
    let mut merger = Merger { merge_m, limit: settings.vertices, vertices, seen: BTreeMap::new() };
    let (mut idle_rounds, mut extra_rounds, mut episodes) = (0, 0, 0);
    for round in 0u64.. {
        let is_full = merger.vertices.points().len() == settings.vertices;
        if idle_rounds == MAX_IDLE_ROUNDS || extra_rounds == EXTRA_ROUNDS {
            break;
        }
        let trials: Vec<Trial> = (0..ROUND as u64)
            .filter_map(|idx| {
                let start = pool[rng.random_range(0..pool.len())];
                let goals: Vec<u32> = grid
                    .within(start, RUN_M.end)
                    .filter(|&goal| RUN_M.contains(&pool[goal as usize].distance(start)))
                    .collect();
                let goal = pool[*goals.get(rng.random_range(0..goals.len().max(1)))? as usize];
                let stream = round * ROUND as u64 + idx;
                Some(Trial { keep_track: true, arrival: settings.arrival, ..Trial::walk(start, goal, stream) })
            })
            .collect();
        let before = merger.vertices.points().len();
        let outcomes = executor.run(&trials, settings.seed, *progress).ok_or(BuildError::Cancelled)?;
        episodes += outcomes.len() as u64;
        outcomes.iter().for_each(|outcome| merger.add(outcome));
        idle_rounds = if merger.vertices.points().len() > before || is_full { 0 } else { idle_rounds + 1 };
        extra_rounds += usize::from(is_full);
    }
    let Merger { vertices, seen, .. } = merger;
    let mut vertices = vertices.points().to_vec();
    // Runs stop finding new places where a map is small or fragmented: the remaining vertices are random, without
    // edges.
    while vertices.len() < settings.vertices {
        vertices.push(pool[rng.random_range(0..pool.len())]);
    }
    Ok(Draft { vertices, candidates: Some(seen.keys().copied().collect()), seen, episodes })
}

/// Merges the places where runs stood into vertices.
struct Merger {
    /// Distance within which places are merged, m.
    merge_m: f32,
    /// Maximum number of vertices.
    limit: usize,
    vertices: GrowingGrid,
    /// Evidence for pairs of vertices.
    seen: BTreeMap<Candidate, Evidence>,
}

impl Merger {
    /// Adds one run: new vertices where it stood far from all others, and evidence for each pair of vertices that it
    /// passed.
    fn add(&mut self, outcome: &Outcome) {
        let mut last: Option<(u32, u32)> = None;
        for (decision, place) in (0u32..).zip(&outcome.track) {
            let Some(feet) = *place else { continue };
            let Some(vertex) = self.vertex_at(feet) else { continue };
            if let Some((before, since)) = last
                && before != vertex
            {
                let evidence = self.seen.entry(EdgeKey::new(before, vertex)).or_default();
                evidence.note(TryEnd::Arrived, decision - since, outcome.ability);
                evidence.widen_bounds(feet);
            }
            if last.is_none_or(|(before, _)| before != vertex) {
                last = Some((vertex, decision));
            }
        }
    }

    /// Returns the vertex that a place merges with: the nearest within [`merge_m`](Self::merge_m), or else a new one,
    /// unless the limit is reached.
    fn vertex_at(&mut self, feet: Vec3) -> Option<u32> {
        let near = self.vertices.within(feet, self.merge_m).filter(|(_, vertex)| vertex.distance(feet) <= self.merge_m);
        let distance = |vertex: &Vec3| vertex.distance_squared(feet);
        let nearest = near.min_by(|(a, one), (b, other)| distance(one).total_cmp(&distance(other)).then(a.cmp(b)));
        let count = self.vertices.points().len();
        match nearest {
            Some((vertex, _)) => Some(vertex),
            None if count < self.limit => {
                self.vertices.push(feet);
                Some(count as u32)
            }
            None => None,
        }
    }
}
