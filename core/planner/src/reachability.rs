//! Reachability of a level according to its graph: islands, one-way traps, the dependence on abilities, and the
//! differences between two versions.

use crate::graph::NavGraph;
use crate::grid::PointGrid;
use crate::ids::VertexId;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use surefoot_world::map::LevelFrame;
use surefoot_world::{Ability, DVec3, Vec3};

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
    /// The same in the level's own coordinates, if they are not those of the map and were asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_in_level: Option<DVec3>,
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
    /// For each ability except walking that edges use: how much `connected` falls without these edges.
    pub lost_without: BTreeMap<String, f64>,
}

impl Connection {
    /// Adds the places in the coordinates of a level with this frame.
    #[must_use]
    pub fn in_level(mut self, frame: &LevelFrame) -> Self {
        self.islands.iter_mut().for_each(|island| island.at_in_level = frame.other_place(island.at));
        self
    }
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
    let to_main = main.map_or(Vec::new(), |main| graph.reaching(main));
    let islands = order
        .iter()
        .map(|(id, members)| Island {
            id: *id,
            vertices: members.len(),
            at: graph.position(members[0]),
            at_in_level: None,
            entered: from_main[members[0].idx()],
            left: to_main[members[0].idx()],
        })
        .collect();
    let connected = graph.connected_share();
    let is_used = |ability: Ability| graph.edges().any(|edge| edge.evidence.ability == ability);
    let used = graph.abilities().skip(1).filter(|(ability, _)| is_used(*ability));
    let left = |ability: Ability| graph.connected_share_without(|edge| edge.evidence.ability == ability);
    let lost_without = used.map(|(ability, name)| (name.to_owned(), connected - left(ability))).collect();
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

/// The difference between two versions of a level.
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
    /// The lost positions in the level's own coordinates, if they are not those of the map.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lost_in_level: Vec<DVec3>,
    /// The gained positions in the level's own coordinates, if they are not those of the map.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub gained_in_level: Vec<DVec3>,
    /// Number of islands before and after.
    pub islands: (usize, usize),
}

/// Compares two versions of a level whose maps have the same frame, see [`compare_levels`].
pub fn compare(before: &NavGraph, after: &NavGraph) -> Difference {
    compare_levels((before, &LevelFrame::default()), (after, &LevelFrame::default()))
}

