//! Which edges a NavMesh needs as off-mesh links: those that join what it cannot join, and those that save much of the time.
//!
//! A greedy spanner (Althöfer et al. 1993, "On Sparse Spanners of Weighted Graphs") over what the NavMesh connects by itself: links are
//! tried from the quickest on, and one is kept only if the others do not lead there nearly as fast.

use crate::graph::{Edge, NavGraph};
use crate::ids::VertexId;
use std::cmp::{Ordering, Reverse};
use std::collections::{BTreeMap, BinaryHeap};
use surefoot_world::{Ability, DECISION_SECONDS, Vec3};

/// What a NavMesh connects by itself, and what its agents are like.
#[derive(Debug, Clone, Copy)]
pub struct NavMesh<'a> {
    /// Radius of its agents, m.
    pub radius: f32,
    /// Speed of its agents, m/s.
    pub speed: f32,
    /// Island on foot of each vertex; none where it has no ground.
    pub islands: &'a [Option<u32>],
}

/// How many times as long as a link another route may take before the link is worth its place.
pub const DEFAULT_MAX_DETOUR: f64 = 3.0;
/// A route on foot is about this much longer than the straight line.
const FOOT_DETOUR: f32 = 1.5;
/// Vertices of its island that each is joined to on foot.
const FOOT_NEIGHBOURS: usize = 8;
/// Fall from which an edge on foot is a drop, which a NavMesh does not take, m.
const STEP_M: f32 = 0.5;
/// Slope beyond which it is one.
const SLOPE: f32 = 1.0;

impl NavMesh<'_> {
    /// Whether an edge is more than a NavMesh does by itself: it leaves its island, takes an ability or drops.
    pub fn needs_link(&self, graph: &NavGraph, edge: &Edge) -> bool {
        let (from, to) = (self.islands[edge.key.from.idx()], self.islands[edge.key.to.idx()]);
        let offset = graph.position(edge.key.to) - graph.position(edge.key.from);
        let is_drop = -offset.y > STEP_M.max(SLOPE * surefoot_world::float::hypot(offset.x, offset.z));
        from.is_none() || from != to || edge.evidence.ability != Ability::Walk || is_drop
    }

    /// The edges that are worth being links, in the order of the graph. `max_detour` is above 1; the smaller it is, the more links.
    pub fn links<'g>(&self, graph: &'g NavGraph, max_detour: f64) -> Vec<&'g Edge> {
        let mut routes = self.on_foot(graph);
        let (mut candidates, walks): (Vec<&Edge>, Vec<&Edge>) =
            graph.edges().partition(|edge| self.needs_link(graph, edge));
        walks.iter().for_each(|edge| routes.add(edge.key.from, edge.key.to, expected_seconds(edge)));
        candidates.sort_by(|a, b| expected_seconds(a).total_cmp(&expected_seconds(b)).then(a.key.cmp(&b.key)));
        let mut kept = Vec::new();
        for edge in candidates {
            if !routes.reaches(edge.key.from, edge.key.to, max_detour * expected_seconds(edge)) {
                routes.add(edge.key.from, edge.key.to, expected_seconds(edge));
                kept.push(edge);
            }
        }
        kept.sort_by_key(|edge| edge.key);
        kept
    }

    /// What is connected within each island: every vertex with its nearest, and all with the one in the middle.
    fn on_foot(&self, graph: &NavGraph) -> Routes {
        let mut routes = Routes { edges: vec![Vec::new(); graph.vertex_count()] };
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
            for &vertex in members {
                let mut others: Vec<VertexId> = members.iter().copied().filter(|other| *other != vertex).collect();
                others.sort_by(|a, b| distance(vertex, *a).total_cmp(&distance(vertex, *b)));
                for other in others.into_iter().take(FOOT_NEIGHBOURS).chain([middle]) {
                    routes.add(vertex, other, time(vertex, other));
                    routes.add(other, vertex, time(vertex, other));
                }
            }
        }
        routes
    }
}

/// Expected duration of an edge, failures included, s.
pub fn expected_seconds(edge: &Edge) -> f64 {
    edge.evidence.cost() * f64::from(DECISION_SECONDS)
}

/// What leads where by now, with seconds.
struct Routes {
    edges: Vec<Vec<(VertexId, f64)>>,
}

/// A vertex that can be reached after some seconds; the soonest is the greatest.
#[derive(PartialEq)]
struct Arrival(f64, VertexId);

impl Eq for Arrival {}

impl PartialOrd for Arrival {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Arrival {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.total_cmp(&other.0).then(self.1.cmp(&other.1))
    }
}

impl Routes {
    fn add(&mut self, from: VertexId, to: VertexId, seconds: f64) {
        self.edges[from.idx()].push((to, seconds));
    }

    /// Whether there is a route of at most `limit` seconds (Dijkstra).
    fn reaches(&self, from: VertexId, to: VertexId, limit: f64) -> bool {
        let mut best = vec![f64::INFINITY; self.edges.len()];
        let mut open = BinaryHeap::from([Reverse(Arrival(0.0, from))]);
        while let Some(Reverse(Arrival(after, vertex))) = open.pop() {
            if vertex == to {
                return true;
            }
            if after >= best[vertex.idx()] {
                continue;
            }
            best[vertex.idx()] = after;
            for &(next, seconds) in &self.edges[vertex.idx()] {
                let then = after + seconds;
                if then <= limit && then < best[next.idx()] {
                    open.push(Reverse(Arrival(then, next)));
                }
            }
        }
        false
    }
}
