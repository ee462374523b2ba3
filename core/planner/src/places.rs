//! Places to ask about: near a point, hidden from some eyes and seen by others.

use crate::graph::NavGraph;
use crate::grid::GrowingGrid;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use surefoot_world::character::MoveScratch;
use surefoot_world::map::CollisionMap;
use surefoot_world::mesh::Mesh;
use surefoot_world::{CharacterProfile, Vec3, navigable};

/// Greatest distance of a sampled place from a vertex on the plane, m. Legs that short mostly succeed.
const BESIDE_M: f32 = 6.0;
/// Greatest height difference between a sampled place and its vertex, m.
const RISE_M: f32 = 2.0;
/// Distance that sampled places keep from all others, m.
const APART_M: f32 = 1.5;
/// Number of samples for each place that is missing, before fewer places are returned.
const TRIES: usize = 4;
/// Seed of the samples: the same question has the same answer.
const SEED: u64 = 0x7ac7_1c50;

/// Where to draw places.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Around {
    /// The middle, m.
    pub centre: Vec3,
    /// Greatest distance from the middle, m.
    pub radius_m: f32,
    /// Greatest number of places.
    pub most: usize,
}

impl Around {
    /// Draws places where a body has room: vertices of the graph that have an edge, the nearest first, then samples of
    /// the ground near these vertices.
    pub fn draw(&self, graph: &NavGraph, map: &CollisionMap, profile: &CharacterProfile) -> Vec<Vec3> {
        let is_within = |place: Vec3| place.distance_squared(self.centre) <= self.radius_m * self.radius_m;
        let vertices = graph.vertices().filter(|&vertex| graph.has_exit(vertex) || graph.has_entrance(vertex));
        let mut vertices: Vec<Vec3> =
            vertices.map(|vertex| graph.position(vertex)).filter(|place| is_within(*place)).collect();
        let distance = |place: &Vec3| place.distance_squared(self.centre);
        vertices.sort_by(|one, other| distance(one).total_cmp(&distance(other)));
        vertices.truncate(self.most);
        if vertices.is_empty() || vertices.len() == self.most {
            return vertices;
        }
        let mut places = GrowingGrid::new(map.extent(), APART_M, &vertices);
        let mut rng = ChaCha8Rng::seed_from_u64(SEED);
        let mut scratch = MoveScratch::default();
        for _ in 0..TRIES * (self.most - vertices.len()) {
            let point = vertices[rng.random_range(0..vertices.len())] + within_disc(&mut rng, BESIDE_M);
            if !is_within(point) || places.within(point, APART_M).any(|(_, other)| other.distance(point) < APART_M) {
                continue;
            }
            if let Some(floor) = navigable::room_at(map, profile, point, RISE_M, &mut scratch) {
                places.push(floor);
            }
            if places.points().len() == self.most {
                break;
            }
        }
        places.points().to_vec()
    }
}

/// A point on the plane within `radius` metres of the origin.
fn within_disc(rng: &mut ChaCha8Rng, radius: f32) -> Vec3 {
    let (sin, cos) = libm::sincosf(rng.random_range(0.0..std::f32::consts::TAU));
    let distance = radius * rng.random_range(0.0..1.0_f32).sqrt();
    Vec3::new(distance * cos, 0.0, distance * sin)
}

/// Who must see a place, and who must not.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sight {
    /// Eyes from which a body at the place is hidden, m.
    pub hidden_from: Vec<Vec3>,
    /// Eyes that a body at the place sees, m.
    pub sees: Vec<Vec3>,
}

impl Sight {
    /// Whether every place fits.
    pub fn is_free(&self) -> bool {
        self.hidden_from.is_empty() && self.sees.is_empty()
    }

    /// Whether a body fits whose eyes are at `eye`, m: a ray between two eyes decides whether they see each other.
    /// Movers and bodies hide nothing.
    pub fn fits(&self, mesh: &Mesh, eye: Vec3) -> bool {
        self.sees.iter().all(|&other| mesh.is_in_sight(other, eye))
            && !self.hidden_from.iter().any(|&other| mesh.is_in_sight(other, eye))
    }
}
