//! Joins islands along paths that the survey finds: around corners, through doors, up ramps, over gaps.
//!
//! Candidates join vertices that are near each other in a straight line, and the policy sees a few metres. Where walls,
//! cliffs or voids lie between, the survey of the ground finds a path around them. Its corners become vertices, and its
//! legs are probed like any other.

use super::Probed;
use super::candidates::Candidate;
use super::ways::{Way, Ways};
use crate::graph::NavGraph;
use crate::grid::GrowingGrid;
use crate::ids::EdgeKey;
use crate::legs::LegModel;
use crate::ride_stops::Clearance;
use crate::settings::{BuildError, MAX_VERTICES};
use std::collections::{BTreeMap, BTreeSet};
use surefoot_world::float::hypot;
use surefoot_world::reach::Reach;
use surefoot_world::{Decisions, Vec3};

/// Number of ways from one island of the graph to another that each round tries, the shortest first; each round looks
/// again at which islands are apart.
const WAYS: [usize; 6] = [1, 2, 3, 3, 3, 3];
/// Longest leg on foot when a way is tried first, then again, m: short legs keep clear of edges and walls.
const LEGS_M: [f32; 4] = [14.0, 6.0, 3.0, 6.0];
/// A corner within this share of the longest leg of a vertex is that vertex.
const MERGE: f32 = 0.1;
/// Probes of a leg in a round.
const TRIES: u32 = 3;
/// Prior of a leg.
const PRIOR: f32 = 0.5;
/// Distance up to which a place in sight is assumed to be reached on foot, m.
const SIGHT_M: f32 = 16.0;
/// Number of places without a vertex in sight that are probed together.
const BATCH: usize = 16;
/// Number of legs to each such place that are probed, and of legs from it.
const ATTACHMENTS: usize = 3;
/// Share of bundles of such legs in which one succeeds, at which the policy needs no help.
const ENOUGH: f32 = 0.9;
/// Greatest number of corners for each vertex, but at least [`MIN_CORNERS`] in all.
const CORNERS_PER_VERTEX: usize = 2;
const MIN_CORNERS: usize = 64;

/// Adds vertices and candidates along ways of the survey, and probes them.
pub(super) fn stitch(probed: &mut Probed<'_>) -> Result<(), BuildError> {
    if probed.graph().island_count() == 1 {
        return Ok(());
    }
    let (site, count) = (probed.site(), probed.vertices().len());
    let most = (count + (CORNERS_PER_VERTEX * count).max(MIN_CORNERS)).min(MAX_VERTICES.max(count));
    let reach = Reach::survey(&site.map, &site.profile, probed.thread_count());
    let mut ways = Ways::new(site, &reach);
    let clearance = Clearance::of(site);
    add_uncovered_places(&ways, &clearance, count + (most - count) / 4, probed)?;
    let (mut tries, mut stitched) = (BTreeMap::new(), BTreeSet::new());
    for most_ways in WAYS {
        let graph = probed.graph();
        let cells = ways.cells_of(probed.vertices());
        let (before, after) = (ways.nearest_before(&cells), ways.nearest_after(&cells));
        let mut legs: BTreeMap<Candidate, Vec<u32>> = BTreeMap::new();
        for way in gaps(&graph, ways.meetings(&before, &after), &tries, most_ways) {
            let tries: &mut usize = tries.entry((way.from, way.to)).or_default();
            let leg_m = LEGS_M[*tries];
            let found = ways.legs(&way, &before, &after, leg_m);
            if probed.vertices().len() + found.len() > most + 1 {
                break;
            }
            *tries += 1;
            legs.extend(join_legs(&way, (&ways, &clearance), found, MERGE * leg_m, &mut probed.places));
        }
        if legs.is_empty() {
            break;
        }
        let which: Vec<u32> = legs.keys().map(|&key| probed.index_of(key, PRIOR)).collect();
        for _ in 0..TRIES {
            probed.try_once_each(&which)?;
        }
        for (&idx, cells) in which.iter().zip(legs.values()) {
            if probed.evidence[idx as usize].successes == 0 {
                ways.discourage(cells);
            }
        }
        stitched.extend(which);
    }
    probed.prove_on_the_run(stitched)
}

