//! Brings a graph up to date after a local change of its map: only what the change may touch is probed again.
//!
//! Vertices stay where they are, except those that can no longer be stood on. An edge is touched if the box around all
//! ways that its probes took comes near changed geometry; a candidate that failed, if the straight way does. What an NPC
//! merely *sees* of a change from afar may sway it too: such edges keep their evidence, which is the price for probing
//! so little, and live evidence corrects it.

use crate::build::{BuildStats, Builder, Built, find_candidates, untried};
use crate::candidates::Candidate;
use crate::evidence::Evidence;
use crate::graph::{Edge, GraphData, NavGraph};
use crate::ids::VertexId;
use crate::settings::BuildError;
use crate::site::Site;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::sync::atomic::Ordering;
use surefoot_world::character::MoveScratch;
use surefoot_world::{Map, Vec3, navigable};

/// Side of the cells that a change is noted in, m.
const CELL_M: f32 = 1.0;
/// How near to a change a way is touched by it, m: a body's width and some room to dodge.
const MARGIN_M: f32 = 3.0;
/// How far ahead of devices that came, went or changed edges are touched, m.
const DEVICE_M: f32 = 8.0;
/// How much the ground under a vertex may shift before it counts as lost, m.
const SHIFT_M: f32 = 0.3;

/// Where two maps differ: by column of cells, from which height to which.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Change {
    columns: BTreeMap<(i32, i32), (f32, f32)>,
}

impl Change {
    /// Compares geometry triangle by triangle, and devices and pools one by one.
    pub fn between(old: &Map, new: &Map) -> Self {
        let key = |triangle: &surefoot_world::mesh::Triangle| {
            (triangle.corners().map(|corner| corner.to_array().map(f32::to_bits)), triangle.surface() as u8)
        };
        let keys = |map: &Map| map.mesh().triangles().iter().map(key).collect::<HashSet<_>>();
        let (before, after) = (keys(old), keys(new));
        let mut change = Self::default();
        for (map, others) in [(old, &after), (new, &before)] {
            for triangle in map.mesh().triangles().iter().filter(|triangle| !others.contains(&key(triangle))) {
                let [a, b, c] = triangle.corners();
                change.add(a.min(b).min(c), a.max(b).max(c));
            }
        }
        let spots = |map: &Map| -> BTreeSet<Vec<u32>> {
            let placed = map.placed();
            let pads = placed.pads.iter().map(|pad| (pad.centre, [pad.speed, 0.0, 0.0]));
            let lines = placed.zip_lines.iter().map(|line| (line.from, line.path()[2].to_array()));
            let teleporters = placed.teleporters.iter().map(|device| (device.from, device.to.to_array()));
            let jetpacks = placed.jetpacks.iter().map(|jetpack| (jetpack.centre, [jetpack.fuel, 0.0, 0.0]));
            pads.chain(lines)
                .chain(teleporters)
                .chain(jetpacks)
                .map(|(at, rest)| at.to_array().into_iter().chain(rest).map(f32::to_bits).collect())
                .collect()
        };
        let room = Vec3::splat(DEVICE_M);
        for spot in spots(old).symmetric_difference(&spots(new)) {
            let at = Vec3::new(f32::from_bits(spot[0]), f32::from_bits(spot[1]), f32::from_bits(spot[2]));
            change.add(at - room, at + room);
        }
        change
    }

    fn add(&mut self, low: Vec3, high: Vec3) {
        for cell in cells(low, high) {
            let (bottom, top) = self.columns.entry(cell).or_insert((low.y, high.y));
            (*bottom, *top) = (bottom.min(low.y), top.max(high.y));
        }
    }

    /// Whether nothing differs.
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty()
    }

    /// Changed area, m2.
    pub fn area(&self) -> f32 {
        self.columns.len() as f32 * CELL_M * CELL_M
    }

    /// Whether something within the margin of this box differs.
    pub fn touches(&self, low: Vec3, high: Vec3) -> bool {
        let margin = Vec3::splat(MARGIN_M);
        let (low, high) = (low - margin, high + margin);
        cells(low, high)
            .any(|cell| self.columns.get(&cell).is_some_and(|&(bottom, top)| bottom <= high.y && top >= low.y))
    }

    /// Whether anything over or under a place, or within the margin beside it, differs.
    pub fn touches_column(&self, at: Vec3) -> bool {
        let (low, high) = (Vec3::new(at.x, f32::MIN, at.z), Vec3::new(at.x, f32::MAX, at.z));
        self.touches(low, high)
    }

    /// Whether something within the margin of the straight way differs.
    pub fn touches_path(&self, from: Vec3, to: Vec3) -> bool {
        let steps = (from.distance(to) / CELL_M).ceil().max(1.0);
        (0..=steps as usize).any(|step| {
            let at = from + (to - from) * (step as f32 / steps);
            self.touches(at, at)
        })
    }
}

