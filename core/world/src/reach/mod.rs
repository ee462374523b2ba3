//! The survey of a map: the places that a character can reach by geometry and ballistics, without a policy.
//!
//! [`ground`] finds every place to stand on a fine grid and joins the places into *islands* by walking. [`leap`]
//! simulates a body, tick by tick, that runs off a ledge, jumps, or is thrown by a pad. This module finds directed
//! *links* between islands, each by a simulated leap or ride or by a mover beside both islands.
//!
//! The result is conservative: a jump counts only if a scripted body made it.

pub mod ground;
pub mod leap;
mod limits;
pub mod links;
mod play_area;
mod rides;

use crate::character::CharacterProfile;
use crate::map::CollisionMap;
use crate::parallel::with_threads;
use ground::Ground;
use limits::JumpLimits;
use petgraph::algo::kosaraju_scc;
use petgraph::graph::{DiGraph, NodeIndex};
use petgraph::visit::{Dfs, EdgeRef, IntoNeighbors, NodeCount, Reversed, Visitable};
pub use play_area::PlayArea;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use strum::{IntoStaticStr, VariantArray};

/// The move or mover that a link needs.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, VariantArray, IntoStaticStr,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Means {
    /// Walking off a ledge.
    Drop,
    /// One jump.
    Jump,
    /// A second jump in the air.
    DoubleJump,
    /// A jump pad.
    Pad,
    /// A zip line.
    ZipLine,
    /// A teleporter.
    Teleporter,
    /// A jetpack.
    Jetpack,
    /// A ladder, a net, or a wall that can be climbed.
    Climb,
    /// Swimming, also below what reaches into the water.
    Swim,
    /// A dash in the air.
    Dash,
    /// A run along a wall.
    WallRun,
    /// A move of the body's own.
    OwnMove,
    /// A ride on a lift or platform, or a walk over a floor or conveyor.
    Mover,
}

impl Means {
    /// All means, the least demanding first.
    pub const ALL: &[Means] = Self::VARIANTS;

    /// Lower-case name as used in reports.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// A directed link from one island to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Link {
    /// Index of the island that the link leaves.
    pub from: u32,
    /// Index of the island that the link reaches.
    pub to: u32,
    /// The move or mover that the link needs.
    pub means: Means,
    /// Index of the cell where a character leaves the first island, or the cell nearest to the device that it uses.
    pub takeoff: u32,
    /// Index of the cell where it arrives.
    pub landing: u32,
}

/// The ground of a map with all links between its islands.
#[derive(Debug)]
pub struct Reach {
    /// Places to stand and the islands that they form.
    pub ground: Ground,
    /// Links between islands, sorted; at most one for each pair of islands and means.
    pub links: Vec<Link>,
}

/// Islands or regions, and the ways from one to another.
pub type IslandGraph = DiGraph<(), ()>;

/// Number of random starts of an estimate.
const START_COUNT: usize = 1000;

impl Reach {
    /// Surveys `map` for characters of `profile`, with jumps of up to 10 m; the result does not depend on
    /// `thread_count`.
    pub fn survey(map: &CollisionMap, profile: &CharacterProfile, thread_count: usize) -> Self {
        Self::survey_with(map, profile, thread_count, &JumpLimits::usual())
    }

    /// Like [`survey`](Self::survey), but tries more jumps, as far and as high as the body can jump. Takes longer.
    pub fn survey_far(map: &CollisionMap, profile: &CharacterProfile, thread_count: usize) -> Self {
        Self::survey_with(map, profile, thread_count, &JumpLimits::far(profile))
    }

    /// Surveys a generated map for its repair. Finds the same as earlier versions, which miss walls that are narrower
    /// than a body, so that a seed still generates the same map.
    pub fn survey_for_repair(map: &CollisionMap, profile: &CharacterProfile, thread_count: usize) -> Self {
        Self::survey_with(map, profile, thread_count, &JumpLimits::of_repairs())
    }

    fn survey_with(map: &CollisionMap, profile: &CharacterProfile, thread_count: usize, limits: &JumpLimits) -> Self {
        let (ground, mut links) = with_threads(thread_count, || {
            let ground = Ground::survey(map, profile, limits.obstacles);
            let links = links::find(map, profile, &ground, limits);
            (ground, links)
        });
        links.extend(rides::links(map, profile, &ground));
        links.sort_unstable();
        Self { ground, links }
    }

