//! The cost model of unproved legs: from the start to the first vertex, from the last vertex to the goal, or straight from
//! start to goal.
//!
//! The model is fitted to all probes of a build, and so to its policy and its map. It combines a logistic regression of
//! success with a linear regression of decisions, both on horizontal distance, climb and drop.

use crate::candidates::Candidate;
use crate::evidence::{Evidence, price};
use crate::ids::EdgeKey;
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

/// Estimates the cost of unproved legs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LegModel {
    /// Coefficients of the log-odds of success.
    success: [f64; FEATURES],
    /// Coefficients of the number of decisions.
    decisions: [f64; FEATURES],
    /// Length of the longest leg in the fit, m. A leg `k` times as long is estimated as `k` legs of this length in a row.
    range_m: f64,
}

/// Estimated decisions and chance of a leg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LegEstimate {
    /// Decisions that the leg takes if it succeeds.
    pub decisions: Decisions,
    /// Chance of success, above 0.
    pub chance: Chance,
}

impl Default for LegModel {
    /// Coefficients fitted to probes of the shipped reactive policy on training maps, for graphs with too few probes of their
    /// own.
    fn default() -> Self {
        Self { success: [3.0, -0.6, 0.0, -1.0, -0.4, -0.3], decisions: [3.0, 13.0, 0.0, 6.0, 0.0, 1.0], range_m: 30.0 }
    }
}

/// Features of a leg: constant, horizontal distance in units of 20 m and its square, climb in units of 5 m and its square,
/// drop in units of 10 m.
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
        Self { success: success.fit(), decisions: decisions.fit(), range_m }
    }

    /// Returns whether every coefficient is finite and the range is at least 1 m.
    pub fn is_finite(&self) -> bool {
        self.success.iter().chain(&self.decisions).all(|value| value.is_finite())
            && self.range_m.is_finite()
            && self.range_m >= 1.0
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
        LegEstimate {
            decisions: Decisions(
                (dot(&self.decisions, &features) * range_multiple).max(Self::least_decisions(distance)),
            ),
            chance: Self::chance(dot(&self.success, &features), range_multiple),
        }
    }

    /// Returns the cost of an [`estimate`](Self::estimate) in decisions if it is below `limit`. Legs above the limit are mostly
    /// rejected by their `bounds`, which is faster.
    #[inline]
    pub fn price_below(&self, from: Vec3, to: Vec3, limit: f32, bounds: &Bounds) -> Option<f32> {
        let (features, distance, range_multiple) = self.features_in_range(from, to);
        let decisions = (dot(&self.decisions, &features) * range_multiple).max(Self::least_decisions(distance));
        let score = dot(&self.success, &features);
        if bounds.of_score(decisions, score) >= limit {
            return None;
        }
        let cost = price(Decisions(decisions), Self::chance(score, range_multiple)) as f32;
        (cost < limit).then_some(cost)
    }

    fn chance(score: f64, range_multiple: f64) -> Chance {
        let chance = sigmoid(score).clamp(MIN_CHANCE, MAX_CHANCE);
        Chance::new(if range_multiple > 1.0 { libm::pow(chance, range_multiple).max(MIN_CHANCE) } else { chance })
    }

    /// Returns the features of a leg, shortened to the range of the fit; the full length, m; and the length as a multiple of
    /// the range, 1 for shorter legs.
    #[inline]
    fn features_in_range(&self, from: Vec3, to: Vec3) -> ([f64; FEATURES], f64, f64) {
        let distance = f64::from(from.distance(to));
        if distance <= self.range_m {
            return (features(from, to), distance, 1.0);
        }
        let range_multiple = distance / self.range_m;
        (features(from, from + (to - from) / range_multiple as f32), distance, range_multiple)
    }

    /// Returns a lower bound on the decisions that a leg of this length takes.
    fn least_decisions(distance: f64) -> f64 {
        distance / MAX_METRES_PER_DECISION
    }

    /// Computes lower bounds on the cost of any leg.
    pub fn bounds(&self) -> Bounds {
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
            price(Decisions(decisions), Chance::new(chance)) as f32
        };
        let by_speed = |metres: usize| Self::least_decisions(metres as f64) as f32;
        let mut least: [f32; METRES] = std::array::from_fn(price_of);
        let fitted = (self.range_m as usize).min(METRES - 1);
        least[fitted..].iter_mut().zip(fitted..).for_each(|(least, metres)| *least = by_speed(metres));
        // A bound must not exceed that of any longer leg.
        for metres in (1..METRES).rev() {
            least[metres - 1] = f32::min(least[metres - 1], least[metres]);
        }
        let by_score = std::array::from_fn(|place| {
            let chance = match place + 1 {
                SCORES => MAX_CHANCE,
                next => sigmoid(next as f64 / SCORES_PER_UNIT - LEAST_SCORE).clamp(MIN_CHANCE, MAX_CHANCE),
            };
            (1.0 / chance, price(Decisions(0.0), Chance::new(chance)))
        });
        Bounds { least, range_squared: (self.range_m * self.range_m) as f32, by_score }
    }
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

/// Number of distances, in steps of 1 m, that [`Bounds`] tabulate.
const METRES: usize = 96;
/// Number of steps of the score (the log-odds of success) that [`Bounds`] tabulate.
const SCORES: usize = 72;
/// Steps per unit of the score.
const SCORES_PER_UNIT: f64 = 8.0;
/// Magnitude of the lowest tabulated score, which is negative.
const LEAST_SCORE: f64 = 4.0;

/// Lower bounds on the cost of unproved legs in decisions, by horizontal distance and by score.
#[derive(Debug, Clone)]
pub struct Bounds {
    /// Bound for each distance, in steps of 1 m.
    least: [f32; METRES],
    /// Square of the fit's range, m2.
    range_squared: f32,
    /// For each step of the score: the factor on decisions and the summand for risk, at the best score of the step.
    by_score: [(f64, f64); SCORES],
}

impl Bounds {
    /// Returns the bound for a leg with these decisions and this score, without computing an exponential or a logarithm.
    fn of_score(&self, decisions: f64, score: f64) -> f32 {
        let step = ((score + LEAST_SCORE) * SCORES_PER_UNIT).max(0.0) as usize;
        let (times, risk) = self.by_score[step.min(SCORES - 1)];
        // Rounding may lift a lower bound slightly above the true cost.
        ((decisions * times + risk) * (1.0 - 1.0e-6)) as f32
    }

    /// Returns the bound for all legs with at least this horizontal distance, m.
    pub fn from_metres(&self, metres: f32) -> f32 {
        let by_speed = LegModel::least_decisions(f64::from(metres)) as f32;
        self.least[(metres as usize).min(METRES - 1)].max(by_speed)
    }

    /// Returns the bound for a leg with this offset from start to end, m.
    pub fn of(&self, offset: Vec3) -> f32 {
        let on_plane = offset.x * offset.x + offset.z * offset.z;
        if on_plane + offset.y * offset.y >= self.range_squared {
            // Beyond the range of the fit, only the speed limit holds.
            return (LegModel::least_decisions(f64::from(on_plane.sqrt()))) as f32;
        }
        self.from_metres(on_plane.sqrt())
    }
}
