//! Traffic: where NPCs that get in each other's way are about to be, and what waiting for them costs.
//!
//! Each NPC counts once in each square of 2 m that the next stretch of its plan passes. So a door that many plans lead through is crowded,
//! whichever edges they use. Who meets a crowd waits until it has passed, one after another, or goes around all of it, to another door, if
//! that takes less time: a step aside gains nothing. Crowds are counted in steps, and an NPC on its way keeps its plan, so that crowds do
//! not swing from one way to another.

use crate::adjacency::{Adjacency, EdgeIdx};
use crate::evidence::EdgeCosts;
use crate::graph::NavGraph;
use crate::plan::Plan;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use surefoot_world::{Decisions, Vec3};

/// Side of a square, m, and how high it reaches.
const SQUARE_M: f32 = 2.0;
const STOREY_M: f32 = 4.0;
/// Length of the way on which an NPC counts, m: what it covers in about 5 s.
const AHEAD_M: f32 = 40.0;
/// Distance between two places of a way that are looked at, m.
const STRIDE_M: f32 = 1.0;
/// Squares on each side of one that belong to the same crowd: whoever goes around a crowd goes around all of them.
const AROUND: i32 = 1;
/// NPCs in a square that do not delay each other.
const FREE: u32 = 8;
/// Crowds are counted in steps of this many NPCs.
const STEP: u32 = 8;
/// Time for which each further NPC delays those behind it, decisions: about nine pass a door of 1.2 m in a second.
const HEADWAY_DECISIONS: f64 = 0.66;

/// A square, and its storey.
type Square = (i32, i32, i32);

fn square(place: Vec3) -> Square {
    // No map is so large; places far outside share the last square.
    let number = |metres: f32, side: f32| (metres / side).floor().clamp(-1.0e6, 1.0e6) as i32;
    (number(place.x, SQUARE_M), number(place.y, STOREY_M), number(place.z, SQUARE_M))
}

/// Calls `pass` with places on the straight lines between `way`'s places, up to `most` metres from the first.
fn walk(way: impl Iterator<Item = Vec3>, most: f32, mut pass: impl FnMut(Vec3)) {
    let mut left = most;
    let mut last: Option<Vec3> = None;
    for place in way {
        let from = last.replace(place).unwrap_or(place);
        let length = from.distance(place).min(left);
        let direction = (place - from).normalize_or_zero();
        for stride in 0..=(length / STRIDE_M) as u32 {
            pass(from + direction * (stride as f32 * STRIDE_M));
        }
        left -= length;
        if left <= 0.0 {
            return;
        }
    }
    if let Some(end) = last {
        pass(end);
    }
}

/// The places to which a plan leads from its leg `leg` on, after the one where the NPC is.
fn way(feet: Vec3, plan: &Plan, leg: usize) -> impl Iterator<Item = Vec3> {
    std::iter::once(feet).chain(plan.waypoints.iter().skip(leg).copied())
}

/// A crowd on the way of a plan.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Met {
    square: Square,
    /// For how long one waits for it.
    pub delay: Decisions,
}

/// How many NPCs are about to be where.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Traffic {
    npcs: BTreeMap<Square, u32>,
}

impl Traffic {
    /// Adds an NPC at `feet`, m, that follows a plan from its leg `leg` on.
    pub fn add_plan(&mut self, feet: Vec3, plan: &Plan, leg: usize) {
        let mut passed = BTreeSet::new();
        walk(way(feet, plan, leg), AHEAD_M, |place| _ = passed.insert(square(place)));
        passed.into_iter().for_each(|square| self.add(square, 1));
    }

    /// Adds a crowd: `npcs` NPCs in the square around `place`, m.
    pub fn add_crowd(&mut self, place: Vec3, npcs: u32) {
        self.add(square(place), npcs);
    }

    fn add(&mut self, square: Square, npcs: u32) {
        let count = self.npcs.entry(square).or_default();
        *count = count.saturating_add(npcs);
    }

