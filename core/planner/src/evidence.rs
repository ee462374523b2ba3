//! Evidence of an edge (tries, successes, deaths, decisions), and the cost that follows from it.

use crate::ids::EdgeKey;
use crate::needs::Needs;
use crate::probe::Outcome;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use surefoot_world::{Ability, Chance, Decisions, Vec3};

/// Statistics of the probes and traversals of an edge.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// Number of tries: probes and traversals.
    pub tries: u32,
    /// Number of tries that arrived.
    pub successes: u32,
    /// Number of tries during which the NPC died.
    #[serde(default)]
    pub deaths: u32,
    /// Sum of the decisions of tries that arrived.
    decisions_sum: f64,
    /// Sum of the squares of these decisions.
    decisions_squared: f64,
    /// Ability of the least demanding try that arrived: the most demanding ability that this try used.
    pub ability: Ability,
    /// Expected chance of success without any tries, in [0, 1]. It weighs as much as one try.
    pub prior: f32,
    /// Expected share of deaths among the tries that fail, in [0, 1]: the chance of death without any tries is this share of the expected
    /// chance of failure.
    #[serde(default)]
    pub death_share: f32,
    /// Designers' factor on the cost, 0.1 to 1000; 1 if there is none.
    pub price_factor: f32,
    /// What the tries that arrived hung on.
    #[serde(default)]
    pub needs: Needs,
    /// Lower and upper corner of the bounding box of all probes' tracks, m. Without tracks, the lower corner is above the upper.
    pub bounds: [Vec3; 2],
}

impl Default for Evidence {
    fn default() -> Self {
        Self {
            tries: 0,
            successes: 0,
            deaths: 0,
            decisions_sum: 0.0,
            decisions_squared: 0.0,
            ability: Ability::Walk,
            prior: UNKNOWN_PRIOR,
            death_share: 0.0,
            price_factor: 1.0,
            needs: Needs::default(),
            bounds: [Vec3::splat(f32::MAX), Vec3::splat(f32::MIN)],
        }
    }
}

/// Prior of a candidate edge without a prediction; high, because candidates join vertices that are near each other.
const UNKNOWN_PRIOR: f32 = 0.9;

/// Allowed factors of designers on the cost of an edge.
pub const FACTORS: std::ops::RangeInclusive<f32> = 0.1..=1000.0;
/// Greatest mean of the decisions of tries, somewhat more than one try can report: no cost or duration overflows.
const MAX_DECISIONS: f64 = 2.0 * u32::MAX as f64;

impl Evidence {
    /// Evidence without any tries, with a prior in [0, 1].
    pub fn expected(prior: f32) -> Self {
        Self { prior, ..Self::default() }
    }

    /// Evidence of tries that were counted elsewhere; the sums are those of the decisions of tries that arrived and of their squares.
    pub(crate) fn counted([tries, successes, deaths]: [u32; 3], [decisions_sum, decisions_squared]: [f64; 2]) -> Self {
        Self { tries, successes, deaths, decisions_sum, decisions_squared, ..Self::default() }
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
        let end = if outcome.died { TryEnd::Died } else { TryEnd::of(outcome.reached) };
        self.note(end, outcome.decisions, outcome.ability);
        outcome.bounds.into_iter().for_each(|corner| self.cover(corner));
        if outcome.reached {
            self.needs.merge(&outcome.needs);
        }
    }

    /// Returns this evidence as that of an edge that is certain and takes the mean decisions of its tries that arrived: its cost is their
    /// number, as in the paper.
    #[must_use]
    pub fn of_steps(&self) -> Self {
        let Decisions(mean) = self.decisions_mean();
        let (tries, successes, deaths) = (1, 1, 0);
        Self {
            tries,
            successes,
            deaths,
            decisions_sum: mean,
            decisions_squared: mean * mean,
            prior: 1.0,
            death_share: 0.0,
            ..*self
        }
    }

    /// Returns the sum of this evidence and `other` of the same edge. Ability, prior, factor and bounds are those of `self`.
    pub fn and(&self, other: &Evidence) -> Self {
        // Decisions that were only expected give way to those that were seen.
        let gives_way = self.is_of_expected_edge() && other.successes > 0;
        let own_share = if gives_way { 0.0 } else { 1.0 };
        Self {
            tries: self.tries.saturating_add(other.tries),
            successes: self.successes.saturating_add(other.successes),
            deaths: self.deaths.saturating_add(other.deaths),
            decisions_sum: own_share * self.decisions_sum + other.decisions_sum,
            decisions_squared: own_share * self.decisions_squared + other.decisions_squared,
            ..*self
        }
    }

    /// Halves the weight of all tries.
    pub fn halve(&mut self) {
        let kept = self.successes / 2;
        let share = f64::from(kept) / f64::from(self.successes.max(1));
        self.deaths /= 2;
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
        self.deaths = ((u64::from(self.deaths) * u64::from(limit) / tries) as u32).min(limit - kept);
        (self.tries, self.successes) = (limit, kept);
        self.decisions_sum *= share;
        self.decisions_squared *= share;
    }

    /// Widens the bounds to contain `point`.
    pub fn cover(&mut self, point: Vec3) {
        self.bounds = [self.bounds[0].min(point), self.bounds[1].max(point)];
    }

