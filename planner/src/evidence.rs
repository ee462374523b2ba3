//! Evidence of an edge (tries, successes, decisions), and the cost that follows from it.

use crate::probe::Outcome;
use serde::{Deserialize, Serialize};
use surefoot_world::{Ability, Chance, Decisions, Vec3};

/// Statistics of the probes and traversals of an edge.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// Number of tries: probes and traversals.
    pub tries: u32,
    /// Number of tries that arrived.
    pub successes: u32,
    /// Sum of the decisions of tries that arrived.
    decisions_sum: f64,
    /// Sum of the squares of these decisions.
    decisions_squared: f64,
    /// Ability of the least demanding try that arrived: the most demanding ability that this try used.
    pub ability: Ability,
    /// Expected chance of success without any tries, in [0, 1]. It weighs as much as one try.
    pub prior: f32,
    /// Designers' factor on the cost, 0.1 to 1000; 1 if there is none.
    pub price_factor: f32,
    /// Lower and upper corner of the bounding box of all probes' tracks, m. Without tracks, the lower corner is above the upper.
    pub bounds: [Vec3; 2],
}

impl Default for Evidence {
    fn default() -> Self {
        Self {
            tries: 0,
            successes: 0,
            decisions_sum: 0.0,
            decisions_squared: 0.0,
            ability: Ability::Walk,
            prior: UNKNOWN_PRIOR,
            price_factor: 1.0,
            bounds: [Vec3::splat(f32::MAX), Vec3::splat(f32::MIN)],
        }
    }
}

/// Prior of a candidate edge without a prediction; high, because candidates join vertices that are near each other.
const UNKNOWN_PRIOR: f32 = 0.9;

impl Evidence {
    /// Evidence without any tries, with a prior in [0, 1].
    pub fn expected(prior: f32) -> Self {
        Self { prior, ..Self::default() }
    }

    /// Evidence of an edge that has not been tried yet, with a prior in [0, 1] and the decisions that it is expected to take.
    pub fn of_expected_edge(prior: f32, Decisions(decisions): Decisions) -> Self {
        Self { decisions_sum: decisions, decisions_squared: decisions * decisions, ..Self::expected(prior) }
    }

    /// Returns whether this is the evidence of an edge that has not been tried yet.
    pub fn is_of_expected_edge(&self) -> bool {
        self.tries == 0 && self.decisions_sum > 0.0
    }

    /// Adds the outcome of a probe, and widens the bounds by its track.
    pub fn note_probe(&mut self, outcome: &Outcome) {
        self.note(outcome.reached, outcome.decisions, outcome.ability);
        outcome.bounds.into_iter().for_each(|corner| self.cover(corner));
    }

    /// Returns the sum of this evidence and `other` of the same edge. Ability, prior, factor and bounds are those of `self`.
    pub fn and(&self, other: &Evidence) -> Self {
        // Decisions that were only expected give way to those that were seen.
        let gives_way = self.is_of_expected_edge() && other.successes > 0;
        let own_share = if gives_way { 0.0 } else { 1.0 };
        Self {
            tries: self.tries.saturating_add(other.tries),
            successes: self.successes.saturating_add(other.successes),
            decisions_sum: own_share * self.decisions_sum + other.decisions_sum,
            decisions_squared: own_share * self.decisions_squared + other.decisions_squared,
            ..*self
        }
    }

    /// Halves the weight of all tries.
    pub fn halve(&mut self) {
        let kept = self.successes / 2;
        let share = f64::from(kept) / f64::from(self.successes.max(1));
        self.tries = kept + (self.tries - self.successes) / 2;
        self.successes = kept;
        self.decisions_sum *= share;
        self.decisions_squared *= share;
    }

    /// Reduces the weight of all tries so that they count as at most `limit` tries, at about the same success rate.
    pub fn limit_tries(&mut self, limit: u32) {
        if self.tries <= limit {
            return;
        }
        let (tries, successes) = (u64::from(self.tries), u64::from(self.successes));
        // At most `limit`, since there are no more successes than tries.
        let kept = ((successes * u64::from(limit) + tries / 2) / tries) as u32;
        let share = f64::from(kept) / f64::from(self.successes.max(1));
        (self.tries, self.successes) = (limit, kept);
        self.decisions_sum *= share;
        self.decisions_squared *= share;
    }