/// Adds vertices at places that have no vertex in sight, up to `most` vertices in all, and probes the legs that a plan
/// would try first between them and other vertices. Ends where the policy needs no help.
fn add_uncovered_places(
    ways: &Ways<'_>,
    clearance: &Clearance<'_>,
    most: usize,
    probed: &mut Probed<'_>,
) -> Result<(), BuildError> {
    let legs = LegModel::fit(probed.vertices(), &probed.candidates, &probed.evidence);
    let mut places = ways.uncovered(probed.vertices(), SIGHT_M).filter(|place| clearance.is_clear(*place));
    loop {
        let room = BATCH.min(most.saturating_sub(probed.vertices().len()));
        let batch: Vec<Vec3> = places.by_ref().take(room).collect();
        // The legs to each place, and those from it.
        let mut bundles: Vec<Vec<u32>> = Vec::new();
        for &place in &batch {
            let sources = cheapest(&probed.places, place, |at| legs.decisions(at, place));
            let targets = cheapest(&probed.places, place, |at| legs.decisions(place, at));
            let added = probed.vertices().len() as u32;
            probed.places.push(place);
            let mut index_of = |from, to| probed.index_of(EdgeKey::new(from, to), PRIOR);
            bundles.push(sources.into_iter().map(|from| index_of(from, added)).collect());
            bundles.push(targets.into_iter().map(|to| index_of(added, to)).collect());
        }
        probed.try_once_each(&bundles.concat())?;
        let arrives = |idx: &u32| probed.evidence[*idx as usize].successes > 0;
        let attached = bundles.iter().filter(|bundle| bundle.iter().any(arrives)).count();
        if batch.len() < BATCH || attached as f32 >= ENOUGH * bundles.len() as f32 {
            return Ok(());
        }
    }
}

/// The vertices whose legs from or to `place` take the fewest decisions, [`ATTACHMENTS`] of them.
fn cheapest(vertices: &GrowingGrid, place: Vec3, decisions: impl Fn(Vec3) -> Decisions) -> Vec<u32> {
    let mut reach_m = SIGHT_M;
    loop {
        let near = vertices.within(place, reach_m).map(|(vertex, at)| (decisions(at).0, vertex));
        let mut costs: Vec<(f64, u32)> = near.collect();
        let are_all = costs.len() == vertices.points().len();
        costs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        costs.truncate(ATTACHMENTS);
        // Legs to vertices that are farther away take more decisions.
        let least = LegModel::least_decisions(f64::from(reach_m));
        if are_all || costs.len() == ATTACHMENTS && costs[ATTACHMENTS - 1].0 < least {
            return costs.into_iter().map(|(_, vertex)| vertex).collect();
        }
        reach_m *= 2.0;
    }
}

/// Adds the corners of a way to the vertices. Returns the candidates along its legs, in both directions, with the cells
/// that they pass. A corner within `merge_m` metres of a vertex is that vertex.
fn join_legs(
    way: &Way,
    (ways, clearance): (&Ways<'_>, &Clearance<'_>),
    legs: Vec<Vec<u32>>,
    merge_m: f32,
    vertices: &mut GrowingGrid,
) -> Vec<(Candidate, Vec<u32>)> {
    let count = legs.len();
    let mut found = Vec::with_capacity(2 * count);
    let mut from = way.from;
    for (idx, mut cells) in legs.into_iter().enumerate() {
        let corner = ways.feet(cells[cells.len() - 1]);
        if idx + 1 < count && !clearance.is_clear(corner) {
            // The leg continues to the next corner.
            continue;
        }
        let is_near = |(_, vertex): &(u32, Vec3)| {
            let offset = *vertex - corner;
            hypot(offset.x, offset.z) <= merge_m && offset.y.abs() <= 0.5 * merge_m
        };
        let near = vertices.within(corner, merge_m).filter(is_near).map(|(vertex, _)| vertex).min();
        let to = if idx + 1 == count {
            way.to
        } else {
            near.unwrap_or_else(|| {
                vertices.push(corner);
                vertices.points().len() as u32 - 1
            })
        };
        if from != to {
            found.push((EdgeKey::new(from, to), cells.clone()));
            cells.reverse();
            found.push((EdgeKey::new(to, from), cells));
        }
        from = to;
    }
    found
}

