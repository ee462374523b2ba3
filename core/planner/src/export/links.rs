//! Selects the edges that a NavMesh needs as off-mesh links: edges that join places it cannot join, and edges that save
//! much time.
//!
//! The selection is a greedy spanner (Althöfer et al. 1993, "On Sparse Spanners of Weighted Graphs") on top of the
//! NavMesh's own connections: links are considered from the fastest to the slowest, and each is kept unless the
//! connections so far lead to the same place nearly as fast.

use crate::graph::{Edge, NavGraph};
use crate::grid::PointGrid;
use crate::ids::{EdgeKey, VertexId};
use crate::search::frontier::Frontier;
use std::collections::{BTreeMap, BTreeSet};
use surefoot_world::{Ability, DECISION_SECONDS, Vec3};

/// A NavMesh: its connectivity and the properties of its agents.
#[derive(Debug, Clone, Copy)]
pub struct NavMesh<'a> {
    /// Radius of the agents, m.
    pub radius: f32,
    /// Speed of the agents, m/s.
    pub speed: f32,
    /// Island of the NavMesh that each vertex lies on; `None` for vertices off the NavMesh.
    pub islands: &'a [Option<u32>],
}

/// Default for the greatest ratio of another route's duration to a link's at which the link is left out.
pub const DEFAULT_MAX_DETOUR: f64 = 3.0;
/// Ratio of the length of a route on foot to the straight-line distance.
const FOOT_DETOUR: f32 = 1.5;
/// Number of nearest vertices on the same island to which each vertex is connected on foot.
const FOOT_NEIGHBOURS: usize = 8;
/// Vertices in a column of the grid in which the nearest ones are looked up.
const VERTICES_PER_COLUMN: f32 = 2.0;
/// Greatest descent of an edge on foot that is not a drop, m; a NavMesh does not take drops.
const STEP_M: f32 = 0.5;
/// Greatest slope of a longer descent that is not a drop.
const SLOPE: f32 = 1.0;

impl NavMesh<'_> {
    /// Returns whether the NavMesh cannot take an edge by itself: the edge leaves its island, needs an ability other
    /// than walking, or drops.
    pub fn needs_link(&self, graph: &NavGraph, edge: &Edge) -> bool {
        let (from, to) = (self.islands[edge.key.from.idx()], self.islands[edge.key.to.idx()]);
        let offset = graph.position(edge.key.to) - graph.position(edge.key.from);
        let is_drop = -offset.y > STEP_M.max(SLOPE * surefoot_world::float::hypot(offset.x, offset.z));
        from.is_none() || from != to || edge.evidence.ability != Ability::WALK || is_drop
    }

    /// Selects the `candidates`, edges with their durations in seconds, that the NavMesh and the other links do not
    /// replace within `max_detour` times their duration.
    pub fn spanner(&self, graph: &NavGraph, candidates: &[(EdgeKey, f64)], max_detour: f64) -> BTreeSet<EdgeKey> {
        let mut routes = self.on_foot(graph);
        let walks = graph.edges().filter(|edge| !self.needs_link(graph, edge));
        walks.for_each(|edge| routes.push(edge.key.from, edge.key.to, expected_seconds(edge)));
        routes.sort();
        let mut candidates = candidates.to_vec();
        candidates.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        let mut kept = BTreeSet::new();
        for (key, seconds) in candidates {
            if !routes.reaches(key.from, key.to, max_detour * seconds) {
                routes.add(key.from, key.to, seconds);
                kept.insert(key);
            }
        }
        kept
    }

    /// Connects the vertices of each island: each with its nearest ones, and all with the one nearest to the island's
    /// centre.
    fn on_foot(&self, graph: &NavGraph) -> Routes {
        let mut routes = Routes::new(graph.vertex_count());
        let mut members: BTreeMap<u32, Vec<VertexId>> = BTreeMap::new();
        for vertex in graph.vertices() {
            if let Some(island) = self.islands[vertex.idx()] {
                members.entry(island).or_default().push(vertex);
            }
        }
        let distance = |a: VertexId, b: VertexId| graph.position(a).distance(graph.position(b));
        let time = |a, b| f64::from(FOOT_DETOUR * distance(a, b) / self.speed);
        for members in members.values() {
            let centre = members.iter().map(|vertex| graph.position(*vertex)).sum::<Vec3>() / members.len() as f32;
            let from_centre = |vertex: &VertexId| graph.position(*vertex).distance(centre);
            let middle = *members.iter().min_by(|a, b| from_centre(a).total_cmp(&from_centre(b))).expect("not empty");
            let places: Vec<Vec3> = members.iter().map(|vertex| graph.position(*vertex)).collect();
            let grid = PointGrid::spread(&places, VERTICES_PER_COLUMN);
            for (idx, &vertex) in (0..).zip(members) {
                let near = grid.nearest(&places, graph.position(vertex), FOOT_NEIGHBOURS, |other| other != idx);
                for other in near.into_iter().map(|other| members[other as usize]).chain([middle]) {
                    routes.push(vertex, other, time(vertex, other));
                    routes.push(other, vertex, time(vertex, other));
                }
            }
        }
        routes
    }
}

/// Returns the cost of an edge in seconds: the expected duration with the cost of failures, plus a term for risk, times
/// the designers' factor.
pub fn expected_seconds(edge: &Edge) -> f64 {
    edge.evidence.cost() * f64::from(DECISION_SECONDS)
}

/// The connections so far.
struct Routes {
    /// For each vertex, the vertices that it leads to, with durations in seconds, the nearest first.
    edges: Vec<Vec<(VertexId, f64)>>,
    frontier: Frontier<f64>,
}

impl Routes {
    fn new(vertex_count: usize) -> Self {
        Self { edges: vec![Vec::new(); vertex_count], frontier: Frontier::new(vertex_count) }
    }

    /// Adds a connection; [`sort`](Self::sort) follows.
    fn push(&mut self, from: VertexId, to: VertexId, seconds: f64) {
        self.edges[from.idx()].push((to, seconds));
    }

    fn sort(&mut self) {
        self.edges.iter_mut().for_each(|edges| edges.sort_by(|a, b| a.1.total_cmp(&b.1)));
    }

    /// Adds a connection, keeping the order.
    fn add(&mut self, from: VertexId, to: VertexId, seconds: f64) {
        let edges = &mut self.edges[from.idx()];
        edges.insert(edges.partition_point(|edge| edge.1.total_cmp(&seconds).is_lt()), (to, seconds));
    }

    /// Returns whether there is a route of at most `limit` seconds.
    fn reaches(&mut self, from: VertexId, to: VertexId, limit: f64) -> bool {
        self.frontier.clear();
        self.frontier.offer(from.0, 0.0);
        while let Some((vertex, after)) = self.frontier.settle(limit) {
            if vertex == to.0 {
                return true;
            }
            // The middle of an island leads to all of it: the search skips vertices that are too far away.
            let near = self.edges[vertex as usize].iter().map(|&(next, seconds)| (next, after + seconds));
            for (next, then) in near.take_while(|(_, then)| *then <= limit) {
                self.frontier.offer(next.0, then);
            }
        }
        false
    }
}