    /// Widens the bounds to contain `point`.
    pub fn cover(&mut self, point: Vec3) {
        self.bounds = [self.bounds[0].min(point), self.bounds[1].max(point)];
    }

    /// Adds a try with its number of decisions and the most demanding ability that it used.
    pub fn note(&mut self, reached: bool, decisions: u32, ability: Ability) {
        self.tries += 1;
        if !reached {
            return;
        }
        self.ability = if self.successes == 0 { ability } else { self.ability.min(ability) };
        self.successes += 1;
        self.decisions_sum += f64::from(decisions);
        self.decisions_squared += f64::from(decisions) * f64::from(decisions);
    }

    /// Returns whether probes have run along the edge: forced edges and those of toy graphs have no tracks.
    pub fn has_track(&self) -> bool {
        self.bounds[0].cmple(self.bounds[1]).all()
    }

    /// Returns the share of tries that arrived, in [0, 1]; 0 without tries.
    pub fn success_rate(&self) -> f64 {
        f64::from(self.successes) / f64::from(self.tries.max(1))
    }

    /// Returns the estimated chance of success, at least 0.001: the success rate with the prior added as one try.
    pub fn chance(&self) -> Chance {
        let successes = f64::from(self.successes) + f64::from(self.prior);
        Chance::new((successes / (f64::from(self.tries) + 1.0)).max(MIN_CHANCE))
    }

    /// Returns the mean number of decisions of the tries that arrived; 0 without successes.
    pub fn decisions_mean(&self) -> Decisions {
        Decisions(self.decisions_sum / f64::from(self.successes.max(1)))
    }

    /// Returns the standard deviation of the decisions of the tries that arrived; 0 without successes.
    pub fn decisions_deviation(&self) -> Decisions {
        let mean = self.decisions_mean().0;
        Decisions((self.decisions_squared / f64::from(self.successes.max(1)) - mean * mean).max(0.0).sqrt())
    }

    /// Returns whether the evidence is consistent, and has at least one success, as that of a proved edge must, or is of an expected edge.
    pub fn is_sound(&self) -> bool {
        (self.successes > 0 || self.is_of_expected_edge()) && self.is_consistent()
    }

    /// Returns whether the values are in range and do not contradict each other.
    pub fn is_consistent(&self) -> bool {
        self.successes <= self.tries
            && (0.0..=f64::MAX).contains(&self.decisions_sum)
            && (0.0..=f64::MAX).contains(&self.decisions_squared)
            && (0.0..=1.0).contains(&self.prior)
            && self.price_factor > 0.0
            && self.price_factor.is_finite()
            && self.bounds.iter().all(|corner| corner.is_finite())
    }

    /// Creates the evidence of an edge that a designer forces: one success in `decisions`, and a prior of 1.
    pub fn vouched(Decisions(decisions): Decisions) -> Self {
        Self {
            tries: 1,
            successes: 1,
            decisions_sum: decisions,
            decisions_squared: decisions * decisions,
            prior: 1.0,
            ..Self::default()
        }
    }

    /// Returns the cost that a search minimises, in decisions: the [`price`] of the mean decisions at the estimated chance, times
    /// the designers' factor.
    pub fn cost(&self) -> f64 {
        f64::from(self.price_factor) * price(self.decisions_mean(), self.chance())
    }

    /// Returns whether at least one try succeeded and the success rate reaches `threshold`.
    pub fn proves(&self, threshold: f64) -> bool {
        self.successes > 0 && self.success_rate() >= threshold
    }
}

/// Returns the cost of a leg in decisions: the expected decisions of all tries until one succeeds, plus a term for risk. The
/// term is logarithmic in the chance, because chances multiply along a plan.
pub fn price(decisions: Decisions, chance: Chance) -> f64 {
    decisions.0 / chance.get() - RISK_DECISIONS * libm::log(chance.get())
}

/// Lower bound on the estimated chance of an edge.
const MIN_CHANCE: f64 = 1.0e-3;
/// Weight of risk: the number of additional decisions that a plan may take to avoid a leg with a chance of 1/e.
pub(crate) const RISK_DECISIONS: f64 = 200.0;
