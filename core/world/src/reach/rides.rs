//! Links over movers: lifts and platforms that are ridden, and floors and conveyors that are walked over.
//!
//! A mover joins every place that is beside its top at one of its stops. Movers whose tops are beside each other act as one. Doors count as
//! open: their triangles are no part of the ground.

use super::ground::{Ground, SPACING_M, is_open_between};
use super::{Link, Means};
use crate::Vec3;
use crate::character::CharacterProfile;
use crate::float::hypot;
use crate::map::Map;
use crate::map::mover::{Mover, MoverKind};
use crate::navigable::DOWN;
use std::collections::BTreeMap;

/// Distance between the places on a mover that are looked at, m, and most of them along one side.
const SAMPLE_M: f32 = 0.5;
const MAX_SAMPLES: f32 = 16.0;
/// Farthest that a place on a mover is from the cell from which a character steps onto it, seen from above, m: half of the diagonal of a cell,
/// and what it strides over.
const STRIDE_M: f32 = 0.71 * SPACING_M + 0.5;
/// How much higher or lower than a step a place may be, m: cells lie up to this far from the ground.
const SLACK_M: f32 = 0.1;

/// The links over all movers of `map`.
pub(super) fn links(map: &Map, profile: &CharacterProfile, ground: &Ground) -> Vec<Link> {
    let movers: Vec<&Mover> = map.movers().iter().filter(|mover| mover.kind != MoverKind::Door).collect();
    let tops: Vec<Vec<Vec3>> = movers.iter().map(|mover| tops(mover, profile)).collect();
    let mut links = Vec::new();
    for group in groups(&tops, profile) {
        // One cell of each island that is beside the group.
        let mut beside: BTreeMap<u32, u32> = BTreeMap::new();
        for top in group.iter().flat_map(|&idx| &tops[idx]) {
            for cell in cells_beside(map, profile, ground, *top) {
                beside.entry(ground.cells()[cell as usize].island).or_insert(cell);
            }
        }
        // A ring leads from each of them to all.
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
    (from.y - to.y).abs() <= profile.step_height + SLACK_M && hypot(from.x - to.x, from.z - to.z) <= STRIDE_M
}

/// The cells from which a character steps onto a mover at `top`, and back.
fn cells_beside(map: &Map, profile: &CharacterProfile, ground: &Ground, top: Vec3) -> Vec<u32> {
    let (column, row) = ground.column_of(top);
    let around = (-1..=1).flat_map(|x| (-1..=1).map(move |z| (x, z)));
    let cells = around.flat_map(|(x, z)| ground.column(column + x, row + z));
    let is_beside = |idx: &usize| {
        let feet = ground.cells()[*idx].feet;
        is_step(profile, feet, top) && is_open_between(map, feet, top)
    };
    cells.filter(is_beside).map(|idx| idx as u32).collect()
}

/// The movers, by index, in groups that are joined by places beside each other.
fn groups(tops: &[Vec<Vec3>], profile: &CharacterProfile) -> Vec<Vec<usize>> {
    let square = |point: &Vec3| ((point.x / STRIDE_M) as i32, (point.z / STRIDE_M) as i32);
    let mut by_square: BTreeMap<(i32, i32), Vec<(usize, Vec3)>> = BTreeMap::new();
    for (idx, tops) in tops.iter().enumerate() {
        tops.iter().for_each(|top| by_square.entry(square(top)).or_default().push((idx, *top)));
    }
    let mut exits = vec![Vec::new(); tops.len()];
    for (&(x, z), places) in &by_square {
        let around = (x - 1..=x + 1).flat_map(|x| (z - 1..=z + 1).map(move |z| (x, z)));
        for (other, place) in around.filter_map(|square| by_square.get(&square)).flatten() {
            let beside = places.iter().filter(|(idx, top)| idx != other && is_step(profile, *top, *place));
            beside.for_each(|(idx, _)| exits[*idx].push(*other as u32));
        }
    }
    let (of_mover, count) = super::strongly_connected(&exits);
    let mut groups = vec![Vec::new(); count];
    for (idx, group) in of_mover.into_iter().enumerate() {
        groups[group as usize].push(idx);
    }
    groups
}
