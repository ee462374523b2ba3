//! Probes again the edges that nothing replaces. A lucky probe of such an edge promises a whole region that no NPC
//! reaches, and an unlucky one makes NPCs avoid the only way.
//!
//! An edge that turns out to succeed rarely stays if nothing leads where it leads: an NPC that rehearses gets along it
//! in the end, and its chance tells how hard that is.

use super::Probed;
use crate::evidence::Evidence;
use crate::graph::NavGraph;
use crate::ids::{EdgeKey, VertexId};
use crate::settings::BuildError;

/// Rounds of probes. Each looks again at which edges nothing replaces: where one of two ways fails, the other becomes
/// the only one.
const ROUNDS: u32 = 5;
/// Probes of an edge in a round.
const TRIES: u32 = 3;
/// Probes after which an edge needs no more, and those after which one that never failed needs none.
const ENOUGH: u32 = 12;
const ENOUGH_WITHOUT_FAILURE: u32 = 4;
/// A round probes at most one in this many of all candidates, but at least [`MIN_EDGES`].
const SHARE: usize = 20;
const MIN_EDGES: usize = 64;

/// Probes the doubtful edges whose ends no other path joins.
pub(super) fn prove_cuts(probed: &mut Probed<'_>) -> Result<(), BuildError> {
    for _ in 0..ROUNDS {
        let graph = probed.graph();
        let mut search = Detours::of(&graph);
        let mut cuts: Vec<EdgeKey> = graph
            .edges()
            .filter(|edge| is_doubtful(&edge.evidence) && !search.has_detour(edge.key))
            .map(|edge| edge.key)
            .collect();
        cuts.truncate((probed.candidates.len() / SHARE).max(MIN_EDGES));
        if cuts.is_empty() {
            return Ok(());
        }
        let which: Vec<u32> = cuts.into_iter().map(|key| probed.index_of(key, Evidence::default().prior)).collect();
        for _ in 0..TRIES {
            probed.try_once_each(&which)?;
        }
    }
    Ok(())
}

/// Keeps candidates that succeeded too rarely to be proved, but lead where nothing else does: the likeliest first.
pub(super) fn keep_lifelines(probed: &mut Probed<'_>) {
    let rare = |idx: &usize| probed.evidence[*idx].successes > 0 && !probed.is_proved(*idx);
    let mut rare: Vec<usize> = (0..probed.candidates.len()).filter(rare).collect();
    let rate = |idx: &usize| probed.evidence[*idx].success_rate();
    rare.sort_by(|a, b| rate(b).total_cmp(&rate(a)).then(probed.candidates[*a].cmp(&probed.candidates[*b])));
    let graph = probed.graph();
    let mut search = Detours::of(&graph);
    for idx in rare {
        let key = probed.candidates[idx];
        if !search.has_detour(key) {
            search.added.push(key);
            probed.lifelines.insert(idx as u32);
        }
    }
}

fn is_doubtful(own: &Evidence) -> bool {
    let enough = if own.successes == own.tries { ENOUGH_WITHOUT_FAILURE } else { ENOUGH };
    own.tries < enough && own.needs.ride.is_none()
}

/// Searches for paths around edges.
struct Detours<'a> {
    graph: &'a NavGraph,
    /// Edges besides those of the graph.
    added: Vec<EdgeKey>,
    /// For each vertex, the number of the last search that reached it.
    reached_in: Vec<u32>,
    searches: u32,
    open: Vec<VertexId>,
}

impl<'a> Detours<'a> {
    fn of(graph: &'a NavGraph) -> Self {
        Self { graph, added: Vec::new(), reached_in: vec![0; graph.vertex_count()], searches: 0, open: Vec::new() }
    }

    /// Whether a path without the edge leads from its one end to the other.
    fn has_detour(&mut self, edge: EdgeKey) -> bool {
        self.searches += 1;
        self.open.clear();
        self.open.push(edge.from);
        self.reached_in[edge.from.idx()] = self.searches;
        while let Some(vertex) = self.open.pop() {
            let added = self.added.iter().copied().filter(|key| key.from == vertex);
            let exits = self.graph.edges_from(vertex).map(|exit| exit.key).chain(added);
            for next in exits.filter(|key| *key != edge) {
                if next.to == edge.to {
                    return true;
                }
                let reached = &mut self.reached_in[next.to.idx()];
                if *reached != self.searches {
                    *reached = self.searches;
                    self.open.push(next.to);
                }
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surefoot_world::{Decisions, Vec3};

    #[test]
    fn an_edge_has_a_detour_if_its_ends_are_joined_without_it() {
        // 0 -> 1 -> 2 -> 0, a short cut 0 -> 2, and 2 -> 3.
        let keys = [(0, 1), (1, 2), (2, 0), (0, 2), (2, 3)].map(|(from, to)| EdgeKey::new(from, to));
        let evidence = [Evidence::forced(Decisions(1.0)); 5];
        let graph = NavGraph::prove(vec![Vec3::ZERO; 4], &keys, &evidence, 0.5);
        let mut detours = Detours::of(&graph);
        assert_eq!(keys.map(|key| detours.has_detour(key)), [false, false, false, true, false]);
    }
}