    /// Share of ordered pairs of places that are connected on foot, without drops or jumps, in [0, 1].
    pub fn share_on_foot(&self) -> f64 {
        let total = self.ground.cells().len() as f64;
        self.ground.islands().iter().map(|island| f64::from(island.cell_count) / total).map(|share| share * share).sum()
    }

    /// Share of ordered pairs of places that are connected by links whose means are `usable`, in [0, 1], estimated from
    /// random starts; 0 if there is no place to stand.
    pub fn share_by(&self, usable: impl Fn(Means) -> bool) -> f64 {
        if self.ground.cells().is_empty() {
            return 0.0;
        }
        let regions = self.regions(usable);
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let cells = self.ground.cells();
        let mut known: Vec<Option<u64>> = vec![None; regions.cell_counts.len()];
        let mut sum = 0.0;
        for _ in 0..START_COUNT {
            let island = cells[rng.random_range(0..cells.len())].island;
            let region = regions.of_island[island as usize];
            let reached = *known[region as usize].get_or_insert_with(|| regions.cells_reachable_from(region));
            sum += reached as f64 / cells.len() as f64;
        }
        sum / START_COUNT as f64
    }

    /// The islands, joined by the links whose means are `usable`.
    pub fn graph(&self, usable: impl Fn(Means) -> bool) -> IslandGraph {
        let links = self.links.iter().filter(|link| usable(link.means));
        let mut graph = IslandGraph::from_edges(links.map(|link| (link.from, link.to)));
        (graph.node_count()..self.ground.islands().len()).for_each(|_| _ = graph.add_node(()));
        graph
    }

    /// Merges islands that can reach one another over links whose means are `usable`.
    pub fn regions(&self, usable: impl Fn(Means) -> bool) -> Regions {
        let graph = self.graph(usable);
        let regions = kosaraju_scc(&graph);
        let mut of_island = vec![0; graph.node_count()];
        let mut cell_counts = vec![0u64; regions.len()];
        for (region, islands) in regions.iter().enumerate() {
            for island in islands {
                of_island[island.index()] = region as u32;
                cell_counts[region] += u64::from(self.ground.islands()[island.index()].cell_count);
            }
        }
        let ends = graph.edge_references().map(|edge| [edge.source(), edge.target()].map(|it| of_island[it.index()]));
        let ends: BTreeSet<(u32, u32)> = ends.filter(|[from, to]| from != to).map(|[from, to]| (from, to)).collect();
        let mut exits = IslandGraph::with_capacity(regions.len(), ends.len());
        regions.iter().for_each(|_| _ = exits.add_node(()));
        exits.extend_with_edges(ends);
        Regions { of_island, cell_counts, exits }
    }
}

/// Strongly connected regions of a [`Reach`].
#[derive(Debug)]
pub struct Regions {
    /// Region of each island.
    pub of_island: Vec<u32>,
    /// Number of cells in each region.
    pub cell_counts: Vec<u64>,
    exits: IslandGraph,
}

impl Regions {
    /// The region with the most cells.
    pub fn largest(&self) -> u32 {
        (0..self.cell_counts.len() as u32).max_by_key(|&region| self.cell_counts[region as usize]).unwrap_or(0)
    }

    /// For each region, whether it can be reached from `start`; true for `start` itself.
    pub fn reachable_from(&self, start: u32) -> Vec<bool> {
        reached(&self.exits, start)
    }

    /// For each region, whether it can reach `goal`; true for `goal` itself.
    pub fn reaching(&self, goal: u32) -> Vec<bool> {
        reached(Reversed(&self.exits), goal)
    }

    fn cells_reachable_from(&self, start: u32) -> u64 {
        let reached = self.reachable_from(start);
        self.cell_counts.iter().zip(reached).filter_map(|(&count, reached)| reached.then_some(count)).sum()
    }
}

/// For each node, whether the edges of `graph` lead to it from `start`; true for `start` itself.
pub fn reached<G>(graph: G, start: u32) -> Vec<bool>
where
    G: IntoNeighbors<NodeId = NodeIndex> + Visitable<NodeId = NodeIndex> + NodeCount,
{
    let mut reached = vec![false; graph.node_count()];
    let mut search = Dfs::new(graph, NodeIndex::from(start));
    while let Some(node) = search.next(graph) {
        reached[node.index()] = true;
    }
    reached
}
