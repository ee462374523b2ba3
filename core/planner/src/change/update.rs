//! Updates a graph after a local change of its map: only candidate edges that the change may affect are probed again.
//!
//! Vertices keep their positions. A vertex where the character can no longer stand loses its edges. An edge is
//! affected if the bounding box of its probes' tracks comes near changed geometry; a candidate that is not an edge,
//! if the straight line between its vertices does. A change that an NPC only *sees* from afar may influence its
//! decisions, too. Such edges keep their evidence until live evidence corrects it. This is the cost of probing so
//! little.

use crate::build::candidates::Candidate;
use crate::build::placement::around;
use crate::build::{BuildStats, Builder, Built, candidates, untried};
use crate::evidence::Evidence;
use crate::graph::{Edge, GraphData, NavGraph};
use crate::grid::GrowingGrid;
use crate::ids::VertexId;
use crate::legs::LegModel;
use crate::ride_stops::RideStops;
use crate::settings::Site;
use crate::settings::{BuildError, BuildSettings};
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use surefoot_world::character::{MoveScratch, OwnMove};
use surefoot_world::map::{Device, Piece};
use surefoot_world::{Aabb, Map, Vec3, navigable};

/// Side of the columns in which changes are recorded, m.
const CELL_M: f32 = 1.0;
/// Distance within which a change affects a track or a line, m: the width of a body and some room to dodge.
const MARGIN_M: f32 = 3.0;
/// Distance within which a device that was added, removed or changed affects edges, m.
const DEVICE_M: f32 = 8.0;
/// Height difference within which a vertex must find ground to stand on, m; it may shift by twice as much in all.
const SHIFT_M: f32 = 0.3;
/// Distance from a change within which vertices are paired again with their nearest neighbours, in mean edge lengths.
const REACH_EDGES: f32 = 4.0;
/// Least value of this distance, m.
const MIN_REACH_M: f32 = 40.0;
/// Least distance of a new vertex from all others, m.
const APART_M: f32 = 1.0;
/// Most vertices that an update adds.
const MAX_NEW: usize = 1024;

/// The difference between two maps: a range of heights for each column that has changed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Change {
    columns: BTreeMap<(i32, i32), (f32, f32)>,
    /// A box around all columns; `None` without a change.
    bounds: Option<Aabb>,
}

impl Change {
    /// Compares two maps: all triangles, devices and movers.
    pub fn between(old: &Map, new: &Map) -> Self {
        if old.built_hash() == new.built_hash() {
            return Self::of_pieces(old.pieces(), new.pieces());
        }
        let key = |triangle: &surefoot_world::mesh::Triangle| {
            (triangle.corners().map(|corner| corner.to_array().map(f32::to_bits)), triangle.surface() as u8)
        };
        let keys = |map: &Map| map.mesh().triangles().iter().map(key).collect::<HashSet<_>>();
        let (before, after) = (keys(old), keys(new));
        let mut change = Self::default();
        for (map, others) in [(old, &after), (new, &before)] {
            for triangle in map.mesh().triangles().iter().filter(|triangle| !others.contains(&key(triangle))) {
                change.add(triangle.bounds().into());
            }
        }
        let spots = |map: &Map| -> BTreeSet<Vec<u32>> {
            let bits = |it: Device| it.numbers().map(f32::to_bits).chain([it.kind as u32]).collect::<Vec<u32>>();
            map.placed().devices().map(bits).collect()
        };
        for (map, other) in [(old, new), (new, old)] {
            for mover in map.movers().iter().filter(|mover| !other.movers().contains(mover)) {
                (0..mover.stops.len()).for_each(|stop| change.add(mover.bounds_at(stop).into()));
            }
        }
        for spot in spots(old).symmetric_difference(&spots(new)) {
            let at = Vec3::new(f32::from_bits(spot[0]), f32::from_bits(spot[1]), f32::from_bits(spot[2]));
            change.add(Aabb::at(at).widened(DEVICE_M));
        }
        change
    }

    /// Compares the pieces on one map.
    fn of_pieces(old: &[Piece], new: &[Piece]) -> Self {
        let mut change = Self::default();
        for (pieces, others) in [(old, new), (new, old)] {
            let changed = pieces.iter().filter(|piece| !others.contains(piece));
            changed.for_each(|piece| change.add(piece.bounds().into()));
        }
        change
    }

