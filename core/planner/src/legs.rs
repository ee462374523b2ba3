//! The cost model of unproved legs: from the start to the first vertex, from the last vertex to the goal, or straight
//! from start to goal.
//!
//! The model is fitted to all probes of a build, and so to its policy and its map. It combines a logistic regression of
//! success with a linear regression of decisions, both on horizontal distance, climb and drop.

use crate::build::candidates::Candidate;
use crate::evidence::Evidence;
use crate::ids::EdgeKey;
use crate::price::{Caution, DEATH_DECISIONS, RISK_DECISIONS, price};
use crate::regression::{Linear, Logistic, dot, sigmoid};
use serde::{Deserialize, Serialize};
use surefoot_world::{Chance, Decisions, Vec3};

/// Number of features of a leg.
const FEATURES: usize = 6;
/// Upper bound on the distance that a character covers on foot in one decision, m.
const MAX_METRES_PER_DECISION: f64 = 2.0;
/// Lower bound on the chance of an unproved leg.
const MIN_CHANCE: f64 = 0.02;
/// Upper bound on the chance of an unproved leg.
const MAX_CHANCE: f64 = 0.99;
/// Number of probes below which [`LegModel::default`] is used instead of a fit.
const MIN_PROBES: usize = 200;

/// Greatest magnitude of a coefficient of a model from a file.
const MAX_COEFFICIENT: f64 = 1.0e9;
/// Greatest range of a fit, m.
const MAX_RANGE_M: f64 = 1.0e5;
/// Number of failures at the usual share of deaths that are added to those of a build.
const USUAL_FAILURES: f64 = 10.0;
/// Usual share of deaths among failures.
const USUAL_DEATH_SHARE: f64 = 0.1;

/// Estimates the cost of unproved legs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LegModel {
    /// Coefficients of the log-odds of success.
    success: [f64; FEATURES],
    /// Coefficients of the number of decisions.
    decisions: [f64; FEATURES],
    /// Length of the longest leg in the fit, m. A leg that is `k` times as long is estimated as `k` consecutive legs.
    range_m: f64,
    /// Share of deaths among the legs that fail.
    #[serde(default)]
    death_share: f64,
}

/// Estimated decisions and chances of a leg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LegEstimate {
    /// Decisions that the leg takes if it succeeds.
    pub decisions: Decisions,
    /// Chance of success, above 0.
    pub chance: Chance,
    /// Chance of death, at most `1 - chance`.
    pub death_chance: f64,
}

impl LegEstimate {
    /// Returns the cost that a search of this caution minimises, in decisions.
    pub fn cost_at(&self, caution: Caution) -> f64 {
        price(self.decisions, self.chance, self.death_chance, caution)
    }
}

impl Default for LegModel {
    /// Coefficients fitted to probes of the shipped reactive policy on training maps, for graphs with too few probes of
    /// their own.
    fn default() -> Self {
        Self {
            success: [3.0, -0.6, 0.0, -1.0, -0.4, -0.3],
            decisions: [3.0, 13.0, 0.0, 6.0, 0.0, 1.0],
            range_m: 30.0,
            death_share: USUAL_DEATH_SHARE,
        }
    }
}

/// Features of a leg: constant, horizontal distance in units of 20 m and its square, climb in units of 5 m and its
/// square, drop in units of 10 m.
fn features(from: Vec3, to: Vec3) -> [f64; FEATURES] {
    let (x, z) = (f64::from(to.x - from.x), f64::from(to.z - from.z));
    let horizontal = (x * x + z * z).sqrt() / 20.0;
    let climb = f64::from((to.y - from.y).max(0.0)) / 5.0;
    let drop = f64::from((from.y - to.y).max(0.0)) / 10.0;
    [1.0, horizontal, horizontal * horizontal, climb, climb * climb, drop]
}

