//! Links over movers: rides on lifts and platforms, and walks over floors and conveyors.
//!
//! A mover joins all places beside its top at any of its stops. Movers whose tops are beside each other act as one.
//! Doors count as open, because their triangles are not part of the ground.

use super::ground::{Ground, SPACING_M, is_open_between};
use super::{Link, Means};
use crate::Vec3;
use crate::character::CharacterProfile;
use crate::float::horizontal;
use crate::map::CollisionMap;
use crate::map::mover::{Mover, MoverKind};
use crate::navigable::DOWN;
use petgraph::unionfind::UnionFind;
use std::collections::BTreeMap;

/// Distance between sampled places on a mover, m, and their greatest number along one side.
const SAMPLE_M: f32 = 0.5;
const MAX_SAMPLES: f32 = 16.0;
/// Greatest horizontal distance between a place on a mover and a cell from which a character steps onto it, m: half of
/// the diagonal of a cell, and a stride.
const STRIDE_M: f32 = 0.71 * SPACING_M + 0.5;
/// Slack of the height of a step, m: cells are up to this far from the ground.
const SLACK_M: f32 = 0.1;

/// The links over all movers of `map`.
pub(super) fn links(map: &CollisionMap, profile: &CharacterProfile, ground: &Ground) -> Vec<Link> {
    let movers: Vec<&Mover> = map.movers().iter().filter(|mover| mover.kind != MoverKind::Door).collect();
    let tops: Vec<Vec<Vec3>> = movers.iter().map(|mover| tops(mover, profile)).collect();
    let mut links = Vec::new();
    for group in groups(&tops, profile) {
        // One cell of each island beside the group.
        let mut beside: BTreeMap<u32, u32> = BTreeMap::new();
        for top in group.iter().flat_map(|&idx| &tops[idx]) {
            for cell in cells_beside(map, profile, ground, *top) {
                beside.entry(ground.cells()[cell as usize].island).or_insert(cell);
            }
        }
        // A ring of links leads from each island to all others.
        let ring: Vec<(u32, u32)> = beside.into_iter().collect();
        let pairs = ring.iter().zip(ring.iter().cycle().skip(1));
        let link = |(&(from, takeoff), &(to, landing)): (&(u32, u32), &(u32, u32))| Link {
            from,
            to,
            means: Means::Mover,
            takeoff,
            landing,
        };
        links.extend(pairs.map(link).filter(|link| link.from != link.to));
    }
    links
}

/// Places to stand on a mover, at all of its stops, m.
fn tops(mover: &Mover, profile: &CharacterProfile) -> Vec<Vec3> {
    let steepest = libm::cosf(profile.max_slope);
    let mut found = Vec::new();
    for (idx, stop) in mover.stops.iter().enumerate().filter(|(_, stop)| stop.is_there) {
        let triangles = mover.triangles_at(*stop);
        let (low, high) = mover.bounds_at(idx);
        let count = |side: f32| (side / SAMPLE_M).clamp(1.0, MAX_SAMPLES) as u32;
        let (columns, rows) = (count(high.x - low.x), count(high.z - low.z));
        let share = |idx: u32, count: u32| (idx as f32 + 0.5) / count as f32;
        for (column, row) in (0..columns).flat_map(|column| (0..rows).map(move |row| (column, row))) {
            let x = low.x + (high.x - low.x) * share(column, columns);
            let z = low.z + (high.z - low.z) * share(row, rows);
            let above = Vec3::new(x, high.y + 1.0, z);
            let is_level = triangles.iter().filter(|triangle| triangle.normal().y >= steepest);
            let hits = is_level.filter_map(|triangle| triangle.ray(above, DOWN, 0.0, high.y - low.y + 2.0));
            found.extend(hits.map(|distance| above + DOWN * distance));
        }
    }
    found
}

fn is_step(profile: &CharacterProfile, from: Vec3, to: Vec3) -> bool {
    (from.y - to.y).abs() <= profile.step_height + SLACK_M && horizontal(from - to) <= STRIDE_M
}

/// The cells from which a character steps onto a mover at `top`, and to which it steps back.
fn cells_beside(map: &CollisionMap, profile: &CharacterProfile, ground: &Ground, top: Vec3) -> Vec<u32> {
    let (column, row) = ground.column_of(top);
    let around = (-1..=1).flat_map(|x| (-1..=1).map(move |z| (x, z)));
    let cells = around.flat_map(|(x, z)| ground.column(column + x, row + z));
    let is_beside = |idx: &usize| {
        let feet = ground.cells()[*idx].feet;
        is_step(profile, feet, top) && is_open_between(map, profile, feet, top)
    };
    cells.filter(is_beside).map(|idx| idx as u32).collect()
}

/// Groups of movers, by index, whose places are beside each other.
fn groups(tops: &[Vec<Vec3>], profile: &CharacterProfile) -> Vec<Vec<usize>> {
    let square = |point: &Vec3| ((point.x / STRIDE_M) as i32, (point.z / STRIDE_M) as i32);
    let mut by_square: BTreeMap<(i32, i32), Vec<(usize, Vec3)>> = BTreeMap::new();
    for (idx, tops) in tops.iter().enumerate() {
        tops.iter().for_each(|top| by_square.entry(square(top)).or_default().push((idx, *top)));
    }
    let mut joined = UnionFind::<usize>::new(tops.len());
    for (&(x, z), places) in &by_square {
        let around = (x - 1..=x + 1).flat_map(|x| (z - 1..=z + 1).map(move |z| (x, z)));
        for (other, place) in around.filter_map(|square| by_square.get(&square)).flatten() {
            let beside = places.iter().filter(|(idx, top)| idx != other && is_step(profile, *top, *place));
            beside.for_each(|(idx, _)| _ = joined.union(*idx, *other));
        }
    }
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (idx, group) in joined.into_labeling().into_iter().enumerate() {
        groups.entry(group).or_default().push(idx);
    }
    groups.into_values().collect()
}