fn cells(low: Vec3, high: Vec3) -> impl Iterator<Item = (i32, i32)> {
    let cell = |value: f32| (value / CELL_M).floor() as i32;
    let (left, right, back, front) = (cell(low.x), cell(high.x), cell(low.z), cell(high.z));
    (back..=front).flat_map(move |row| (left..=right).map(move |column| (column, row)))
}

/// What an update did.
#[derive(Debug, Clone)]
pub struct Updated {
    /// The graph on the new map.
    pub built: Built,
    /// Where the maps differ.
    pub change: Change,
    /// Candidates that were tried again.
    pub retried: u64,
    /// Vertices that can no longer be stood on; they have no edges any more.
    pub lost: Vec<VertexId>,
}

impl Builder<'_> {
    /// Brings `graph`, which the same settings built on `old_map`, up to date with the map of the builder's site.
    ///
    /// # Errors
    /// If `progress.cancel` was set.
    pub fn update(&self, graph: &NavGraph, old_map: &Map) -> Result<Updated, BuildError> {
        let started_s = (self.clock)();
        let change = Change::between(old_map, &self.site.map);
        let vertices: Vec<Vec3> = graph.vertices().map(|vertex| graph.position(vertex)).collect();
        let lost = lost_vertices(&vertices, &change, self.site);
        let known: HashMap<Candidate, Evidence> = graph.edges().map(|edge| (edge.key, edge.evidence)).collect();
        let (candidates, special) = self.candidates_of(&vertices, &known, &lost);
        let is_touched = |key: &Candidate| match known.get(key) {
            Some(evidence) => change.touches(evidence.bounds[0], evidence.bounds[1]),
            None => change.touches_path(vertices[key.from.idx()], vertices[key.to.idx()]),
        };
        let (touched, kept): (Vec<Candidate>, Vec<Candidate>) =
            candidates.iter().partition(|candidate| is_touched(candidate));
        let proving = self.proving(&vertices, &touched);
        let evidence = proving.run(self.settings.probing).ok_or(BuildError::Cancelled)?;
        let proved = touched.iter().zip(&evidence).filter(|(_, evidence)| evidence.proves(self.settings.threshold));
        let edges = kept
            .iter()
            .filter_map(|candidate| Some((candidate, known.get(candidate)?)))
            .chain(proved)
            .map(|(&key, &evidence)| Edge { key, evidence })
            .collect();
        let seconds = (self.clock)() - started_s;
        let stats = BuildStats {
            candidates: candidates.len() as u64,
            special,
            untried: untried(&evidence),
            probes: self.progress.done.load(Ordering::Relaxed),
            placing_s: 0.0,
            probing_s: seconds,
            seconds,
        };
        let data = GraphData { vertices, edges, legs: *graph.legs() };
        let graph = NavGraph::check(data).expect("candidates join vertices");
        Ok(Updated { built: Built { graph, stats }, change, retried: touched.len() as u64, lost })
    }

    /// The candidates of a new build and all edges that there were, without those at `lost` vertices; and how many of them come
    /// from devices and ledges.
    fn candidates_of(
        &self,
        vertices: &[Vec3],
        known: &HashMap<Candidate, Evidence>,
        lost: &[VertexId],
    ) -> (Vec<Candidate>, u64) {
        let (mut candidates, special) = find_candidates(self.site, self.settings, vertices);
        let listed: HashSet<Candidate> = candidates.iter().copied().collect();
        let others: BTreeSet<Candidate> =
            known.keys().copied().filter(|candidate| !listed.contains(candidate)).collect();
        candidates.extend(others);
        candidates.retain(|key| !lost.contains(&key.from) && !lost.contains(&key.to));
        (candidates, special)
    }
}

/// Vertices in changed columns on which the character can no longer stand where it stood.
fn lost_vertices(vertices: &[Vec3], change: &Change, site: &Site) -> Vec<VertexId> {
    let mut scratch = MoveScratch::default();
    (0..)
        .map(VertexId)
        .zip(vertices)
        // At any height: what stands inside a new block is nowhere near its faces.
        .filter(|(_, feet)| change.touches_column(**feet))
        .filter(|(_, feet)| {
            let stands = navigable::stand_at(&site.map, &site.profile, **feet, SHIFT_M, &mut scratch);
            stands.is_none_or(|stands| stands.distance(**feet) > 2.0 * SHIFT_M)
        })
        .map(|(vertex, _)| vertex)
        .collect()
}
