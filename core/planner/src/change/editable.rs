//! A graph that is being changed. It finds vertices by position and edges by their ends, so that the time of a change
//! does not grow with the graph. The edges keep their order, and new ones come last.

use crate::graph::{Edge, GraphData, NavGraph};
use crate::grid::PointGrid;
use crate::ids::{EdgeKey, VertexId};
use crate::legs::LegModel;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use surefoot_world::Vec3;
use surefoot_world::character::OwnMove;

/// A square of the horizontal plane.
type Square = (i32, i32);

/// Vertices in a column of the grid in which the nearest ones are looked up.
const VERTICES_PER_COLUMN: f32 = 2.0;

/// A graph that is being changed.
#[derive(Debug)]
pub(crate) struct Editable {
    vertices: Vec<Vec3>,
    /// Vertices that were removed; they keep their indices.
    removed: BTreeSet<VertexId>,
    /// All other vertices, by square.
    squares: BTreeMap<Square, Vec<VertexId>>,
    /// Distance within which vertices are found, m.
    within_m: f32,
    /// Edges in their order; `None` in place of removed ones.
    edges: Vec<Option<Edge>>,
    /// For each vertex, the indices of the edges that begin or end there, in ascending order; some may be removed.
    edges_at: Vec<Vec<u32>>,
    legs: LegModel,
    moves: Arc<[OwnMove]>,
}

impl Editable {
    /// A copy of `graph` that finds vertices within `within_m` metres of a place.
    pub fn of(graph: &NavGraph, within_m: f32) -> Self {
        let GraphData { vertices, edges, legs, moves } = graph.to_data();
        let mut editable = Self {
            removed: BTreeSet::new(),
            squares: BTreeMap::new(),
            within_m,
            edges: Vec::with_capacity(edges.len()),
            edges_at: Vec::with_capacity(vertices.len()),
            vertices: Vec::with_capacity(vertices.len()),
            legs,
            moves,
        };
        vertices.into_iter().for_each(|at| _ = editable.add_vertex(at));
        edges.into_iter().for_each(|edge| editable.add_edge(edge));
        editable
    }

    /// The changed graph.
    pub fn into_data(self) -> (GraphData, BTreeSet<VertexId>) {
        let edges = self.edges.into_iter().flatten().collect();
        (GraphData { vertices: self.vertices, edges, legs: self.legs, moves: self.moves }, self.removed)
    }