/// The `most_ways` shortest of the `meetings` between any two islands, from one vertex to another that no path of the
/// graph leads to.
fn gaps(
    graph: &NavGraph,
    meetings: impl Iterator<Item = Way>,
    tries: &BTreeMap<(u32, u32), usize>,
    most_ways: usize,
) -> Vec<Way> {
    let islands = graph.islands();
    let mut shortest: BTreeMap<(u32, u32), Way> = BTreeMap::new();
    for way in meetings.filter(|way| islands[way.from as usize] != islands[way.to as usize]) {
        let ends = (way.from, way.to);
        let can_try = tries.get(&ends).is_none_or(|&tries| tries < LEGS_M.len());
        if can_try && shortest.get(&ends).is_none_or(|known| way.length_m < known.length_m) {
            shortest.insert(ends, way);
        }
    }
    let pairs: Vec<EdgeKey> = shortest.keys().map(|&(from, to)| EdgeKey::new(from, to)).collect();
    let joined = graph.connectivity().are_joined(&pairs);
    let mut by_islands: BTreeMap<(u32, u32), Vec<Way>> = BTreeMap::new();
    for (way, _) in shortest.into_values().zip(joined).filter(|(_, is_joined)| !is_joined) {
        let ends = (islands[way.from as usize], islands[way.to as usize]);
        by_islands.entry(ends).or_default().push(way);
    }
    let by_length = |a: &Way, b: &Way| a.length_m.total_cmp(&b.length_m).then((a.from, a.to).cmp(&(b.from, b.to)));
    let mut gaps: Vec<Way> = by_islands
        .into_values()
        .flat_map(|mut ways| {
            ways.sort_by(by_length);
            ways.truncate(most_ways);
            ways
        })
        .collect();
    gaps.sort_by(by_length);
    gaps
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::Evidence;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    const EXTENT: Vec3 = Vec3::new(300.0, 20.0, 300.0);

    fn places(seed: u64, count: usize, side_m: f32) -> GrowingGrid {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut place =
            || Vec3::new(rng.random_range(0.0..side_m), rng.random_range(0.0..9.0), rng.random_range(0.0..side_m));
        let places: Vec<Vec3> = (0..count).map(|_| place()).collect();
        GrowingGrid::new(EXTENT, 8.0, &places)
    }

    #[test]
    fn the_cheapest_legs_are_those_of_a_search_through_all_vertices() {
        let legs = LegModel::default();
        for (seed, count, side_m) in [(1, 2, 300.0), (2, 40, 300.0), (3, 900, 300.0), (4, 900, 20.0), (5, 3, 300.0)] {
            let vertices = places(seed, count, side_m);
            for place in places(seed + 10, 30, 300.0).points() {
                let back = |at: Vec3| legs.decisions(at, *place);
                let mut all: Vec<u32> = (0..count as u32).collect();
                let cost = |vertex: &u32| back(vertices.points()[*vertex as usize]).0;
                all.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
                all.truncate(ATTACHMENTS);
                assert_eq!(cheapest(&vertices, *place, back), all, "seed {seed}, {place}");
            }
        }
    }

    fn way(from: u32, to: u32, length_m: f32) -> Way {
        Way { from, to, border: (0, 1), length_m }
    }

    #[test]
    fn gaps_are_the_shortest_ways_between_islands_that_no_path_joins() {
        // 0 <-> 1, 2 <-> 3, and one way from the first pair to the second; 4 is alone.
        let candidates = [(0, 1), (1, 0), (2, 3), (3, 2), (1, 2)].map(|(from, to)| EdgeKey::new(from, to));
        let evidence = [Evidence::forced(Decisions(1.0)); 5];
        let graph = NavGraph::prove(vec![Vec3::ZERO; 5], &candidates, &evidence, 0.5);
        let meetings = [
            way(0, 1, 1.0),
            way(0, 2, 2.0),
            way(2, 0, 9.0),
            way(2, 0, 5.0),
            way(3, 1, 4.0),
            way(3, 0, 6.0),
            way(4, 0, 3.0),
            way(0, 4, 7.0),
        ];
        let found = |tries: &[((u32, u32), usize)], most_ways| -> Vec<(u32, u32, f32)> {
            let gaps = gaps(&graph, meetings.into_iter(), &tries.iter().copied().collect(), most_ways);
            gaps.into_iter().map(|way| (way.from, way.to, way.length_m)).collect()
        };
        assert_eq!(found(&[], 1), [(4, 0, 3.0), (3, 1, 4.0), (0, 4, 7.0)]);
        assert_eq!(found(&[], 2), [(4, 0, 3.0), (3, 1, 4.0), (2, 0, 5.0), (0, 4, 7.0)]);
        assert_eq!(found(&[((3, 1), LEGS_M.len()), ((4, 0), 1)], 1), [(4, 0, 3.0), (2, 0, 5.0), (0, 4, 7.0)]);
    }
}
