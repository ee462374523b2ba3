//! Proves again what plans use of a draft. Probes in a game are dear, so characters of our own, which move much like
//! those of the game, prove the draft.
//!
//! Edges that plans hardly use keep the evidence of the draft, unless their ability does not work here: a game may have
//! no jump pads. Bohlin and Kavraki (*Path planning using lazy PRM*, 2000) probe the edges of one path so; here it is
//! all paths at once.

use super::Probed;
use super::{cuts, join};
use crate::graph::{Edge, NavGraph};
use crate::ids::EdgeKey;
use crate::search::frontier::Frontier;
use crate::settings::BuildError;
use std::cmp::Reverse;
use std::collections::BTreeMap;
use surefoot_world::Ability;
use surefoot_world::csr::Csr;

/// Rounds of probes. Each looks again at what plans use: where a busy edge fails, plans use others.
const ROUNDS: u32 = 5;
/// Probes of an edge that fails, at most.
const TRIES: u32 = 3;
/// Share of the legs of all plans whose edges are probed.
const SHARE: f64 = 0.98;
/// An ability does not work here if less than this share of its edges got through, of at least [`MIN_PROBED`].
const MIN_SHARE: f64 = 0.25;
const MIN_PROBED: u32 = 4;
/// Greatest number of vertices whose paths are counted.
const MAX_STARTS: usize = 256;

/// Probes the edges of a draft that plans use, those beside which a miss is fatal also on the run, then what connects
/// islands, and what nothing replaces.
pub(super) fn confirm(probed: &mut Probed<'_>) -> Result<(), BuildError> {
    probed.doubt();
    // By ability: edges that got through, and edges that were probed.
    let mut by_ability: BTreeMap<Ability, [u32; 2]> = BTreeMap::new();
    let mut probed_here = Vec::new();
    for _ in 0..ROUNDS {
        let busy = busiest(&probed.graph());
        let mut due: Vec<u32> = busy.into_iter().filter_map(|key| probed.draft_index(key)).collect();
        if due.is_empty() {
            break;
        }
        let abilities: Vec<(u32, Ability)> =
            due.iter().map(|&idx| (idx, probed.evidence[idx as usize].ability)).collect();
        for _ in 0..TRIES {
            probed.try_once_each(&due)?;
            due.retain(|&idx| probed.evidence[idx as usize].successes == 0);
        }
        for (idx, ability) in abilities {
            probed_here.push(idx);
            let [through, all] = by_ability.entry(ability).or_default();
            *through += u32::from(probed.evidence[idx as usize].successes > 0);
            *all += 1;
        }
        for (&ability, &[through, all]) in &by_ability {
            if all >= MIN_PROBED && f64::from(through) < MIN_SHARE * f64::from(all) {
                probed.doubt_ability(ability);
            }
        }
    }
    probed.prove_on_the_run(probed_here)?;
    join::join_islands(probed)?;
    cuts::prove_cuts(probed)?;
    cuts::keep_lifelines(probed);
    Ok(())
}

/// The edges that carry most legs of the cheapest paths between the vertices of `graph`, the busiest first.
fn busiest(graph: &NavGraph) -> Vec<EdgeKey> {
    let edges: Vec<&Edge> = graph.edges().collect();
    let vertex_count = graph.vertex_count();
    let exit = |(idx, edge): (usize, &&Edge)| (edge.key.from.idx(), (edge.key.to.0, edge.evidence.cost(), idx));
    let exits: Vec<_> = edges.iter().enumerate().map(exit).collect();
    let exits = Csr::group(vertex_count, exits.into_iter());
    let mut legs = vec![0u64; edges.len()];
    let mut frontier = Frontier::new(vertex_count);
    let mut entered_by = vec![usize::MAX; vertex_count];
    for start in (0..vertex_count).step_by(vertex_count.div_ceil(MAX_STARTS).max(1)) {
        frontier.clear();
        frontier.offer(start as u32, 0.0);
        let mut settled = Vec::new();
        while let Some((vertex, so_far)) = frontier.settle(f64::INFINITY) {
            settled.push(vertex as usize);
            for &(to, cost, edge) in exits.row(vertex as usize) {
                if frontier.offer(to, so_far + cost) {
                    entered_by[to as usize] = edge;
                }
            }
        }
        let mut ends_beyond = vec![1u64; vertex_count];
        for &vertex in settled[1..].iter().rev() {
            let edge = entered_by[vertex];
            legs[edge] += ends_beyond[vertex];
            ends_beyond[edges[edge].key.from.idx()] += ends_beyond[vertex];
        }
    }
    let mut order: Vec<usize> = (0..edges.len()).filter(|&idx| legs[idx] > 0).collect();
    order.sort_by_key(|&idx| (Reverse(legs[idx]), edges[idx].key));
    let mut left = legs.iter().sum::<u64>() as f64 * SHARE;
    let is_needed = |idx: &usize| {
        let is_needed = left > 0.0;
        left -= legs[*idx] as f64;
        is_needed
    };
    order.into_iter().take_while(is_needed).map(|idx| edges[idx].key).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::Evidence;
    use surefoot_world::{Decisions, Vec3};

    #[test]
    fn the_busiest_edges_carry_most_legs() {
        // A line there and back, and an edge from its one end to the other that costs more than the line.
        let keys = [(0, 1), (1, 2), (2, 3), (3, 2), (2, 1), (1, 0), (0, 3)].map(|(from, to)| EdgeKey::new(from, to));
        let evidence = keys.map(|key| Evidence::forced(Decisions(if key == EdgeKey::new(0, 3) { 9.0 } else { 1.0 })));
        let graph = NavGraph::prove(vec![Vec3::ZERO; 4], &keys, &evidence, 0.5);
        let busy = busiest(&graph);
        assert_eq!(busy[..2], [EdgeKey::new(1, 2), EdgeKey::new(2, 1)]);
        assert!(!busy.contains(&EdgeKey::new(0, 3)), "{busy:?}");
        assert_eq!(busy.len(), 6);
    }
}