    fn add(&mut self, changed: Aabb) {
        self.bounds = Some(self.bounds.map_or(changed, |bounds| bounds.union(changed)));
        let Aabb { low, high } = changed;
        for cell in cells(changed) {
            let (bottom, top) = self.columns.entry(cell).or_insert((low.y, high.y));
            (*bottom, *top) = (bottom.min(low.y), top.max(high.y));
        }
    }

    /// Returns whether the maps are equal.
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty()
    }

    /// Returns the area of the columns that have changed, m2.
    pub fn area(&self) -> f32 {
        self.columns.len() as f32 * CELL_M * CELL_M
    }

    /// Returns whether anything differs within the margin of this box.
    pub fn touches(&self, area: Aabb) -> bool {
        let area = area.widened(MARGIN_M);
        let Some(bounds) = self.bounds.filter(|bounds| bounds.touches(area)) else { return false };
        let is_touched = |&(bottom, top): &(f32, f32)| bottom <= area.high.y && top >= area.low.y;
        // Bounds in a file may be as large as numbers get: the search is limited to the part around the change.
        let (near, far) = (area.low.max(bounds.low), area.high.min(bounds.high));
        let (left, right, back, front) = (cell(near.x), cell(far.x), cell(near.z), cell(far.z));
        (left..=right)
            .any(|column| self.columns.range((column, back)..=(column, front)).any(|(_, heights)| is_touched(heights)))
    }

    /// Returns whether the box around all that differs touches `area`.
    fn is_near(&self, area: Aabb) -> bool {
        self.bounds.is_some_and(|bounds| bounds.touches(area))
    }

    /// Returns whether anything differs at any height above or below `at`, within the margin to each side.
    pub fn touches_column(&self, at: Vec3) -> bool {
        self.touches(Aabb { low: Vec3::new(at.x, f32::MIN, at.z), high: Vec3::new(at.x, f32::MAX, at.z) })
    }

    /// Returns whether anything differs within the margin of the straight line between two positions.
    pub fn touches_path(&self, from: Vec3, to: Vec3) -> bool {
        if !self.is_near(Aabb::at(from).union(Aabb::at(to)).widened(MARGIN_M)) {
            return false;
        }
        let steps = (from.distance(to) / CELL_M).ceil().max(1.0);
        (0..=steps as usize).any(|step| self.touches(Aabb::at(from + (to - from) * (step as f32 / steps))))
    }
}

fn cell(metres: f32) -> i32 {
    (metres / CELL_M).floor() as i32
}

/// Iterates over the columns that a box touches.
fn cells(Aabb { low, high }: Aabb) -> impl Iterator<Item = (i32, i32)> {
    let (left, right, back, front) = (cell(low.x), cell(high.x), cell(low.z), cell(high.z));
    (back..=front).flat_map(move |row| (left..=right).map(move |column| (column, row)))
}

/// Result of an update.
#[derive(Debug, Clone)]
pub struct Updated {
    /// The graph on the new map.
    pub built: Built,
    /// Where the maps differ.
    pub change: Change,
    /// Number of candidate edges that the change affects; frugal probing may skip some of them.
    pub retried: u64,
    /// Vertices where the character can no longer stand, in ascending order; they have no edges any more.
    pub lost: Vec<VertexId>,
}

/// A graph that is about to follow a change of its map.
#[derive(Debug)]
pub struct Update {
    change: Change,
    /// The vertices of the graph, and new ones at the end.
    vertices: Vec<Vec3>,
    known_count: usize,
    /// Vertices where the character can no longer stand, in ascending order.
    lost: Vec<VertexId>,
    /// The edges of the graph, in its order.
    edges: Vec<Edge>,
    known: HashMap<Candidate, Evidence>,
    legs: LegModel,
    moves: Arc<[OwnMove]>,
}

