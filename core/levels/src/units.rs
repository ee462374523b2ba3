//! Suggests a scale for a level that fits no human body, by its stairs, doorways and railings.
//!
//! Says nothing about levels that fit, or that have too few measures to tell.

mod doorways;
mod flats;
mod stairs;

use self::flats::flats;
use crate::named::is_called;
use surefoot_world::{Aabb, Vec3};

/// Diagonal to which a level is brought for measuring: welding joins what is closer than 1/100,000 of it.
const SIZE: f32 = 100.0;
/// Fewest measures that agree, and the share by which the highest is higher than the lowest of them.
const FEWEST: usize = 4;
const AGREE: f64 = 0.15;
/// Share of the largest number of measures of one kind that another kind needs to count.
const MINORITY: f64 = 0.25;
/// Largest sum of distances, as logarithms, by which measures may miss a body's and still suggest a scale.
const MOST_OFF: f64 = 0.5;
/// Side of a level that is hardly one in metres, and a side that would be, m.
const TINY_M: f32 = 4.0;
const SMALL_M: f32 = 10.0;

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Step,
    Doorway,
    Railing,
}

impl Kind {
    /// Heights, m, in levels that may be left as they are: games are generous.
    fn accepted(self) -> [f64; 2] {
        match self {
            Self::Step => [0.04, 2.0],
            Self::Doorway => [1.2, 6.0],
            Self::Railing => [0.4, 2.0],
        }
    }

    fn plural(self) -> &'static str {
        match self {
            Self::Step => "steps",
            Self::Doorway => "doorways",
            Self::Railing => "railings",
        }
    }
}

/// Heights of steps, doorways and railings, m.
type Heights = [[f64; 2]; 3];

/// For a human body, and in levels of Quake's and Sauerbraten's kind, whose players climb high steps.
const HUMAN: Heights = [[0.1, 0.25], [1.9, 2.6], [0.8, 1.2]];
const QUAKE: Heights = [[0.25, 0.5], [2.4, 4.0], [0.8, 1.5]];
const SAUERBRATEN: Heights = [[0.24, 0.6], [1.9, 4.0], [0.8, 1.5]];

/// Well-known units, m, each with what is built in it, and with what a rare unit adds to the distance of its measures:
/// millimetres, centimetres, Source's, inches, Quake's 1/32 m, decimetres, Sauerbraten's (players are 15 units high),
/// feet, and 10, 100 and 1000 m.
const UNITS: [(f64, Heights, f64); 11] = [
    (0.001, HUMAN, 0.0),
    (0.01, HUMAN, 0.0),
    (0.019_05, HUMAN, 0.2),
    (0.025_4, HUMAN, 0.05),
    (0.031_25, QUAKE, 0.2),
    (0.1, HUMAN, 0.2),
    (0.12, SAUERBRATEN, 0.0),
    (0.304_8, HUMAN, 0.1),
    (10.0, HUMAN, 0.0),
    (100.0, HUMAN, 0.0),
    (1000.0, HUMAN, 0.0),
];

/// A scale that would suit a level better.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Suggestion {
    /// Factor by which the scale should be multiplied.
    pub(super) times: f64,
    /// What tells so, such as "38 steps are 4 units high".
    pub(super) evidence: String,
}

/// Suggests a scale for a level of `solids`, m, some of whose nodes have names and boxes; `None` if it fits people or
/// does not tell. `unit_m` is the level's unit at present, m.
pub(super) fn suggest(solids: &[[Vec3; 3]], named: &[(&str, Aabb)], unit_m: f64) -> Option<Suggestion> {
    let bounds = Aabb::around(solids.iter().flatten().copied())?;
    let evidence = evidence(solids, bounds, named);
    if evidence.is_empty() {
        return tiny(bounds.high - bounds.low);
    }
    if evidence.iter().any(Measure::is_accepted) {
        return None;
    }
    let fit = |(times, heights, rare): &(f64, Heights, f64)| {
        let (mut off, mut uncentred) = (*rare, 0.0);
        for measure in &evidence {
            let ([low, high], height) = (heights[measure.kind as usize], measure.height * times);
            off += libm::log(height.clamp(low, high) / height).abs();
            uncentred += libm::log(height * height / (low * high)).abs();
        }
        (off, uncentred, *times)
    };
    let (off, _, times) = UNITS.iter().map(fit).min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)))?;
    let evidence = evidence.iter().map(|measure| measure.text(unit_m)).collect::<Vec<_>>().join(", ");
    (off <= MOST_OFF).then_some(Suggestion { times, evidence })
}