    /// The crowds, the largest first: the middle of each one's densest square, m, and the number of NPCs.
    pub fn crowds(&self) -> Vec<(Vec3, u32)> {
        let middle = |&(x, storey, z): &Square| {
            Vec3::new(x as f32 * SQUARE_M, storey as f32 * STOREY_M, z as f32 * SQUARE_M)
                + Vec3::new(0.5 * SQUARE_M, 0.5 * STOREY_M, 0.5 * SQUARE_M)
        };
        let mut crowds: Vec<(Vec3, u32)> = self.densest().map(|(square, npcs)| (middle(square), *npcs)).collect();
        crowds.sort_by_key(|(_, npcs)| std::cmp::Reverse(*npcs));
        crowds
    }

    /// The largest crowd that an NPC at `feet`, m, meets on a plan.
    pub(crate) fn met_by(&self, feet: Vec3, plan: &Plan) -> Option<Met> {
        let mut met: Option<(u32, Square)> = None;
        walk(way(feet, plan, 0), AHEAD_M, |place| {
            let square = square(place);
            let npcs = self.npcs.get(&square).copied().unwrap_or(0);
            if met.is_none_or(|(most, _)| npcs > most) {
                met = Some((npcs, square));
            }
        });
        let (npcs, square) = met?;
        delay(npcs).map(|delay| Met { square, delay })
    }

    /// The squares in which crowds are densest, with their NPCs.
    fn densest(&self) -> impl Iterator<Item = (&Square, &u32)> {
        self.npcs.iter().filter(|(square, npcs)| delay(**npcs).is_some() && self.is_densest(**square, **npcs))
    }

    /// Whether no square around has more NPCs; of equal ones the first counts.
    fn is_densest(&self, square: Square, npcs: u32) -> bool {
        around(square).filter(|other| *other != square).all(|other| {
            let others = self.npcs.get(&other).copied().unwrap_or(0);
            others < npcs || (others == npcs && other > square)
        })
    }
}

/// The squares within [`AROUND`] of one.
fn around((x, storey, z): Square) -> impl Iterator<Item = Square> {
    (-AROUND..=AROUND).flat_map(move |dx| (-AROUND..=AROUND).map(move |dz| (x + dx, storey, z + dz)))
}

/// Time that an NPC waits for a crowd; `None` if that is too small to delay anybody.
fn delay(npcs: u32) -> Option<Decisions> {
    let steps = npcs.saturating_sub(FREE) / STEP;
    (steps > 0).then(|| Decisions(f64::from(steps) * f64::from(STEP) * HEADWAY_DECISIONS))
}

/// The edges that pass each square.
#[derive(Debug)]
pub(crate) struct Passing(HashMap<Square, Vec<EdgeIdx>>);

impl Passing {
    pub fn new(graph: &NavGraph, adjacency: &Adjacency) -> Self {
        let mut edges: HashMap<Square, Vec<EdgeIdx>> = HashMap::new();
        for vertex in graph.vertices() {
            for (edge, to, _) in adjacency.outgoing(vertex) {
                let ends = [graph.position(vertex), graph.position(to)];
                walk(ends.into_iter(), f32::INFINITY, |place| {
                    let passing = edges.entry(square(place)).or_default();
                    if passing.last() != Some(&edge) {
                        passing.push(edge);
                    }
                });
            }
        }
        Self(edges)
    }

    /// `costs` with the delay of a crowd on every edge that passes it: a path with these costs goes around it if it can in less time.
    pub fn delayed(&self, adjacency: &Adjacency, met: Met, costs: &EdgeCosts) -> EdgeCosts {
        let passing: BTreeSet<&EdgeIdx> =
            around(met.square).filter_map(|square| self.0.get(&square)).flatten().collect();
        let mut costs = costs.clone();
        for &edge in passing {
            let key = adjacency.key(edge);
            let cost = costs.get(&key).copied().unwrap_or_else(|| adjacency.cost(edge));
            costs.insert(key, cost.delayed(met.delay));
        }
        costs
    }
}