impl Update {
    /// Compares the map of the site with the one on which `graph` was built.
    pub fn of(graph: &NavGraph, old_map: &Map, site: &Site) -> Self {
        let change = Change::between(old_map, &site.map);
        let mut vertices: Vec<Vec3> = graph.vertices().map(|vertex| graph.position(vertex)).collect();
        let lost = lost_vertices(&vertices, &change, site);
        let known_count = vertices.len();
        add_vertices(&mut vertices, &lost, old_map, site);
        let edges: Vec<Edge> = graph.edges().copied().collect();
        let known = edges.iter().map(|edge| (edge.key, edge.evidence)).collect();
        Self { change, vertices, known_count, lost, edges, known, legs: *graph.legs(), moves: graph.moves().clone() }
    }

    /// The graph without the edges that the change affects. Plans can use it until these have been probed.
    pub fn without_affected_edges(&self) -> NavGraph {
        let data = GraphData {
            vertices: self.vertices.clone(),
            edges: self.kept(),
            legs: self.legs,
            moves: self.moves.clone(),
        };
        NavGraph::check(data).expect("known edges join vertices")
    }

    fn is_lost(&self, key: &Candidate) -> bool {
        [key.from, key.to].iter().any(|end| self.lost.binary_search(end).is_ok())
    }

    fn is_affected(&self, key: &Candidate) -> bool {
        if key.from.idx().max(key.to.idx()) >= self.known_count {
            return true;
        }
        match self.known.get(key) {
            Some(evidence) => evidence.bounds.is_some_and(|bounds| self.change.touches(bounds)),
            None => self.change.touches_path(self.vertices[key.from.idx()], self.vertices[key.to.idx()]),
        }
    }

    /// The edges that the change does not affect.
    fn kept(&self) -> Vec<Edge> {
        let is_kept = |edge: &&Edge| !self.is_lost(&edge.key) && !self.is_affected(&edge.key);
        self.edges.iter().filter(is_kept).copied().collect()
    }

    /// The candidate edges to probe: edges of the graph and candidates of a new build. Also returns the number of the
    /// latter that come from devices and ledges.
    fn affected(&self, site: &Site, settings: &BuildSettings) -> (Vec<Candidate>, u64) {
        let length = |key: &Candidate| self.vertices[key.from.idx()].distance(self.vertices[key.to.idx()]);
        let mean = self.edges.iter().map(|edge| length(&edge.key)).sum::<f32>() / self.edges.len().max(1) as f32;
        let reach = (REACH_EDGES * mean).max(MIN_REACH_M);
        let near = (0..)
            .zip(&self.vertices)
            .filter(|(_, at)| self.change.is_near(Aabb::at(**at).widened(reach)))
            .map(|(idx, _)| idx);
        let (mut candidates, special) = candidates::find_of(near, site, settings, &self.vertices);
        let listed: HashSet<Candidate> = candidates.iter().copied().collect();
        let others: BTreeSet<Candidate> = self.known.keys().copied().filter(|key| !listed.contains(key)).collect();
        candidates.extend(others);
        candidates.retain(|key| !self.is_lost(key) && self.is_affected(key));
        (candidates, special)
    }
}

impl Builder<'_> {
    /// Updates `graph`, which was built on `old_map` with the same settings, to the map of the builder's site.
    ///
    /// # Errors
    /// If `progress.cancel` was set.
    pub fn update(&self, graph: &NavGraph, old_map: &Map) -> Result<Updated, BuildError> {
        let started_s = (self.clock)();
        self.finish_since(started_s, Update::of(graph, old_map, self.site))
    }

    /// Probes the edges that the change of an update affects.
    ///
    /// # Errors
    /// If `progress.cancel` was set.
    pub fn finish(&self, update: Update) -> Result<Updated, BuildError> {
        self.finish_since((self.clock)(), update)
    }

    fn finish_since(&self, started_s: f64, update: Update) -> Result<Updated, BuildError> {
        let (affected, special) = update.affected(self.site, self.settings);
        let prover = self.prover(&update.vertices, &affected);
        let evidence = prover.run(self.settings.probing)?;
        let proved = affected.iter().zip(&evidence).filter(|(_, evidence)| evidence.proves(self.settings.threshold));
        let mut edges = update.kept();
        let kept_count = edges.len();
        edges.extend(proved.map(|(&key, &evidence)| Edge { key, evidence }));
        let seconds = (self.clock)() - started_s;
        let stats = BuildStats {
            candidates: (kept_count + affected.len()) as u64,
            special,
            untried: untried(&evidence),
            probes: self.progress.done.load(Ordering::Relaxed),
            placing_s: 0.0,
            probing_s: seconds,
            seconds,
        };
        let Update { change, vertices, lost, legs, moves, .. } = update;
        let data = GraphData { vertices, edges, legs, moves };
        let graph = NavGraph::check(data).expect("candidates join vertices");
        Ok(Updated { built: Built { graph, stats }, change, retried: affected.len() as u64, lost })
    }
}