impl LegModel {
    /// Fits a model to the probes of a build; each candidate edge is weighted by its tries.
    pub fn fit(vertices: &[Vec3], candidates: &[Candidate], evidence: &[Evidence]) -> Self {
        let probes: usize = evidence.iter().map(|evidence| evidence.tries as usize).sum();
        if probes < MIN_PROBES {
            return Self::default();
        }
        let (mut success, mut decisions) = (Logistic::<FEATURES>::default(), Linear::<FEATURES>::default());
        let mut range_m: f64 = 1.0;
        for (&EdgeKey { from, to }, evidence) in
            candidates.iter().zip(evidence).filter(|(_, evidence)| evidence.tries > 0)
        {
            let (from, to) = (vertices[from.idx()], vertices[to.idx()]);
            let features = features(from, to);
            success.add(features, f64::from(evidence.successes), f64::from(evidence.tries - evidence.successes));
            if evidence.successes > 0 {
                decisions.add(features, evidence.decisions_mean().0);
            }
            range_m = range_m.max(f64::from(from.distance(to)));
        }
        Self {
            success: success.fit(),
            decisions: decisions.fit(),
            range_m,
            death_share: death_share(evidence, USUAL_DEATH_SHARE),
        }
    }

    /// Returns whether every coefficient and the range are such that no estimate overflows.
    pub(crate) fn is_sound(&self) -> bool {
        self.success.iter().chain(&self.decisions).all(|value| value.abs() <= MAX_COEFFICIENT)
            && (1.0..=MAX_RANGE_M).contains(&self.range_m)
            && (0.0..=1.0).contains(&self.death_share)
    }

    /// Returns the length of the longest leg in the fit, m.
    pub fn range_m(&self) -> f64 {
        self.range_m
    }

    /// Returns only the decisions of an [`estimate`](Self::estimate).
    pub fn decisions(&self, from: Vec3, to: Vec3) -> Decisions {
        let (features, distance, range_multiple) = self.features_in_range(from, to);
        Decisions((dot(&self.decisions, &features) * range_multiple).max(Self::least_decisions(distance)))
    }

    /// Estimates the leg from `from` to `to`.
    pub fn estimate(&self, from: Vec3, to: Vec3) -> LegEstimate {
        let (features, distance, range_multiple) = self.features_in_range(from, to);
        let decisions = (dot(&self.decisions, &features) * range_multiple).max(Self::least_decisions(distance));
        let chance = Self::chance(dot(&self.success, &features), range_multiple);
        LegEstimate { decisions: Decisions(decisions), chance, death_chance: self.death_share * (1.0 - chance.get()) }
    }

    fn chance(score: f64, range_multiple: f64) -> Chance {
        let chance = sigmoid(score).clamp(MIN_CHANCE, MAX_CHANCE);
        Chance::new(if range_multiple > 1.0 { libm::pow(chance, range_multiple).max(MIN_CHANCE) } else { chance })
    }

    /// Returns the features of a leg, shortened to the range of the fit; the full length, m; and the length as a
    /// multiple of the range, 1 for shorter legs.
    fn features_in_range(&self, from: Vec3, to: Vec3) -> ([f64; FEATURES], f64, f64) {
        let distance = f64::from(from.distance(to));
        if distance <= self.range_m {
            return (features(from, to), distance, 1.0);
        }
        let range_multiple = distance / self.range_m;
        (features(from, from + (to - from) / range_multiple as f32), distance, range_multiple)
    }

    /// Returns a lower bound on the decisions that a leg of this length takes.
    pub(crate) fn least_decisions(distance: f64) -> f64 {
        distance / MAX_METRES_PER_DECISION
    }

    /// Returns lower bounds on the cost of any leg by its horizontal length in steps of 1 m, in decisions.
    fn least_prices(&self, caution: Caution) -> [f32; METRES] {
        // The most that climbs and drops can improve a leg's score and reduce its decisions.
        let max_score_gain =
            max_of_quadratic(self.success[3], self.success[4]) + max_of_quadratic(self.success[5], 0.0);
        let max_decisions_saved =
            max_of_quadratic(-self.decisions[3], -self.decisions[4]) + max_of_quadratic(-self.decisions[5], 0.0);
        let price_of = |metres: usize| {
            let horizontal = metres as f64 / 20.0;
            let flat = [1.0, horizontal, horizontal * horizontal, 0.0, 0.0, 0.0];
            let decisions =
                (dot(&self.decisions, &flat) - max_decisions_saved).max(Self::least_decisions(metres as f64));
            let chance = sigmoid(dot(&self.success, &flat) + max_score_gain).clamp(MIN_CHANCE, MAX_CHANCE);
            price(Decisions(decisions), Chance::new(chance), self.death_share * (1.0 - chance), caution) as f32
        };
        let by_speed = |metres: usize| Self::least_decisions(metres as f64) as f32;
        let mut least: [f32; METRES] = std::array::from_fn(price_of);
        let fitted = (self.range_m as usize).min(METRES - 1);
        least[fitted..].iter_mut().zip(fitted..).for_each(|(least, metres)| *least = by_speed(metres));
        // A bound must not exceed that of any longer leg.
        for metres in (1..METRES).rev() {
            least[metres - 1] = f32::min(least[metres - 1], least[metres]);
        }
        least
    }
}

