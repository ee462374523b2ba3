//! What trying an edge has shown: tries, successes, decisions taken, and what follows from them for its price.

use crate::probe::Outcome;
use serde::{Deserialize, Serialize};
use surefoot_world::{Ability, Chance, Decisions, Vec3};

/// What probing an edge showed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// Probes run.
    pub tries: u32,
    /// Probes that arrived.
    pub successes: u32,
    /// Sum of the decisions of those that arrived.
    decisions_sum: f64,
    /// Sum of their squares.
    decisions_squared: f64,
    /// Ability used by the least demanding probe that arrived.
    pub ability: Ability,
    /// Chance of success that was expected before the first probe, in [0, 1]; it counts as much as one probe.
    pub prior: f32,
    /// Factor on the price, where a designer set one; 1 otherwise.
    pub price_factor: f32,
    /// Corners of the box around all ways taken, m; the lower is above the upper where there were none.
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

/// Expected chance of a candidate of which nothing is known; high, because candidates are near one another.
const UNKNOWN_PRIOR: f32 = 0.9;

impl Evidence {
    /// Adds one probe with the time that it took.
    pub fn note_probe(&mut self, outcome: &Outcome) {
        self.note(outcome.reached, outcome.decisions, outcome.ability);
        outcome.bounds.into_iter().for_each(|corner| self.cover(corner));
    }

    /// These tries and others of the same edge; ability and prior stay.
    pub fn and(&self, other: &Evidence) -> Self {
        Self {
            tries: self.tries.saturating_add(other.tries),
            successes: self.successes.saturating_add(other.successes),
            decisions_sum: self.decisions_sum + other.decisions_sum,
            decisions_squared: self.decisions_squared + other.decisions_squared,
            ..*self
        }
    }

    /// Lets everything count half.
    pub fn halve(&mut self) {
        let kept = self.successes / 2;
        let share = f64::from(kept) / f64::from(self.successes.max(1));
        self.tries = kept + (self.tries - self.successes) / 2;
        self.successes = kept;
        self.decisions_sum *= share;
        self.decisions_squared *= share;
    }

    /// Widens the bounds so that they hold `point`.
    pub fn cover(&mut self, point: Vec3) {
        self.bounds = [self.bounds[0].min(point), self.bounds[1].max(point)];
    }

    /// Adds one probe.
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

    /// Share of probes that arrived, in [0, 1].
    pub fn success_rate(&self) -> f64 {
        f64::from(self.successes) / f64::from(self.tries.max(1))
    }

    /// Estimated chance of success, above 0: tries pulled towards the prior.
    pub fn chance(&self) -> Chance {
        let successes = f64::from(self.successes) + f64::from(self.prior);
        Chance::new((successes / (f64::from(self.tries) + 1.0)).max(MIN_CHANCE))
    }

    /// Mean decisions of probes that arrived.
    pub fn decisions_mean(&self) -> Decisions {
        Decisions(self.decisions_sum / f64::from(self.successes.max(1)))
    }

    /// Standard deviation of those decisions.
    pub fn decisions_deviation(&self) -> Decisions {
        let mean = self.decisions_mean().0;
        Decisions((self.decisions_squared / f64::from(self.successes.max(1)) - mean * mean).max(0.0).sqrt())
    }

    /// Whether its numbers can have come from probes that prove an edge.
    pub fn is_sound(&self) -> bool {
        self.successes > 0 && self.is_consistent()
    }

    /// Whether its numbers can have come from probes at all.
    pub fn is_consistent(&self) -> bool {
        self.successes <= self.tries
            && (0.0..=f64::MAX).contains(&self.decisions_sum)
            && (0.0..=f64::MAX).contains(&self.decisions_squared)
            && (0.0..=1.0).contains(&self.prior)
            && self.price_factor > 0.0
            && self.price_factor.is_finite()
            && self.bounds.iter().all(|corner| corner.is_finite())
    }

    /// Evidence of a leg that somebody vouches for: one success that took `decisions`.
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

    /// What a search minimises: the [price] of its decisions at its chance, times a designer's factor.
    pub fn cost(&self) -> f64 {
        f64::from(self.price_factor) * price(self.decisions_mean(), self.chance())
    }

    /// Whether enough tries succeeded for an edge.
    pub fn proves(&self, threshold: f64) -> bool {
        self.successes > 0 && self.success_rate() >= threshold
    }
}

/// Expected time of a leg in decisions, what is lost by failing included: tries until one succeeds, plus a price on
/// risk. Chances multiply along a plan, so their logarithms add.
pub fn price(decisions: Decisions, chance: Chance) -> f64 {
    decisions.0 / chance.get() - RISK_DECISIONS * libm::log(chance.get())
}

/// Lowest chance that is distinguished from 0.
const MIN_CHANCE: f64 = 1.0e-3;
/// Decisions that a plan may last longer to avoid a leg that fails with probability 1 - 1/e.
const RISK_DECISIONS: f64 = 60.0;