    /// Positions of all vertices, removed ones included, m.
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices
    }

    /// The cost model of unproved legs.
    pub fn legs(&self) -> &LegModel {
        &self.legs
    }

    /// The remaining vertex nearest to `place`; of equally near ones, the first. `None` if none is within the
    /// distance at which vertices are found.
    pub fn vertex_at(&self, place: Vec3) -> Option<VertexId> {
        let (x, z) = self.square(place);
        let around = (x - 1..=x + 1).flat_map(|x| (z - 1..=z + 1).map(move |z| (x, z)));
        let near = around.filter_map(|square| self.squares.get(&square)).flatten();
        let distances = near.map(|&vertex| (self.vertices[vertex.idx()].distance_squared(place), vertex));
        let (_, vertex) = distances.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))?;
        (self.vertices[vertex.idx()].distance(place) <= self.within_m).then_some(vertex)
    }

    /// For each of `vertices`, the `most` remaining vertices nearest to it, the nearest first.
    pub fn neighbours<'a>(
        &'a self,
        vertices: impl Iterator<Item = VertexId> + 'a,
        most: usize,
    ) -> impl Iterator<Item = (VertexId, Vec<VertexId>)> + 'a {
        let grid = PointGrid::spread(&self.vertices, VERTICES_PER_COLUMN);
        vertices.map(move |vertex| {
            let is_other = |other: u32| other != vertex.0 && !self.removed.contains(&VertexId(other));
            let near = grid.nearest(&self.vertices, self.vertices[vertex.idx()], most, is_other);
            (vertex, near.into_iter().map(VertexId).collect())
        })
    }

    /// Adds a vertex without edges.
    pub fn add_vertex(&mut self, at: Vec3) -> VertexId {
        let vertex = VertexId::at(self.vertices.len());
        self.vertices.push(at);
        self.edges_at.push(Vec::new());
        self.squares.entry(self.square(at)).or_default().push(vertex);
        vertex
    }

    /// Moves a vertex, which loses its edges.
    pub fn move_vertex(&mut self, vertex: VertexId, to: Vec3) {
        self.forget(vertex);
        self.vertices[vertex.idx()] = to;
        self.squares.entry(self.square(to)).or_default().push(vertex);
    }

    /// Removes a vertex with its edges.
    pub fn remove_vertex(&mut self, vertex: VertexId) {
        self.forget(vertex);
        self.removed.insert(vertex);
    }

    /// Removes the edges of a vertex, and the vertex from its square.
    fn forget(&mut self, vertex: VertexId) {
        for place in std::mem::take(&mut self.edges_at[vertex.idx()]) {
            self.edges[place as usize] = None;
        }
        if let Some(here) = self.squares.get_mut(&self.square(self.vertices[vertex.idx()])) {
            here.retain(|other| *other != vertex);
        }
    }

    /// Adds an edge after all others.
    pub fn add_edge(&mut self, edge: Edge) {
        let place = u32::try_from(self.edges.len()).expect("graphs have fewer than 2^32 edges");
        for end in [edge.key.from, edge.key.to] {
            self.edges_at[end.idx()].push(place);
        }
        self.edges.push(Some(edge));
    }

    /// The first edge between two vertices.
    pub fn edge_mut(&mut self, key: EdgeKey) -> Option<&mut Edge> {
        let has_key = |place: &&u32| self.edges[**place as usize].is_some_and(|edge| edge.key == key);
        let place = *self.edges_at[self.lesser_end(key).idx()].iter().find(has_key)?;
        self.edges[place as usize].as_mut()
    }

    /// Removes the edges between two vertices. Returns whether there were any.
    pub fn remove_edge(&mut self, key: EdgeKey) -> bool {
        let mut found = false;
        let end = self.lesser_end(key);
        self.edges_at[end.idx()].retain(|&place| {
            let edge = &mut self.edges[place as usize];
            if edge.is_some_and(|edge| edge.key == key) {
                (*edge, found) = (None, true);
            }
            edge.is_some()
        });
        found
    }

    /// The end with fewer edges.
    fn lesser_end(&self, EdgeKey { from, to }: EdgeKey) -> VertexId {
        if self.edges_at[from.idx()].len() <= self.edges_at[to.idx()].len() { from } else { to }
    }

    /// The square of a place. All places within the distance at which vertices are found are in it or in a square
    /// beside it.
    fn square(&self, place: Vec3) -> Square {
        let side = self.within_m * 1.01;
        // No graph is so large; places far outside share the last square.
        let number = |metres: f32| (metres / side).floor().clamp(-1.0e6, 1.0e6) as i32;
        (number(place.x), number(place.z))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::Evidence;
    use proptest::prelude::*;
    use surefoot_world::Decisions;

    const WITHIN_M: f32 = 3.0;

    fn edge(from: u32, to: u32, decisions: u32) -> Edge {
        Edge { key: EdgeKey::new(from, to), evidence: Evidence::forced(Decisions(f64::from(decisions))) }
    }

    fn graph(vertices: Vec<Vec3>, edges: Vec<Edge>) -> NavGraph {
        NavGraph::check(GraphData { vertices, edges, ..GraphData::default() }).unwrap()
    }

    /// What [`Editable`] does, in lists that are walked for each change.
    struct Plain {
        vertices: Vec<Vec3>,
        removed: BTreeSet<VertexId>,
        edges: Vec<Edge>,
    }

    impl Plain {
        fn nearest(&self, place: Vec3) -> Vec<(f32, VertexId)> {
            let vertices = (0..).map(VertexId).zip(&self.vertices).filter(|(vertex, _)| !self.removed.contains(vertex));
            let mut all: Vec<(f32, VertexId)> = vertices.map(|(vertex, at)| (at.distance(place), vertex)).collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            all
        }

        fn remove_edges_of(&mut self, vertex: VertexId) {
            self.edges.retain(|edge| edge.key.from != vertex && edge.key.to != vertex);
        }
    }

    #[derive(Debug, Clone)]
    enum Change {
        Add(Vec3),
        Move(u32, Vec3),
        Remove(u32),
        AddEdge(u32, u32, u32),
        RemoveEdge(u32, u32),
        ReplaceEdge(u32, u32, u32),
    }

    /// Places on a grid of half metres, so that many are equally near.
    fn place() -> impl Strategy<Value = Vec3> {
        (-20..20i32, 0..3i32, -20..20i32).prop_map(|(x, y, z)| Vec3::new(x as f32, y as f32, z as f32) * 0.5)
    }

    fn change() -> impl Strategy<Value = Change> {
        let vertex = || 0..30_u32;
        prop_oneof![
            place().prop_map(Change::Add),
            (vertex(), place()).prop_map(|(vertex, to)| Change::Move(vertex, to)),
            vertex().prop_map(Change::Remove),
            (vertex(), vertex(), 1..9u32).prop_map(|(from, to, decisions)| Change::AddEdge(from, to, decisions)),
            (vertex(), vertex()).prop_map(|(from, to)| Change::RemoveEdge(from, to)),
            (vertex(), vertex(), 1..9u32).prop_map(|(from, to, decisions)| Change::ReplaceEdge(from, to, decisions)),
        ]
    }

    proptest! {
        #![proptest_config(crate::properties::cases(300))]

        #[test]
        fn changes_do_what_they_do_to_plain_lists(
            vertices in prop::collection::vec(place(), 1..30),
            edges in prop::collection::vec((0..30u32, 0..30u32), 0..60),
            changes in prop::collection::vec(change(), 0..60),
            asked in prop::collection::vec(place(), 10),
        ) {
            let count = vertices.len() as u32;
            let edges: Vec<Edge> = edges
                .into_iter()
                .map(|(from, to)| (from % count, to % count))
                .filter(|(from, to)| from != to)
                .map(|(from, to)| edge(from, to, 5))
                .collect();
            let mut plain = Plain { vertices: vertices.clone(), removed: BTreeSet::new(), edges: edges.clone() };
            let mut editable = Editable::of(&graph(vertices, edges), WITHIN_M);
            for change in changes {
                let count = plain.vertices.len() as u32;
                let vertex = |number: u32| VertexId(number % count);
                let is_gone = |vertex: VertexId| plain.removed.contains(&vertex);
                match change {
                    Change::Add(at) => {
                        prop_assert_eq!(editable.add_vertex(at), VertexId(count));
                        plain.vertices.push(at);
                    }
                    Change::Move(number, to) if !is_gone(vertex(number)) => {
                        editable.move_vertex(vertex(number), to);
                        plain.vertices[vertex(number).idx()] = to;
                        plain.remove_edges_of(vertex(number));
                    }
                    Change::Remove(number) if !is_gone(vertex(number)) => {
                        editable.remove_vertex(vertex(number));
                        plain.removed.insert(vertex(number));
                        plain.remove_edges_of(vertex(number));
                    }
                    Change::AddEdge(from, to, decisions)
                        if vertex(from) != vertex(to) && !is_gone(vertex(from)) && !is_gone(vertex(to)) =>
                    {
                        let edge = edge(from % count, to % count, decisions);
                        editable.add_edge(edge);
                        plain.edges.push(edge);
                    }
                    Change::RemoveEdge(from, to) => {
                        let key = EdgeKey { from: vertex(from), to: vertex(to) };
                        let had = plain.edges.iter().any(|edge| edge.key == key);
                        plain.edges.retain(|edge| edge.key != key);
                        prop_assert_eq!(editable.remove_edge(key), had);
                    }
                    Change::ReplaceEdge(from, to, decisions) => {
                        let new = edge(from % count, to % count, decisions);
                        let known = plain.edges.iter_mut().find(|edge| edge.key == new.key);
                        let found = editable.edge_mut(new.key);
                        prop_assert_eq!(found.is_some(), known.is_some());
                        found.into_iter().chain(known).for_each(|edge| *edge = new);
                    }
                    _ => {}
                }
            }
            for place in asked {
                let near = plain.nearest(place);
                let nearest = near.first().filter(|(distance, _)| *distance <= WITHIN_M).map(|(_, vertex)| *vertex);
                prop_assert_eq!(editable.vertex_at(place), nearest);
            }
            let all = (0..plain.vertices.len()).map(VertexId::at);
            let standing: Vec<VertexId> = all.filter(|vertex| !plain.removed.contains(vertex)).collect();
            for (vertex, near) in editable.neighbours(standing.into_iter(), 12) {
                let others = plain.nearest(plain.vertices[vertex.idx()]).into_iter().map(|(_, other)| other);
                prop_assert_eq!(near, others.filter(|other| *other != vertex).take(12).collect::<Vec<_>>());
            }
            let (data, removed) = editable.into_data();
            prop_assert_eq!((data.vertices, data.edges, removed), (plain.vertices, plain.edges, plain.removed));
        }
    }

    #[test]
    fn places_far_outside_are_near_no_vertex() {
        let editable = Editable::of(&graph(vec![Vec3::ZERO], Vec::new()), WITHIN_M);
        for far in [f32::MAX, f32::MIN, 1.0e30, f32::NAN] {
            assert_eq!(editable.vertex_at(Vec3::splat(far)), None);
        }
        assert_eq!(editable.vertex_at(Vec3::new(WITHIN_M, 0.0, 0.0)), Some(VertexId(0)));
    }
}
