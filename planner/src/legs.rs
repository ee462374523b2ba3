//! What a leg is likely to cost that nobody has proved: to the first vertex, from the last, or straight to the goal.
//!
//! Fitted to every probe of a build, so that it knows this policy and this map: a logistic regression of success and a
//! linear one of decisions, both on how far, how high and how deep.

use crate::candidates::Candidate;
use crate::evidence::{Evidence, price};
use crate::ids::EdgeKey;
use crate::regression::{Linear, Logistic, dot, sigmoid};
use serde::{Deserialize, Serialize};
use surefoot_world::{Chance, Decisions, Vec3};

/// Values that a leg is judged by.
const FEATURES: usize = 6;
/// Metres that no character covers more of in a decision on foot.
const MAX_METRES_PER_DECISION: f64 = 2.0;
/// Lowest chance that is distinguished from 0.
const MIN_CHANCE: f64 = 0.02;
/// Highest chance of a leg that nobody has proved.
const MAX_CHANCE: f64 = 0.99;
/// Probes below which the coefficients of [`LegModel::default`] are better.
const MIN_PROBES: usize = 200;

/// Prices of legs that nobody has proved.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LegModel {
    success: [f64; FEATURES],
    decisions: [f64; FEATURES],
    /// Longest leg that it was fitted to, m; beyond, chances multiply and decisions grow in proportion.
    range_m: f64,
}

/// What a leg is likely to take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LegEstimate {
    /// Decisions, if it succeeds.
    pub decisions: Decisions,
    /// Chance of success, above 0.
    pub chance: Chance,
}

impl Default for LegModel {
    /// Fitted to probes of the shipped reactive policy on training maps; for graphs with too few probes of their own.
    fn default() -> Self {
        Self { success: [3.0, -0.6, 0.0, -1.0, -0.4, -0.3], decisions: [3.0, 13.0, 0.0, 6.0, 0.0, 1.0], range_m: 30.0 }
    }
}

fn features(from: Vec3, to: Vec3) -> [f64; FEATURES] {
    let (x, z) = (f64::from(to.x - from.x), f64::from(to.z - from.z));
    let horizontal = (x * x + z * z).sqrt() / 20.0;
    let climb = f64::from((to.y - from.y).max(0.0)) / 5.0;
    let drop = f64::from((from.y - to.y).max(0.0)) / 10.0;
    [1.0, horizontal, horizontal * horizontal, climb, climb * climb, drop]
}

impl LegModel {
    /// Fits the probes of a build; each candidate counts with all its tries.
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

    /// Whether every coefficient is finite.
    pub fn is_finite(&self) -> bool {
        self.success.iter().chain(&self.decisions).all(|value| value.is_finite())
            && self.range_m.is_finite()
            && self.range_m >= 1.0
    }

    /// The decisions of an [`estimate`](Self::estimate) alone.
    pub fn decisions(&self, from: Vec3, to: Vec3) -> Decisions {
        let (features, distance, beyond) = self.look(from, to);
        Decisions((dot(&self.decisions, &features) * beyond).max(Self::least_decisions(distance)))
    }

    /// What the leg from `from` to `to` is likely to take.
    pub fn estimate(&self, from: Vec3, to: Vec3) -> LegEstimate {
        let (features, distance, beyond) = self.look(from, to);
        LegEstimate {
            decisions: Decisions((dot(&self.decisions, &features) * beyond).max(Self::least_decisions(distance))),
            chance: Self::chance(dot(&self.success, &features), beyond),
        }
    }

    /// The price of an [`estimate`](Self::estimate), if it lies below `limit`; what is dearer costs less to find out.
    #[inline]
    pub fn price_below(&self, from: Vec3, to: Vec3, limit: f32, bounds: &Bounds) -> Option<f32> {
        let (features, distance, beyond) = self.look(from, to);
        let decisions = (dot(&self.decisions, &features) * beyond).max(Self::least_decisions(distance));
        let score = dot(&self.success, &features);
        if bounds.of_score(decisions, score) >= limit {
            return None;
        }
        let cost = price(Decisions(decisions), Self::chance(score, beyond)) as f32;
        (cost < limit).then_some(cost)
    }