/// A height on which most measures of a kind agree.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Measure {
    kind: Kind,
    /// Height, m.
    height: f64,
    /// Number of measures that agree.
    count: usize,
}

impl Measure {
    /// The median of the heights that agree, if most do.
    fn new(kind: Kind, heights: &mut [f64]) -> Option<Self> {
        heights.sort_by(f64::total_cmp);
        let most = |first: usize| heights[first..].partition_point(|&height| height <= heights[first] * (1.0 + AGREE));
        let largest = (0..heights.len()).map(|first| (most(first), first)).max();
        let (count, first) = largest.filter(|&(count, _)| count >= FEWEST && 2 * count > heights.len())?;
        Some(Self { kind, height: heights[first + count / 2], count })
    }

    /// What was measured, in units of the level of `unit_m` metres.
    fn text(&self, unit_m: f64) -> String {
        let height = self.height / unit_m;
        // Three digits.
        let decimals = (2.0 - libm::floor(libm::log10(height))).clamp(0.0, 6.0) as usize;
        let digits = format!("{height:.decimals$}");
        let digits = if digits.contains('.') { digits.trim_end_matches('0').trim_end_matches('.') } else { &digits };
        format!("{} {} are {digits} units high", self.count, self.kind.plural())
    }

    fn is_accepted(&self) -> bool {
        let [low, high] = self.kind.accepted();
        (low..=high).contains(&self.height)
    }
}

/// What was measured in a level. Kinds with few measures do not count beside those with many.
fn evidence(solids: &[[Vec3; 3]], Aabb { low, high }: Aabb, named: &[(&str, Aabb)]) -> Vec<Measure> {
    let scale = SIZE / (high - low).length();
    if !(scale.is_finite() && scale > 0.0) {
        return Vec::new();
    }
    let near: Vec<[Vec3; 3]> = solids.iter().map(|corners| corners.map(|corner| (corner - low) * scale)).collect();
    let flats = flats(&near);
    let in_metres = |heights: Vec<f32>| heights.into_iter().map(|height| f64::from(height / scale)).collect();
    let mut steps: Vec<f64> = in_metres(stairs::rises(&flats.pieces));
    let mut doorways: Vec<f64> = in_metres(doorways::heights(&flats));
    let begins = |begin: &'static str| {
        let is_meant = move |(name, _): &&(&str, Aabb)| is_called(name, begin);
        named.iter().filter(is_meant).map(|(_, bounds)| f64::from(bounds.high.y - bounds.low.y))
    };
    doorways.extend(begins("door"));
    let mut railings: Vec<f64> = begins("railing").collect();
    let kinds = [(Kind::Step, &mut steps), (Kind::Doorway, &mut doorways), (Kind::Railing, &mut railings)];
    let mut measures: Vec<Measure> =
        kinds.into_iter().filter_map(|(kind, heights)| Measure::new(kind, heights)).collect();
    let most = measures.iter().map(|measure| measure.count).max().unwrap_or(0) as f64;
    measures.retain(|measure| measure.count as f64 >= MINORITY * most);
    measures
}

/// The suggestion for a level that has no measures, but is too small for any character.
fn tiny(span: Vec3) -> Option<Suggestion> {
    let side = span.x.max(span.z);
    let times = [10.0, 100.0, 1000.0].into_iter().find(|times| side * times >= SMALL_M)?;
    let evidence = format!("the level is only {:.2} x {:.2} x {:.2} m", span.x, span.y, span.z);
    (side < TINY_M).then(|| Suggestion { times: f64::from(times), evidence })
}

#[cfg(test)]
mod tests;
