//! Joins what frugal probing left apart: candidates between islands that no path connects are probed again and again,
//! over longer distances than elsewhere. A leg that rarely succeeds is worth more than none, since NPCs rehearse what
//! may harm them.

use super::Probed;
use super::candidates::Candidate;
use crate::graph::NavGraph;
use crate::ids::{EdgeKey, VertexId};
use crate::settings::BuildError;
use std::collections::{BTreeMap, BTreeSet};
use surefoot_world::float::hypot;

/// Rounds of probes; each looks again at which islands are apart.
const ROUNDS: u32 = 6;
/// Most probes of one candidate.
const MAX_TRIES: u32 = 8;
/// Candidates from one island to another in a round: the easiest.
const PAIRS: usize = 4;
/// Greatest distance on the plane, m: a run and two jumps.
const REACH_M: f32 = 24.0;
/// Metres on the plane that a metre upwards counts for.
const CLIMB_WEIGHT: f32 = 3.0;
/// A round probes at most one in this many of all candidates, but at least [`MIN_PROBES`].
const SHARE: usize = 10;
const MIN_PROBES: usize = 64;
/// Greatest number of islands that are joined, the largest first.
const MAX_ISLANDS: usize = 256;
/// Prior of a candidate that only this search has found.
const PRIOR: f32 = 0.3;

/// Probes candidates between islands, new ones included.
pub(super) fn join_islands(probed: &mut Probed<'_>) -> Result<(), BuildError> {
    let mut joined = BTreeSet::new();
    for _ in 0..ROUNDS {
        let mut found = unreached_pairs(&probed.graph(), probed);
        found.truncate((probed.candidates.len() / SHARE).max(MIN_PROBES));
        if found.is_empty() {
            break;
        }
        let which: Vec<u32> = found.into_iter().map(|key| probed.index_of(key, PRIOR)).collect();
        probed.try_once_each(&which)?;
        joined.extend(which);
    }
    probed.prove_on_the_run(joined)
}

/// Pairs of near vertices such that no path leads from the first to the second, the easiest first.
fn unreached_pairs(graph: &NavGraph, probed: &Probed<'_>) -> Vec<Candidate> {
    let (islands, profile) = (graph.islands(), &probed.site().profile);
    let mut members: BTreeMap<u32, Vec<VertexId>> = BTreeMap::new();
    graph.vertices().for_each(|vertex| members.entry(islands[vertex.idx()]).or_default().push(vertex));
    let mut largest: Vec<&Vec<VertexId>> = members.values().collect();
    largest.sort_by_key(|members| (std::cmp::Reverse(members.len()), members[0]));
    largest.truncate(MAX_ISLANDS);
    let jumps = 1.0 + f32::from(profile.extra_jumps);
    let rise = profile.step_height + jumps * 0.5 * profile.jump_speed * profile.jump_speed / profile.gravity;
    let mut found = Vec::new();
    for members in largest {
        let reached = graph.reachable_from(members[0]);
        let mut by_island: BTreeMap<u32, Vec<(f32, Candidate)>> = BTreeMap::new();
        for &from in members {
            let start = probed.vertices()[from.idx()];
            for (to, at) in probed.places.within(start, REACH_M).filter(|&(to, _)| !reached[to as usize]) {
                let offset = at - start;
                let distance = hypot(offset.x, offset.z);
                let key = EdgeKey { from, to: VertexId(to) };
                if distance <= REACH_M && offset.y <= rise && probed.tries(key) < MAX_TRIES {
                    let effort = distance + CLIMB_WEIGHT * offset.y.max(0.0);
                    by_island.entry(islands[to as usize]).or_default().push((effort, key));
                }
            }
        }
        for mut pairs in by_island.into_values() {
            pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            found.extend(pairs.into_iter().take(PAIRS));
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found.into_iter().map(|(_, key)| key).collect()
}