    /// Adds a try with its number of decisions and the most demanding ability that it used.
    pub fn note(&mut self, end: TryEnd, decisions: u32, ability: Ability) {
        self.tries += 1;
        self.deaths += u32::from(end == TryEnd::Died);
        if end != TryEnd::Arrived {
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

    /// Returns the estimated chance that a try ends in death, at most that of failing: the share of deaths with the expected one added as
    /// one try.
    pub fn death_chance(&self) -> f64 {
        let deaths = f64::from(self.deaths) + (1.0 - f64::from(self.prior)) * f64::from(self.death_share);
        (deaths / (f64::from(self.tries) + 1.0)).min(1.0 - self.chance().get())
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
        self.successes.checked_add(self.deaths).is_some_and(|ended| ended <= self.tries)
            && (0.0..=MAX_DECISIONS).contains(&self.decisions_mean().0)
            && (0.0..=MAX_DECISIONS * MAX_DECISIONS)
                .contains(&(self.decisions_squared / f64::from(self.successes.max(1))))
            && (0.0..=1.0).contains(&self.prior)
            && (0.0..=1.0).contains(&self.death_share)
            && FACTORS.contains(&self.price_factor)
            && self.bounds.iter().all(|corner| corner.is_finite())
            && self.needs.are_possible()
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

    /// Returns the cost that a careful search minimises, in decisions: the [`price`] of the mean decisions at the estimated chances, times
    /// the designers' factor.
    pub fn cost(&self) -> f64 {
        self.cost_at(Caution::CAREFUL)
    }

    /// Returns the costs that searches minimise, by their caution.
    pub fn edge_cost(&self) -> EdgeCost {
        let careful = self.cost() as f32;
        EdgeCost { careful, by_death: careful - self.cost_at(Caution::BOLD) as f32 }
    }

    /// Returns the cost that a search of this caution minimises, in decisions.
    pub fn cost_at(&self, caution: Caution) -> f64 {
        f64::from(self.price_factor) * price(self.decisions_mean(), self.chance(), self.death_chance(), caution)
    }

    /// Returns whether at least one try succeeded and the success rate reaches `threshold`.
    pub fn proves(&self, threshold: f64) -> bool {
        self.successes > 0 && self.success_rate() >= threshold
    }
}

/// How a try ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TryEnd {
    /// The NPC arrived.
    Arrived,
    /// It made no progress.
    Failed,
    /// It fell out of the map, burnt or drowned.
    Died,
}

impl TryEnd {
    /// The end of a try that nobody died in.
    pub fn of(reached: bool) -> Self {
        if reached { Self::Arrived } else { Self::Failed }
    }
}

/// How much a plan does to avoid that the NPC dies, from 0 (bold: a death costs no more than any failure) to 1 (careful).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Caution(f32);

impl Caution {
    /// Death costs most.
    pub const CAREFUL: Self = Self(1.0);
    /// Death costs no more than any failure.
    pub const BOLD: Self = Self(0.0);

    /// Returns this caution; `None` unless it is 0 to 1.
    pub fn new(caution: f32) -> Option<Self> {
        (0.0..=1.0).contains(&caution).then_some(Self(caution))
    }

    /// Returns the value, in [0, 1].
    pub fn get(self) -> f32 {
        self.0
    }
}

impl Default for Caution {
    fn default() -> Self {
        Self::CAREFUL
    }
}

/// Cost of an edge in decisions, for searches of any caution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeCost {
    /// Cost for careful ones.
    pub careful: f32,
    /// The part of it that the risk of death makes up.
    pub by_death: f32,
}

/// Current costs of edges that have changed since a graph was prepared for queries.
pub type EdgeCosts = HashMap<EdgeKey, EdgeCost>;

impl EdgeCost {
    /// The cost of an edge on which one waits besides.
    pub(crate) fn delayed(self, delay: Decisions) -> Self {
        Self { careful: self.careful + delay.0 as f32, ..self }
    }

    /// Returns the cost for a search of this caution.
    pub fn at(self, caution: Caution) -> f32 {
        self.careful - (1.0 - caution.0) * self.by_death
    }
}

/// Returns the cost of a leg in decisions: the expected decisions of all tries until one succeeds, plus terms for the risks of failing and
/// of dying. These are logarithmic in the chances, because chances multiply along a plan. `death_chance` is at most `1 - chance`.
pub fn price(decisions: Decisions, chance: Chance, death_chance: f64, caution: Caution) -> f64 {
    decisions.0 / chance.get()
        - RISK_DECISIONS * libm::log(chance.get())
        - f64::from(caution.0) * DEATH_DECISIONS * libm::log(1.0 - death_chance)
}

/// Lower bound on the estimated chance of an edge.
const MIN_CHANCE: f64 = 1.0e-3;
/// Weight of risk: the number of additional decisions that a plan may take to avoid a leg with a chance of 1/e.
pub(crate) const RISK_DECISIONS: f64 = 200.0;
/// Weight of the risk of death: the number of additional decisions that a careful plan may take, besides, to avoid a leg that one survives
/// with a chance of 1/e.
pub(crate) const DEATH_DECISIONS: f64 = 1000.0;
