//! Finds stairs: flat pieces of equal size in flights of equal steps.

use crate::units::flats::Flat;
use std::collections::HashMap;

/// Rise of a stair over its run, and how much smaller or larger the next tread may be.
const SLOPE: std::ops::RangeInclusive<f32> = 0.2..=1.6;
const NEXT_AREA: std::ops::RangeInclusive<f32> = 0.6..=1.67;
/// Gap between two treads, over their distance.
const TREAD_GAP: f32 = 0.2;
/// Shares by which the rises and runs of one flight differ at most.
const SAME_RISE: f32 = 0.05;
const SAME_RUN: f32 = 0.25;
/// Fewest rises of a flight.
const FEWEST_RISES: usize = 3;
/// Most flat pieces of one cell that are looked at.
const MOST_IN_CELL: usize = 64;

/// The rises of all steps in flights of equal steps.
pub(super) fn rises(flats: &[Flat]) -> Vec<f32> {
    let next = next_treads(flats);
    let mut order: Vec<usize> = (0..flats.len()).collect();
    order.sort_by(|&a, &b| flats[a].bounds.low.y.total_cmp(&flats[b].bounds.low.y));
    let mut is_climbed = vec![false; flats.len()];
    let mut rises = Vec::new();
    for first in order {
        let mut flight: Vec<Step> = Vec::new();
        let mut at = first;
        while let Some(step) = next[at].filter(|_| !is_climbed[at]) {
            if flight.first().is_some_and(|first| !first.is_like(step)) {
                break;
            }
            is_climbed[at] = true;
            flight.push(step);
            at = step.to as usize;
        }
        if flight.len() >= FEWEST_RISES {
            rises.extend(flight.iter().map(|step| step.rise));
        }
    }
    rises
}

/// From one tread to the next.
#[derive(Clone, Copy)]
struct Step {
    to: u32,
    rise: f32,
    run: f32,
}

impl Step {
    fn is_like(self, other: Self) -> bool {
        (other.rise / self.rise - 1.0).abs() <= SAME_RISE && (other.run / self.run - 1.0).abs() <= SAME_RUN
    }
}

/// For each flat piece, the lowest one that may be the next tread above it.
fn next_treads(flats: &[Flat]) -> Vec<Option<Step>> {
    // Pieces by their size, as a power of two, and by cells of that size.
    let magnitude = |flat: &Flat| libm::log2f(flat.area.sqrt()).ceil() as i32;
    let cell = |flat: &Flat, magnitude: i32| {
        let centre = flat.centre() / libm::ldexpf(1.0, magnitude);
        (centre.x.floor() as i32, centre.z.floor() as i32)
    };
    let mut cells: HashMap<(bool, i32, (i32, i32)), Vec<u32>> = HashMap::new();
    for (idx, flat) in (0..).zip(flats).filter(|(_, flat)| flat.area > 0.0) {
        let magnitude = magnitude(flat);
        let of_cell = cells.entry((flat.faces_up, magnitude, cell(flat, magnitude))).or_default();
        if of_cell.len() < MOST_IN_CELL {
            of_cell.push(idx);
        }
    }
    let next = |flat: &Flat| {
        let own = magnitude(flat);
        let near = (own - 1..=own + 1).flat_map(|magnitude| {
            let (x, z) = cell(flat, magnitude);
            // Cells of smaller pieces are smaller.
            let reach = if magnitude < own { 2 } else { 1 };
            let around = (-reach..=reach)
                .flat_map(move |dx| (-reach..=reach).map(move |dz| (x.saturating_add(dx), z.saturating_add(dz))));
            around.map(move |place| (flat.faces_up, magnitude, place))
        });
        let treads = near.filter_map(|key| cells.get(&key)).flatten();
        let steps = treads.filter_map(|&to| step(flat, &flats[to as usize], to));
        steps.min_by(|a, b| a.rise.total_cmp(&b.rise).then(a.to.cmp(&b.to)))
    };
    flats.iter().map(|flat| if flat.area > 0.0 { next(flat) } else { None }).collect()
}

/// The step from one flat piece to another, if both may be treads of a stair.
fn step(from: &Flat, other: &Flat, to: u32) -> Option<Step> {
    let way = other.centre() - from.centre();
    let run = way.with_y(0.0).length();
    let gap = (other.bounds.low - from.bounds.high).max(from.bounds.low - other.bounds.high);
    let is_next = SLOPE.contains(&(way.y / run))
        && NEXT_AREA.contains(&(other.area / from.area))
        && gap.x.max(gap.z) <= TREAD_GAP * run;
    is_next.then_some(Step { to, rise: way.y, run })
}