/// Returns the share of deaths among the tries that failed, on edges with a success. A few failures with the `usual`
/// share of deaths are added.
pub(crate) fn death_share<'e>(evidence: impl IntoIterator<Item = &'e Evidence>, usual: f64) -> f64 {
    let (mut deaths, mut failures) = (USUAL_FAILURES * usual, USUAL_FAILURES);
    for own in evidence.into_iter().filter(|own| own.successes > 0) {
        deaths += f64::from(own.deaths);
        failures += f64::from(own.tries - own.successes);
    }
    deaths / failures
}

/// Returns the maximum of `linear * x + square * x * x` for `x >= 0`.
fn max_of_quadratic(linear: f64, square: f64) -> f64 {
    if linear <= 0.0 && square <= 0.0 {
        0.0
    } else if square < 0.0 {
        linear * linear / (-4.0 * square)
    } else {
        f64::INFINITY
    }
}

/// Number of distances, in steps of 1 m, whose bounds are tabulated.
const METRES: usize = 96;
/// Number of legs that are priced at a time.
pub(crate) const LANES: usize = 8;

/// The costs of a [`LegModel`]'s legs, tabulated for many legs at a time.
#[derive(Debug, Clone)]
pub(crate) struct LegPrices {
    success: [f32; FEATURES],
    decisions: [f32; FEATURES],
    range_m: f32,
    /// Negative logarithm of the chance, by score: the log-odds of success.
    risk: Curve,
    /// Expected number of tries, by the negative logarithm of the chance.
    tries: Curve,
    /// Cost of the risks of failing and of dying, by the negative logarithm of the chance.
    risk_price: Curve,
    /// Lower bound for each horizontal distance, in steps of 1 m.
    least: [f32; METRES],
}

impl LegPrices {
    /// The costs that a search of this caution minimises.
    pub fn new(model: &LegModel, caution: Caution) -> Self {
        let log_odds = |chance: f64| libm::log(chance / (1.0 - chance));
        Self {
            success: model.success.map(|value| value as f32),
            decisions: model.decisions.map(|value| value as f32),
            range_m: model.range_m as f32,
            risk: Curve::new([log_odds(MIN_CHANCE), log_odds(MAX_CHANCE)], |score| -libm::log(sigmoid(score))),
            tries: Curve::new([-libm::log(MAX_CHANCE), -libm::log(MIN_CHANCE)], libm::exp),
            risk_price: Curve::new([-libm::log(MAX_CHANCE), -libm::log(MIN_CHANCE)], |risk| {
                let death = model.death_share * (1.0 - libm::exp(-risk));
                RISK_DECISIONS * risk - f64::from(caution.get()) * DEATH_DECISIONS * libm::log(1.0 - death)
            }),
            least: model.least_prices(caution),
        }
    }

    /// Returns a horizontal distance beyond which every leg costs more than `cost` decisions, m.
    pub fn metres_below(&self, cost: f32) -> f32 {
        let metres = self.least.partition_point(|&least| least <= cost);
        if metres < METRES { metres as f32 } else { (cost * MAX_METRES_PER_DECISION as f32).max(METRES as f32) }
    }

