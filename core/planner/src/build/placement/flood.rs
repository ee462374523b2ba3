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
pub fn place(placing: &PlacementContext<'_>, grandchildren: bool, rng: &mut ChaCha8Rng) -> Result<Draft, BuildError> {
    let PlacementContext { site, settings, executor, progress, .. } = placing;
    let pool = placing.sample(POOL * settings.vertices, rng)?;
    let spacing_m = even_spacing(&site.map, settings.vertices);
    let goals = Goals { grid: PointGrid::new(&pool, spacing_m), pool: &pool, spacing_m };
    let mut flood = Flood {
        apart_m: MIN_SEPARATION * spacing_m,
        limit: settings.vertices,
        placed: GrowingGrid::new(site.map.extent(), MIN_SEPARATION * spacing_m, &[]),
        parents: Vec::new(),
        front: Vec::new(),
        candidates: BTreeSet::new(),
    };
    let mut episodes = 0;
    while flood.placed.points().len() < settings.vertices {
        if flood.front.is_empty() {
            flood.add(pool[rng.random_range(0..pool.len())], None);
            continue;
        }
        let trials = flood.trials(&goals, episodes, rng);
        episodes += trials.len() as u64;
        let run = |(_, trial): &(u32, Trial)| Trial { arrival: settings.arrival, ..*trial };
        let runs: Vec<Trial> = trials.iter().map(run).collect();
        let outcomes = executor.run(&runs, settings.seed, *progress).ok_or(BuildError::Cancelled)?;
        flood.front.clear();
        let arrived = trials.iter().zip(&outcomes).filter(|(_, outcome)| outcome.reached);
        arrived.for_each(|((source, trial), _)| flood.arrive(*source, trial.goal));
    }
    if grandchildren {
        flood.join_grandparents();
    }
    let (vertices, candidates) = (flood.placed.points().to_vec(), Some(flood.candidates.into_iter().collect()));
    Ok(Draft { vertices, candidates, episodes, ..Draft::default() })
}

/// Points to which the policy is sent.
struct Goals<'a> {
    pool: &'a [Vec3],
    grid: PointGrid,
    spacing_m: f32,
}

impl Goals<'_> {
    /// The points at the length of a spoke around `from` that `accept` accepts, m.
    fn around(&self, from: Vec3, accept: impl Fn(Vec3) -> bool) -> Vec<Vec3> {
        let near = self.grid.within(from, SPOKE_LENGTH.end * self.spacing_m).map(|goal| self.pool[goal as usize]);
        near.filter(|goal| SPOKE_LENGTH.contains(&(goal.distance(from) / self.spacing_m)) && accept(*goal)).collect()
    }
}

/// The vertices placed so far.
struct Flood {
    /// Least distance between vertices, m.
    apart_m: f32,
    /// Maximum number of vertices.
    limit: usize,
    placed: GrowingGrid,
    /// The vertex from which each vertex was found, if any.
    parents: Vec<Option<u32>>,
    /// Vertices from which the flood continues.
    front: Vec<u32>,
    candidates: BTreeSet<Candidate>,
}

impl Flood {
    fn add(&mut self, at: Vec3, parent: Option<u32>) -> u32 {
        let vertex = self.placed.points().len() as u32;
        self.placed.push(at);
        self.parents.push(parent);
        self.front.push(vertex);
        vertex
    }

    /// Draws goals around the vertices of the front, each with its vertex; trials are numbered from `first` + 1.
    fn trials(&self, goals: &Goals<'_>, first: u64, rng: &mut ChaCha8Rng) -> Vec<(u32, Trial)> {
        let mut trials = Vec::new();
        for &source in &self.front {
            let from = self.placed.points()[source as usize];
            let mut goals = goals.around(from, |goal| self.is_far(goal));
            for _ in 0..SPOKES.min(goals.len()) {
                let goal = goals.swap_remove(rng.random_range(0..goals.len()));
                trials.push((source, Trial::walk(from, goal, first + trials.len() as u64 + 1)));
            }
        }
        trials
    }

    /// Adds an arrival from the vertex `source`: a candidate in both directions, and a vertex if there is none near.
    fn arrive(&mut self, source: u32, at: Vec3) {
        let near = self.placed.within(at, self.apart_m).filter(|(_, vertex)| vertex.distance(at) < self.apart_m);
        let reached = match near.map(|(vertex, _)| vertex).min() {
            Some(vertex) => vertex,
            None if self.placed.points().len() < self.limit => self.add(at, Some(source)),
            None => return,
        };
        if reached != source {
            self.candidates.extend([EdgeKey::new(source, reached), EdgeKey::new(reached, source)]);
        }
    }

    fn is_far(&self, point: Vec3) -> bool {
        let (apart_m, mut near) = (self.apart_m, self.placed.within(point, self.apart_m));
        near.all(|(_, vertex)| vertex.distance_squared(point) >= apart_m * apart_m)
    }

    fn join_grandparents(&mut self) {
        let grandparents = (0u32..).zip(&self.parents).filter_map(|(vertex, parent)| {
            let grandparent = self.parents[(*parent)? as usize]?;
            (grandparent != vertex).then_some((grandparent, vertex))
        });
        self.candidates.extend(grandparents.flat_map(|(a, b)| [EdgeKey::new(a, b), EdgeKey::new(b, a)]));
    }
}