    fn chance(score: f64, beyond: f64) -> Chance {
        let chance = sigmoid(score).clamp(MIN_CHANCE, MAX_CHANCE);
        Chance::new(if beyond > 1.0 { libm::pow(chance, beyond).max(MIN_CHANCE) } else { chance })
    }

    /// Features of a leg as far as the model was fitted, its length, and how many times that is.
    #[inline]
    fn look(&self, from: Vec3, to: Vec3) -> ([f64; FEATURES], f64, f64) {
        let distance = f64::from(from.distance(to));
        if distance <= self.range_m {
            return (features(from, to), distance, 1.0);
        }
        let beyond = distance / self.range_m;
        (features(from, from + (to - from) / beyond as f32), distance, beyond)
    }

    /// Fewest decisions that any leg of this length is estimated at.
    fn least_decisions(distance: f64) -> f64 {
        distance / MAX_METRES_PER_DECISION
    }

    /// Lower bounds of the price of any leg.
    pub fn bounds(&self) -> Bounds {
        // The most that climbs and drops can do for a leg.
        let luck = most(self.success[3], self.success[4]) + most(self.success[5], 0.0);
        let saved = most(-self.decisions[3], -self.decisions[4]) + most(-self.decisions[5], 0.0);
        let price_of = |metres: usize| {
            let horizontal = metres as f64 / 20.0;
            let flat = [1.0, horizontal, horizontal * horizontal, 0.0, 0.0, 0.0];
            let decisions = (dot(&self.decisions, &flat) - saved).max(Self::least_decisions(metres as f64));
            let chance = sigmoid(dot(&self.success, &flat) + luck).clamp(MIN_CHANCE, MAX_CHANCE);
            price(Decisions(decisions), Chance::new(chance)) as f32
        };
        let by_speed = |metres: usize| Self::least_decisions(metres as f64) as f32;
        let mut least: [f32; METRES] = std::array::from_fn(price_of);
        let fitted = (self.range_m as usize).min(METRES - 1);
        least[fitted..].iter_mut().zip(fitted..).for_each(|(least, metres)| *least = by_speed(metres));
        // A longer leg must not be allowed less than a shorter one is.
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

/// The most that `linear * x + square * x * x` can be for `x` from 0 up.
fn most(linear: f64, square: f64) -> f64 {
    if linear <= 0.0 && square <= 0.0 {
        0.0
    } else if square < 0.0 {
        linear * linear / (-4.0 * square)
    } else {
        f64::INFINITY
    }
}

/// Metres that [`Bounds`] tell apart.
const METRES: usize = 96;
/// Scores, the logarithms of odds, that [`Bounds`] tell apart: so many, from so far below zero.
const SCORES: usize = 72;
const SCORES_PER_UNIT: f64 = 8.0;
const LEAST_SCORE: f64 = 4.0;

/// Lower bounds of the price of unproved legs, by how far they lead on the plane.
#[derive(Debug, Clone)]
pub struct Bounds {
    least: [f32; METRES],
    range_squared: f32,
    /// Steps of scores: what decisions are multiplied by, and what is added for risk, at the best score of the step.
    by_score: [(f64, f64); SCORES],
}

impl Bounds {
    /// Of a leg that takes so many decisions at this score; spares most legs the exponential and the logarithm.
    fn of_score(&self, decisions: f64, score: f64) -> f32 {
        let step = ((score + LEAST_SCORE) * SCORES_PER_UNIT).max(0.0) as usize;
        let (times, risk) = self.by_score[step.min(SCORES - 1)];
        // Rounding may put a bound a hair above what it bounds.
        ((decisions * times + risk) * (1.0 - 1.0e-6)) as f32
    }

    /// Of all legs that lead at least so far on the plane.
    pub fn from_metres(&self, metres: f32) -> f32 {
        let by_speed = LegModel::least_decisions(f64::from(metres)) as f32;
        self.least[(metres as usize).min(METRES - 1)].max(by_speed)
    }

    /// Of a leg with this offset.
    pub fn of(&self, offset: Vec3) -> f32 {
        let on_plane = offset.x * offset.x + offset.z * offset.z;
        if on_plane + offset.y * offset.y >= self.range_squared {
            // The model was not fitted to such: only speed limits.
            return (LegModel::least_decisions(f64::from(on_plane.sqrt()))) as f32;
        }
        self.from_metres(on_plane.sqrt())
    }
}