/// Adds vertices around and on top of the pieces that are new on the map of the site.
fn add_vertices(vertices: &mut Vec<Vec3>, lost: &[VertexId], old_map: &Map, site: &Site) {
    let mut scratch = MoveScratch::default();
    let known_count = vertices.len();
    let mut grid = GrowingGrid::new(site.map.extent(), APART_M, vertices);
    for piece in site.map.pieces().iter().filter(|piece| !old_map.pieces().contains(piece)) {
        for spot in around::spots(piece, &site.profile) {
            let feet = navigable::stand_at(&site.map, &site.profile, spot, around::RISE_M, &mut scratch);
            let Some(feet) = feet.filter(|_| vertices.len() < known_count + MAX_NEW) else { continue };
            let is_lost = |vertex: u32| lost.binary_search(&VertexId(vertex)).is_ok();
            let is_taken =
                grid.within(feet, APART_M).any(|(vertex, at)| at.distance(feet) < APART_M && !is_lost(vertex));
            if !is_taken {
                vertices.push(feet);
                grid.push(feet);
            }
        }
    }
}

/// Returns the vertices in changed columns where the character can no longer stand.
fn lost_vertices(vertices: &[Vec3], change: &Change, site: &Site) -> Vec<VertexId> {
    let mut scratch = MoveScratch::default();
    let ride_stops = RideStops::on(&site.map, &site.profile);
    (0..)
        .map(VertexId)
        .zip(vertices)
        // At any height: a vertex inside a new block may be far from the block's faces.
        .filter(|(_, feet)| change.touches_column(**feet) && ride_stops.at(**feet).is_none())
        .filter(|(_, feet)| {
            let stands = navigable::stand_at(&site.map, &site.profile, **feet, SHIFT_M, &mut scratch);
            stands.is_none_or(|stands| stands.distance(**feet) > 2.0 * SHIFT_M)
        })
        .map(|(vertex, _)| vertex)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn change(boxes: &[Aabb]) -> Change {
        let mut change = Change::default();
        boxes.iter().for_each(|changed| change.add(*changed));
        change
    }

    fn boxes() -> impl Strategy<Value = Aabb> {
        let corner = (-20.0..20.0f32, 0.0..9.0f32, -20.0..20.0f32);
        let size = (0.0..6.0f32, 0.0..6.0f32, 0.0..6.0f32);
        (corner, size).prop_map(|((x, y, z), (width, height, depth))| {
            let low = Vec3::new(x, y, z);
            Aabb { low, high: low + Vec3::new(width, height, depth) }
        })
    }

    proptest! {
        #![proptest_config(crate::properties::cases(300))]

        #[test]
        fn a_box_is_touched_if_any_of_its_columns_is(changed in prop::collection::vec(boxes(), 0..5), area in boxes()) {
            let change = change(&changed);
            let wide = area.widened(MARGIN_M);
            let touched = cells(wide).any(|cell| {
                change.columns.get(&cell).is_some_and(|&(bottom, top)| bottom <= wide.high.y && top >= wide.low.y)
            });
            prop_assert_eq!(change.touches(area), touched && change.is_near(wide));
        }
    }

    #[test]
    fn boxes_as_large_as_numbers_get_are_answered() {
        let boxes = [[Vec3::ZERO, Vec3::splat(30.0)], [Vec3::splat(900.0), Vec3::splat(950.0)]];
        let change = change(&boxes.map(|[low, high]| Aabb { low, high }));
        let between = |low: f32, high: f32| Aabb { low: Vec3::MIN.with_y(low), high: Vec3::MAX.with_y(high) };
        assert!(change.touches(between(f32::MIN, f32::MAX)));
        assert!(!change.touches(between(100.0, 200.0)), "between the two in height");
        assert!(!Change::default().touches(between(f32::MIN, f32::MAX)));
    }
}
