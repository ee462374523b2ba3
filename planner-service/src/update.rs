//! Brings a graph up to date after a local change of its map: only what the change may touch is probed again.
//!
//! Vertices stay where they are, except those that can no longer be stood on. An edge is touched if the box around all
//! ways that its probes took comes near changed geometry; a candidate that failed, if the straight way does. What an NPC
//! merely *sees* of a change from afar may sway it too: such edges keep their evidence, which is the price for probing
//! so little, and live evidence corrects it.

use crate::build::{BuildError, BuildSettings, BuildStats, Built, Progress, find_candidates};
use crate::candidates::Candidate;
use crate::graph::{Edge, Evidence, GraphData, NavGraph};
use crate::probe::{InProcess, ProbeContext};
use crate::prove::Proving;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::sync::atomic::Ordering;
use std::time::Instant;
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
    pub fn touches_way(&self, from: Vec3, to: Vec3) -> bool {
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
    pub lost: Vec<u32>,
}

/// Brings `graph`, which `settings` built on `old_map`, up to date with the map of `context`.
///
/// # Errors
/// If a setting is out of range, or `progress.cancel` was set.
pub fn update(
    graph: &NavGraph,
    old_map: &Map,
    context: &ProbeContext,
    settings: &BuildSettings,
    thread_count: usize,
    progress: &Progress,
) -> Result<Updated, BuildError> {
    settings.validate()?;
    let started = Instant::now();
    let change = Change::between(old_map, &context.map);
    let vertices: Vec<Vec3> = (0..graph.vertex_count() as u32).map(|vertex| graph.position(vertex)).collect();
    let lost = lost_vertices(&vertices, &change, context);
    let known: HashMap<Candidate, Evidence> = graph.edges().map(|edge| ((edge.from, edge.to), edge.evidence)).collect();
    let (mut candidates, special) = find_candidates(context, settings, &vertices);
    let listed: HashSet<Candidate> = candidates.iter().copied().collect();
    let others: BTreeSet<Candidate> = known.keys().copied().filter(|candidate| !listed.contains(candidate)).collect();
    candidates.extend(others);
    candidates.retain(|(from, to)| !lost.contains(from) && !lost.contains(to));
    let is_touched = |&(from, to): &Candidate| match known.get(&(from, to)) {
        Some(evidence) => change.touches(evidence.bounds[0], evidence.bounds[1]),
        None => change.touches_way(vertices[from as usize], vertices[to as usize]),
    };
    let (touched, kept): (Vec<Candidate>, Vec<Candidate>) =
        candidates.iter().partition(|candidate| is_touched(candidate));
    let proving = Proving {
        map: &context.map,
        vertices: &vertices,
        candidates: &touched,
        repeats: settings.repeats,
        seed: settings.seed,
        thread_count,
        executor: &InProcess { context: context.clone(), thread_count },
        progress: &progress.done,
        total: &progress.total,
        cancel: &progress.cancel,
    };
    let evidence = proving.run(settings.probing).ok_or(BuildError::Cancelled)?;
    let proved = touched.iter().zip(&evidence).filter(|(_, evidence)| evidence.proves(settings.threshold));
    let edges = kept
        .iter()
        .filter_map(|candidate| Some((candidate, known.get(candidate)?)))
        .chain(proved)
        .map(|(&(from, to), &evidence)| Edge { from, to, evidence })
        .collect();
    let seconds = started.elapsed().as_secs_f64();
    let stats = BuildStats {
        candidates: candidates.len() as u64,
        special,
        untried: evidence.iter().filter(|evidence| evidence.tries == 0).count() as u64,
        probes: progress.done.load(Ordering::Relaxed),
        placing_s: 0.0,
        probing_s: seconds,
        seconds,
    };
    let graph = NavGraph::check(GraphData { vertices, edges, legs: *graph.legs() }).expect("candidates join vertices");
    Ok(Updated { built: Built { graph, stats }, change, retried: touched.len() as u64, lost })
}

/// Vertices in changed columns on which the character can no longer stand where it stood.
fn lost_vertices(vertices: &[Vec3], change: &Change, context: &ProbeContext) -> Vec<u32> {
    let mut scratch = MoveScratch::default();
    (0..)
        .zip(vertices)
        // At any height: what stands inside a new block is nowhere near its faces.
        .filter(|(_, feet)| change.touches_column(**feet))
        .filter(|(_, feet)| {
            let stands = navigable::stand_at(&context.map, &context.profile, **feet, SHIFT_M, &mut scratch);
            stands.is_none_or(|stands| stands.distance(**feet) > 2.0 * SHIFT_M)
        })
        .map(|(vertex, _)| vertex)
        .collect()
}