    /// The costs in decisions of legs with these offsets (x, y, z) from start to end, m, to about a thousandth of a
    /// decision.
    #[inline]
    pub fn of(&self, [x, y, z]: &[[f32; LANES]; 3]) -> [f32; LANES] {
        let (mut decisions, mut scores, mut multiples) = ([0.0; LANES], [0.0; LANES], [1.0; LANES]);
        for lane in 0..LANES {
            let on_plane = x[lane] * x[lane] + z[lane] * z[lane];
            let distance = (on_plane + y[lane] * y[lane]).sqrt();
            // Longer legs than those of the fit are several in a row.
            let multiple = (distance / self.range_m).max(1.0);
            let share = 1.0 / multiple;
            let horizontal = on_plane.sqrt() * (share * (1.0 / 20.0));
            let climb = y[lane].max(0.0) * (share * (1.0 / 5.0));
            let drop = (-y[lane]).max(0.0) * (share * (1.0 / 10.0));
            let features = [1.0, horizontal, horizontal * horizontal, climb, climb * climb, drop];
            let dot = |weights: &[f32; FEATURES]| (0..FEATURES).map(|idx| weights[idx] * features[idx]).sum::<f32>();
            let least = distance * (1.0 / MAX_METRES_PER_DECISION as f32);
            decisions[lane] = (dot(&self.decisions) * multiple).max(least);
            scores[lane] = dot(&self.success);
            multiples[lane] = multiple;
        }
        self.total(&decisions, &scores, &multiples)
    }

    /// The costs of legs with these decisions and scores, each repeated as many times as its multiple.
    fn total(&self, decisions: &[f32; LANES], scores: &[f32; LANES], multiples: &[f32; LANES]) -> [f32; LANES] {
        std::array::from_fn(|lane| {
            let risk = (self.risk.at(scores[lane]) * multiples[lane]).min(self.tries.high);
            decisions[lane] * self.tries.at(risk) + self.risk_price.at(risk)
        })
    }
}

/// Number of intervals of a [`Curve`].
const INTERVALS: usize = 512;

/// A function that is interpolated linearly between evenly spaced values, and constant beyond its ends.
#[derive(Debug, Clone)]
struct Curve {
    low: f32,
    high: f32,
    intervals_per_unit: f32,
    /// Value at the start of each interval, and its change over the interval.
    values: Vec<(f32, f32)>,
}

impl Curve {
    fn new([low, high]: [f64; 2], of: impl Fn(f64) -> f64) -> Self {
        let value = |idx: usize| of(low + (high - low) * idx as f64 / INTERVALS as f64);
        let interval = |idx: usize| (value(idx) as f32, (value(idx + 1) - value(idx)) as f32);
        Self {
            low: low as f32,
            high: high as f32,
            intervals_per_unit: (INTERVALS as f64 / (high - low)) as f32,
            values: (0..INTERVALS).map(interval).collect(),
        }
    }

    #[inline]
    fn at(&self, x: f32) -> f32 {
        let place = ((x - self.low) * self.intervals_per_unit).clamp(0.0, INTERVALS as f32);
        let idx = (place as usize).min(INTERVALS - 1);
        let (value, rise) = self.values[idx];
        value + rise * (place - idx as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tabulated_prices_are_those_of_the_estimate() {
        let model = LegModel::default();
        let prices = LegPrices::new(&model, Caution::CAREFUL);
        let offset = |n: i32| Vec3::new((n * 37 % 121 - 60) as f32, (n * 53 % 41 - 20) as f32 * 0.7, (n % 17) as f32);
        for n in (0..4000).step_by(LANES) {
            let lanes: [Vec3; LANES] = std::array::from_fn(|lane| offset(n + lane as i32));
            let priced = prices.of(&[lanes.map(|it| it.x), lanes.map(|it| it.y), lanes.map(|it| it.z)]);
            for (offset, priced) in lanes.into_iter().zip(priced) {
                let estimate = model.estimate(Vec3::ZERO, offset);
                let exact = estimate.cost_at(Caution::CAREFUL) as f32;
                assert!((priced - exact).abs() <= 2.0e-3 + 1.0e-4 * exact, "{offset}: {priced} instead of {exact}");
                assert!(prices.metres_below(priced * (1.0 + 1.0e-4)) >= libm::hypotf(offset.x, offset.z), "{offset}");
            }
        }
    }
}
