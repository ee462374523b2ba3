//! Which goals are reachable: the truth against which attempts are measured.
//!
//! The survey knows islands of ground on a grid, and leaps between them; the graph's edges are proved. Places that the
//! grid misses, such as narrow ledges, are joined to what is near them by leaps of the same scripted body.

use std::collections::HashMap;
use surefoot_planner::Router;
use surefoot_rollout::Goal;
use surefoot_world::character::MoveScratch;
use surefoot_world::reach::ground::walks_straight;
use surefoot_world::reach::leap::{self, Leap};
use surefoot_world::reach::{IslandGraph, PlayArea, Reach, reached};
use surefoot_world::{CharacterProfile, Map, Vec3};

/// Distance within which a place off the grid is joined to others, m.
const NEAR_M: f32 = 4.0;
/// Distance from a place within which a leap counts as arrived, m.
const THERE_M: f32 = 0.8;
/// Number of cells of each island between which and a place leaps are tried, the nearest first.
const CELLS_EACH: usize = 4;

/// A map, and what a character can reach on it.
pub(crate) struct Terrain<'a> {
    pub map: &'a Map,
    pub profile: &'a CharacterProfile,
    pub reach: &'a Reach,
}

impl Terrain<'_> {
    /// The island of ground to which a walk leads from a place.
    fn island(&self, place: Vec3, scratch: &mut MoveScratch) -> Option<u32> {
        let ground = &self.reach.ground;
        ground.walk_from(self.map, self.profile, place, scratch).map(|idx| ground.cells()[idx].island)
    }
}

/// Whether links of the survey, proved edges and leaps beside places off the grid lead from each start to its goal.
pub(crate) fn reachable(terrain: &Terrain<'_>, router: Option<&Router>, goals: &[Goal]) -> Vec<bool> {
    let mut nodes = Nodes::new(terrain);
    if let Some(graph) = router.map(Router::graph) {
        let of_vertex: Vec<u32> = graph.vertices().map(|vertex| nodes.of(graph.position(vertex))).collect();
        for edge in graph.edges() {
            let (from, to) = (of_vertex[edge.key.from.idx()], of_vertex[edge.key.to.idx()]);
            nodes.graph.add_edge(from.into(), to.into(), ());
        }
    }
    let pairs: Vec<(u32, u32)> = goals.iter().map(|goal| (nodes.of(goal.start), nodes.of(goal.goal))).collect();
    nodes.join();
    let mut floods: HashMap<u32, Vec<bool>> = HashMap::new();
    pairs
        .into_iter()
        .map(|(from, to)| floods.entry(from).or_insert_with(|| reached(&nodes.graph, from))[to as usize])
        .collect()
}

/// Whether start and goal are on the same island of ground, where a walk connects all places.
pub(crate) fn is_on_foot(terrain: &Terrain<'_>, goal: &Goal) -> bool {
    let mut scratch = MoveScratch::default();
    let [start, end] = [goal.start, goal.goal].map(|place| terrain.island(place, &mut scratch));
    start.is_some() && start == end
}

/// The playable area of a map: the ground that a body can leave and come back to, around the map's spawn points or
/// the largest.
pub(crate) struct PlayableArea<'a> {
    terrain: &'a Terrain<'a>,
    area: PlayArea,
    /// Share of the ground, 0 to 1.
    pub share: f64,
}

impl<'a> PlayableArea<'a> {
    pub fn of(terrain: &'a Terrain<'a>) -> Self {
        let area = PlayArea::of(terrain.map, terrain.profile, terrain.reach);
        let cells = terrain.reach.ground.cells();
        let held = cells.iter().filter(|cell| area.holds(cell.island)).count();
        Self { terrain, area, share: held as f64 / cells.len().max(1) as f64 }
    }

    /// Whether a place belongs to the area.
    pub fn contains(&self, place: Vec3, scratch: &mut MoveScratch) -> bool {
        self.terrain.island(place, scratch).is_some_and(|island| self.area.holds(island))
    }
}

/// Islands, followed by places off the grid, and the ways from one to another.
struct Nodes<'a> {
    terrain: &'a Terrain<'a>,
    graph: IslandGraph,
    /// Places off the grid, in the order of their nodes.
    places: Vec<Vec3>,
    scratch: MoveScratch,
}

impl<'a> Nodes<'a> {
    fn new(terrain: &'a Terrain<'a>) -> Self {
        Self { terrain, graph: terrain.reach.graph(|_| true), places: Vec::new(), scratch: MoveScratch::default() }
    }

    /// The node of a place: its island, or a node of its own.
    fn of(&mut self, place: Vec3) -> u32 {
        if let Some(island) = self.terrain.island(place, &mut self.scratch) {
            return island;
        }
        self.places.push(place);
        self.graph.add_node(()).index() as u32
    }

    /// Joins places off the grid to what is near them.
    fn join(&mut self) {
        let first = (self.graph.node_count() - self.places.len()) as u32;
        let mut scratch = MoveScratch::default();
        for (idx, &place) in self.places.iter().enumerate() {
            let node = first + idx as u32;
            let others = (first..).zip(&self.places).skip(idx + 1).map(|(node, place)| (node, *place));
            let near = others.filter(|(_, other)| other.distance(place) < NEAR_M);
            for (other, at) in near.chain(self.cells_near(place)).collect::<Vec<_>>() {
                if leads(self.terrain, place, at, &mut scratch) {
                    self.graph.add_edge(node.into(), other.into(), ());
                }
                if leads(self.terrain, at, place, &mut scratch) {
                    self.graph.add_edge(other.into(), node.into(), ());
                }
            }
        }
    }

    /// The nearest cells of each island near a place, with the islands.
    fn cells_near(&self, place: Vec3) -> Vec<(u32, Vec3)> {
        let ground = &self.terrain.reach.ground;
        let (column, row) = ground.column_of(place);
        let span = (NEAR_M / surefoot_world::reach::ground::SPACING_M).ceil() as i32;
        let columns = (-span..=span).flat_map(|x| (-span..=span).map(move |z| (column + x, row + z)));
        let cells = columns.flat_map(|(column, row)| &ground.cells()[ground.column(column, row)]);
        let mut near: Vec<(f32, u32, Vec3)> =
            cells.map(|cell| (cell.feet.distance(place), cell.island, cell.feet)).filter(|it| it.0 < NEAR_M).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut taken: HashMap<u32, usize> = HashMap::new();
        near.retain(|(_, island, _)| {
            let count = taken.entry(*island).or_default();
            *count += 1;
            *count <= CELLS_EACH
        });
        near.into_iter().map(|(_, island, feet)| (island, feet)).collect()
    }
}

/// Whether a scripted body gets from one place to another near it, or so near that it can walk on.
fn leads(Terrain { map, profile, .. }: &Terrain<'_>, from: Vec3, to: Vec3, scratch: &mut MoveScratch) -> bool {
    let double = (profile.extra_jumps > 0).then_some(Leap::DoubleJump);
    let mut leaps = [Some(Leap::Jump), Some(Leap::Run), double].into_iter().flatten();
    walks_straight(map, profile, from, to, scratch)
        || leaps.any(|leap| {
            let landed = leap::land(map, profile, from, to, leap, scratch);
            landed.is_some_and(|at| at.distance(to) < THERE_M && walks_straight(map, profile, at, to, scratch))
        })
}