/// Compares two versions of a level by their graphs and the frames of their maps: an import of a larger version may put
/// the level elsewhere on its map. A position counts as reached in a version if a reached vertex is at most 8 m away.
/// Positions that were lost are on the map before, those that were gained on the map after.
pub fn compare_levels(
    (before, frame_before): (&NavGraph, &LevelFrame),
    (after, frame_after): (&NavGraph, &LevelFrame),
) -> Difference {
    let reached = |graph: &NavGraph| -> Vec<Vec3> {
        let reached = graph.vertices().zip(reached_from_main(graph)).filter(|(_, reached)| *reached);
        reached.map(|(vertex, _)| graph.position(vertex)).collect()
    };
    let (old, new) = (reached(before), reached(after));
    let is_moved = frame_before != frame_after;
    let to_before = |&at: &Vec3| if is_moved { frame_before.to_map(frame_after.to_level(at)) } else { at };
    let new_before: Vec<Vec3> = new.iter().map(to_before).collect();
    // The indices of places `here` that are not `there`.
    let only = |here: &[Vec3], there: &[Vec3]| -> Vec<usize> {
        let grid = PointGrid::new(there, SAME_M);
        let is_same = |at: Vec3, other: u32| there[other as usize].distance_squared(at) <= SAME_M * SAME_M;
        // A little more, because columns are computed with rounding.
        let is_reached = |at: &Vec3| grid.within(*at, SAME_M + 0.1).any(|other| is_same(*at, other));
        (0..here.len()).filter(|&idx| !is_reached(&here[idx])).collect()
    };
    let lost: Vec<Vec3> = only(&old, &new_before).into_iter().map(|idx| old[idx]).collect();
    let gained: Vec<Vec3> = only(&new_before, &old).into_iter().map(|idx| new[idx]).collect();
    Difference {
        connected_before: before.connected_share(),
        connected_after: after.connected_share(),
        lost_in_level: lost.iter().filter_map(|&at| frame_before.other_place(at)).collect(),
        gained_in_level: gained.iter().filter_map(|&at| frame_after.other_place(at)).collect(),
        lost,
        gained,
        islands: (before.island_count() as usize, after.island_count() as usize),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::{Evidence, TryEnd};
    use crate::graph::{Edge, GraphData};
    use crate::ids::EdgeKey;
    use proptest::prelude::*;

    /// A graph of vertices on a plane and edges by abilities.
    fn graph(places: &[(u8, u8)], edges: &[(u8, u8, Ability)]) -> NavGraph {
        let vertices = places.iter().map(|(x, z)| Vec3::new(f32::from(*x), 0.0, f32::from(*z))).collect();
        let end = |end: u8| u32::from(end) % places.len() as u32;
        let edges = edges.iter().filter(|(from, to, _)| end(*from) != end(*to)).map(|(from, to, ability)| {
            let mut evidence = Evidence::default();
            evidence.note(TryEnd::Arrived, 9, *ability);
            Edge { key: EdgeKey::new(end(*from), end(*to)), evidence }
        });
        NavGraph::check(GraphData { vertices, edges: edges.collect(), ..GraphData::default() }).unwrap()
    }

    fn graphs() -> impl Strategy<Value = NavGraph> {
        let ability = prop::sample::select(vec![Ability::WALK, Ability::JUMP, Ability::PAD]);
        let places = prop::collection::vec((any::<u8>(), any::<u8>()), 1..40);
        let edges = prop::collection::vec((any::<u8>(), any::<u8>(), ability), 0..70);
        (places, edges).prop_map(|(places, edges)| graph(&places, &edges))
    }

    /// The share of pairs with a path, by a search from every vertex.
    fn searched_share(graph: &NavGraph) -> f64 {
        let reached = |from| graph.reachable_from(from).iter().filter(|reached| **reached).count() - 1;
        let pairs: usize = graph.vertices().map(reached).sum();
        pairs as f64 / (graph.vertex_count() * (graph.vertex_count() - 1)).max(1) as f64
    }

    proptest! {
        #![proptest_config(crate::properties::cases(200))]

        #[test]
        fn descriptions_agree_with_a_search_from_every_vertex(graph in graphs()) {
            let described = describe(&graph);
            prop_assert_eq!(described.connected, searched_share(&graph));
            for (name, lost) in &described.lost_without {
                let ability = Ability::named(name).unwrap();
                prop_assert_eq!(*lost, described.connected - searched_share(&without(&graph, ability)));
            }
            let of_island = |id: u32| graph.vertices().find(|vertex| graph.islands()[vertex.idx()] == id).unwrap();
            let main = of_island(described.islands[0].id);
            for island in &described.islands {
                let member = of_island(island.id);
                prop_assert_eq!(island.at, graph.position(member));
                prop_assert_eq!(island.entered, graph.reachable_from(main)[member.idx()]);
                prop_assert_eq!(island.left, graph.reachable_from(member)[main.idx()]);
            }
        }

        #[test]
        fn versions_differ_where_no_reached_place_of_the_other_is_near(before in graphs(), after in graphs()) {
            let reached = |graph: &NavGraph| -> Vec<Vec3> {
                let reached = reached_from_main(graph);
                graph.vertices().filter(|vertex| reached[vertex.idx()]).map(|vertex| graph.position(vertex)).collect()
            };
            let only = |here: &NavGraph, there: &NavGraph| -> Vec<Vec3> {
                let there = reached(there);
                reached(here).into_iter().filter(|at| there.iter().all(|other| other.distance(*at) > SAME_M)).collect()
            };
            let difference = compare(&before, &after);
            prop_assert_eq!(difference.lost, only(&before, &after));
            prop_assert_eq!(difference.gained, only(&after, &before));
        }
    }

    #[test]
    fn a_level_that_the_import_puts_elsewhere_on_its_map_has_lost_nothing() {
        let walks = [(0, 1, Ability::WALK), (1, 0, Ability::WALK)];
        let (before, after) = (graph(&[(5, 5), (15, 5)], &walks), graph(&[(45, 5), (55, 5)], &walks));
        let frame = |x: f64| LevelFrame { origin: DVec3::new(x, 0.0, 0.0), ..LevelFrame::default() };
        let difference = compare_levels((&before, &frame(2.0)), (&after, &frame(42.0)));
        assert_eq!((difference.lost, difference.gained), (Vec::new(), Vec::new()));
        let apart = compare(&before, &after);
        assert_eq!((apart.lost.len(), apart.gained), (2, vec![Vec3::new(45.0, 0.0, 5.0), Vec3::new(55.0, 0.0, 5.0)]));
    }
}
