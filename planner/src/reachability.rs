//! Reachability of a level, as its graph shows it: islands, one-way traps, the places that depend on an ability, and the
//! differences between two versions.

use crate::graph::NavGraph;
use crate::ids::VertexId;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use surefoot_world::{Ability, Vec3};

/// Greatest distance at which vertices of two versions count as the same place, m.
const SAME_M: f32 = 8.0;

/// An island of a graph: vertices that all reach one another.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Island {
    /// Number of the island in the graph.
    pub id: u32,
    /// Number of vertices in the island.
    pub vertices: usize,
    /// Position of one of its vertices, m.
    pub at: Vec3,
    /// Whether a path leads here from the largest island.
    pub entered: bool,
    /// Whether a path leads from here to the largest island.
    pub left: bool,
}

impl Island {
    /// Returns whether NPCs can get in from the largest island but cannot get back.
    pub fn is_trap(&self) -> bool {
        self.entered && !self.left
    }
}

/// Connectivity of a graph.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Connection {
    /// Number of vertices.
    pub vertices: usize,
    /// Number of edges.
    pub edges: usize,
    /// Share of ordered pairs of different vertices with a path, in [0, 1].
    pub connected: f64,
    /// All islands, the largest first.
    pub islands: Vec<Island>,
    /// For each ability but walking that edges use: how much `connected` falls without these edges.
    pub lost_without: BTreeMap<String, f64>,
}

/// Describes the connectivity of `graph`.
pub fn describe(graph: &NavGraph) -> Connection {
    let mut members: BTreeMap<u32, Vec<VertexId>> = BTreeMap::new();
    for (vertex, &island) in graph.vertices().zip(graph.islands()) {
        members.entry(island).or_default().push(vertex);
    }
    let mut order: Vec<(u32, Vec<VertexId>)> = members.into_iter().collect();
    order.sort_by_key(|(id, members)| (std::cmp::Reverse(members.len()), *id));
    let main = order.first().map(|(_, members)| members[0]);
    let from_main = main.map_or(Vec::new(), |main| graph.reachable_from(main));
    let islands = order
        .iter()
        .map(|(id, members)| Island {
            id: *id,
            vertices: members.len(),
            at: graph.position(members[0]),
            entered: from_main[members[0].idx()],
            left: main.is_some_and(|main| graph.reachable_from(members[0])[main.idx()]),
        })
        .collect();
    let connected = graph.connected_share();
    let used: Vec<Ability> = Ability::ALL
        .into_iter()
        .skip(1)
        .filter(|&ability| graph.edges().any(|edge| edge.evidence.ability == ability))
        .collect();
    let lost_without = used
        .into_iter()
        .map(|ability| (ability.name().to_owned(), connected - without(graph, ability).connected_share()))
        .collect();
    Connection { vertices: graph.vertex_count(), edges: graph.edge_count(), connected, islands, lost_without }
}

/// Returns for each vertex whether the largest island reaches it; the island's own vertices count as reached.
pub fn reached_from_main(graph: &NavGraph) -> Vec<bool> {
    let mut sizes = vec![0usize; graph.island_count() as usize];
    graph.islands().iter().for_each(|&island| sizes[island as usize] += 1);
    let largest = |a: &(VertexId, &u32), b: &(VertexId, &u32)| {
        sizes[*a.1 as usize].cmp(&sizes[*b.1 as usize]).then(b.1.cmp(a.1)).then(b.0.cmp(&a.0))
    };
    let main = graph.vertices().zip(graph.islands()).max_by(largest);
    main.map_or(Vec::new(), |(vertex, _)| graph.reachable_from(vertex))
}

/// Returns the graph without the edges whose most demanding ability is `ability`.
pub fn without(graph: &NavGraph, ability: Ability) -> NavGraph {
    let mut data = graph.to_data();
    data.edges.retain(|edge| edge.evidence.ability != ability);
    NavGraph::check(data).expect("a graph stays valid when edges are removed")
}

/// What changed between two versions of a level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Difference {
    /// Share of ordered pairs with a path before, in [0, 1].
    pub connected_before: f64,
    /// Share of ordered pairs with a path after, in [0, 1].
    pub connected_after: f64,
    /// Positions that the largest island reached before and no longer reaches, m.
    pub lost: Vec<Vec3>,
    /// Positions that the largest island reaches now and did not reach before, m.
    pub gained: Vec<Vec3>,
    /// Number of islands before and after.
    pub islands: (usize, usize),
}

/// Compares two versions of a level. A position counts as reached in a version if a reached vertex lies within 8 m of it.
pub fn compare(before: &NavGraph, after: &NavGraph) -> Difference {
    let places = |graph: &NavGraph| -> Vec<(Vec3, bool)> {
        graph
            .vertices()
            .zip(reached_from_main(graph))
            .map(|(vertex, reached)| (graph.position(vertex), reached))
            .collect()
    };
    let (old, new) = (places(before), places(after));
    let is_reached = |places: &[(Vec3, bool)], at: Vec3| {
        places.iter().any(|(place, reached)| *reached && place.distance_squared(at) <= SAME_M * SAME_M)
    };
    let only = |here: &[(Vec3, bool)], there: &[(Vec3, bool)]| -> Vec<Vec3> {
        here.iter().filter(|(at, reached)| *reached && !is_reached(there, *at)).map(|(at, _)| *at).collect()
    };
    Difference {
        connected_before: before.connected_share(),
        connected_after: after.connected_share(),
        lost: only(&old, &new),
        gained: only(&new, &old),
        islands: (before.island_count() as usize, after.island_count() as usize),
    }
}
