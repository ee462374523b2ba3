//! Evidence of an edge (tries, successes, deaths, decisions), and the estimates that follow from it.

use crate::build::probe::Outcome;
use crate::needs::Needs;
use crate::price::{Caution, EdgeCost, price};
use serde::{Deserialize, Serialize};
use surefoot_world::{Aabb, Ability, Chance, Decisions, Vec3};

/// Statistics of the probes and traversals of an edge.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "Record", into = "Record")]
pub struct Evidence {
    /// Number of tries: probes and traversals.
    pub tries: u32,
    /// Number of tries that arrived.
    pub successes: u32,
    /// Number of tries during which the NPC died.
    pub deaths: u32,
    /// Sum of the decisions of tries that arrived.
    decisions_sum: f64,
    /// Sum of the squares of these decisions.
    decisions_squared: f64,
    /// Decisions that a model expects; `None` once a try has arrived, or if nothing is expected.
    expected: Option<Decisions>,
    /// Ability of the least demanding try that arrived: the most demanding ability that this try used.
    pub ability: Ability,
    /// Expected chance of success without any tries, in [0, 1]. It weighs as much as one try.
    pub prior: f32,
    /// Expected share of deaths among the tries that fail, in [0, 1]: the chance of death without any tries is this
    /// share of the expected chance of failure.
    pub death_share: f32,
    /// Designers' factor on the cost, 0.1 to 1000; 1 if there is none.
    pub price_factor: f32,
    /// The movers that the tries that arrived depended on.
    pub needs: Needs,
    /// Bounding box of the tracks of all probes; `None` without tracks: forced edges and those of toy graphs have none.
    pub bounds: Option<Aabb>,
}

impl Default for Evidence {
    fn default() -> Self {
        Self {
            tries: 0,
            successes: 0,
            deaths: 0,
            decisions_sum: 0.0,
            decisions_squared: 0.0,
            expected: None,
            ability: Ability::WALK,
            prior: UNKNOWN_PRIOR,
            death_share: 0.0,
            price_factor: 1.0,
            needs: Needs::default(),
            bounds: None,
        }
    }
}

/// Prior of a candidate edge without a prediction; high, because candidates join vertices that are near each other.
const UNKNOWN_PRIOR: f32 = 0.9;
/// Lower bound on the estimated chance of an edge.
const MIN_CHANCE: f64 = 1.0e-3;

/// Allowed factors of designers on the cost of an edge.
pub const FACTORS: std::ops::RangeInclusive<f32> = 0.1..=1000.0;
/// Greatest mean of the decisions of tries, somewhat more than one try can report: no cost or duration overflows.
const MAX_DECISIONS: f64 = 2.0 * u32::MAX as f64;

impl Evidence {
    /// Evidence without any tries, with a prior in [0, 1].
    pub fn with_prior(prior: f32) -> Self {
        Self { prior, ..Self::default() }
    }

    /// Evidence of tries that were counted elsewhere; the sums are those of the decisions of tries that arrived and of
    /// their squares.
    pub(crate) fn counted([tries, successes, deaths]: [u32; 3], [decisions_sum, decisions_squared]: [f64; 2]) -> Self {
        Self { tries, successes, deaths, decisions_sum, decisions_squared, ..Self::default() }
    }

    /// Evidence of an edge that has not been tried yet, with a prior in [0, 1] and the decisions that a model expects.
    pub fn expected(prior: f32, decisions: Decisions) -> Self {
        Self { expected: Some(decisions), ..Self::with_prior(prior) }
    }

    /// Evidence of an edge that a designer forces: one success in `decisions`, and a prior of 1.
    pub fn forced(decisions: Decisions) -> Self {
        Self { tries: 1, successes: 1, ..Self::with_prior(1.0) }.with_mean(decisions)
    }

    /// Returns evidence without any tries, whose prior is what this evidence expects.
    #[must_use]
    pub(crate) fn as_prior(&self) -> Self {
        let Self { ability, death_share, price_factor, .. } = *self;
        Self { ability, death_share, price_factor, ..Self::with_prior(self.chance().get() as f32) }
    }

    /// Returns this evidence as that of an edge that is certain and costs the mean decisions of its tries that arrived,
    /// which is the metric of the paper.
    #[must_use]
    pub fn priced_by_decisions(&self) -> Self {
        let certain = Self { tries: 1, successes: 1, deaths: 0, prior: 1.0, death_share: 0.0, expected: None, ..*self };
        certain.with_mean(self.decisions_mean())
    }

    /// Returns this evidence of one success, which took `decisions`.
    fn with_mean(self, Decisions(decisions): Decisions) -> Self {
        Self { decisions_sum: decisions, decisions_squared: decisions * decisions, ..self }
    }

    /// Returns whether this is the evidence of an edge that has not been tried yet.
    pub fn is_expected(&self) -> bool {
        self.tries == 0 && self.expected.is_some()
    }

    /// Adds the outcome of a probe, and widens the bounds by its track.
    pub fn note_probe(&mut self, outcome: &Outcome) {
        let end = if outcome.died { TryEnd::Died } else { TryEnd::of(outcome.reached) };
        self.note(end, outcome.decisions, outcome.ability);
        outcome.bounds.into_iter().for_each(|corner| self.widen_bounds(corner));
        if outcome.reached {
            self.needs.merge(&outcome.needs);
        }
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
        self.expected = None;
    }

    /// Widens the bounds to contain `point`.
    pub fn widen_bounds(&mut self, point: Vec3) {
        let point = Aabb::at(point);
        self.bounds = Some(self.bounds.map_or(point, |bounds| bounds.union(point)));
    }

    /// Returns the sum of this evidence and `other` of the same edge. Ability, prior, factor and bounds are those of
    /// `self`.
    #[must_use]
    pub fn combined(&self, other: &Evidence) -> Self {
        Self {
            tries: self.tries.saturating_add(other.tries),
            successes: self.successes.saturating_add(other.successes),
            deaths: self.deaths.saturating_add(other.deaths),
            decisions_sum: self.decisions_sum + other.decisions_sum,
            decisions_squared: self.decisions_squared + other.decisions_squared,
            expected: self.expected.filter(|_| other.successes == 0),
            ..*self
        }
    }

    /// Halves the weight of all tries.
    pub fn halve(&mut self) {
        let kept = self.successes / 2;
        self.deaths /= 2;
        self.tries = kept + (self.tries - self.successes) / 2;
        self.keep_successes(kept);
    }

    /// Reduces the weight of all tries so that they count as at most `limit` tries, at about the same success rate.
    pub fn limit_tries(&mut self, limit: u32) {
        if self.tries <= limit {
            return;
        }
        let (tries, successes) = (u64::from(self.tries), u64::from(self.successes));
        // At most `limit`, since there are no more successes than tries.
        let kept = ((successes * u64::from(limit) + tries / 2) / tries) as u32;
        self.deaths = ((u64::from(self.deaths) * u64::from(limit) / tries) as u32).min(limit - kept);
        self.tries = limit;
        self.keep_successes(kept);
    }

    /// Reduces the number of successes, at the same mean of their decisions.
    fn keep_successes(&mut self, kept: u32) {
        let share = f64::from(kept) / f64::from(self.successes.max(1));
        self.successes = kept;
        self.decisions_sum *= share;
        self.decisions_squared *= share;
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

    /// Returns the estimated chance that a try ends in death, at most that of failing: deaths per try, with the
    /// expected share added as one try.
    pub fn death_chance(&self) -> f64 {
        let deaths = f64::from(self.deaths) + (1.0 - f64::from(self.prior)) * f64::from(self.death_share);
        (deaths / (f64::from(self.tries) + 1.0)).min(1.0 - self.chance().get())
    }

    /// Returns the mean number of decisions of the tries that arrived. Without successes: the expected decisions, or 0.
    pub fn decisions_mean(&self) -> Decisions {
        self.expected.unwrap_or(Decisions(self.decisions_sum / f64::from(self.successes.max(1))))
    }

    /// Returns the standard deviation of the decisions of the tries that arrived; 0 without successes.
    pub fn decisions_deviation(&self) -> Decisions {
        let mean = self.decisions_mean().0;
        Decisions((self.decisions_squared / f64::from(self.successes.max(1)) - mean * mean).max(0.0).sqrt())
    }

    /// Returns whether the evidence is consistent, and that of an edge: one with a success, or an expected one.
    pub fn is_sound(&self) -> bool {
        (self.successes > 0 || self.is_expected()) && self.is_consistent()
    }

    /// Returns whether the values are in range and do not contradict each other.
    pub fn is_consistent(&self) -> bool {
        let squared_mean = self.decisions_squared / f64::from(self.successes.max(1));
        self.successes.checked_add(self.deaths).is_some_and(|ended| ended <= self.tries)
            && (0.0..=MAX_DECISIONS).contains(&self.decisions_mean().0)
            && (0.0..=MAX_DECISIONS * MAX_DECISIONS).contains(&squared_mean)
            && (0.0..=1.0).contains(&self.prior)
            && (0.0..=1.0).contains(&self.death_share)
            && FACTORS.contains(&self.price_factor)
            && self.bounds.is_none_or(|bounds| bounds.low.is_finite() && bounds.high.is_finite())
            && self.needs.are_possible()
    }

    /// Returns the cost that a careful search minimises, in decisions: the [`price`] of the mean decisions at the
    /// estimated chances, times the designers' factor.
    pub fn cost(&self) -> f64 {
        self.cost_at(Caution::CAREFUL)
    }

    /// Returns the cost that a search of this caution minimises, in decisions.
    pub fn cost_at(&self, caution: Caution) -> f64 {
        f64::from(self.price_factor) * price(self.decisions_mean(), self.chance(), self.death_chance(), caution)
    }

    /// Returns the costs that searches minimise, by their caution.
    pub fn edge_cost(&self) -> EdgeCost {
        let careful = self.cost() as f32;
        EdgeCost { careful, by_death: careful - self.cost_at(Caution::BOLD) as f32 }
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
    /// The end of a try that the NPC survived.
    pub fn of(reached: bool) -> Self {
        if reached { Self::Arrived } else { Self::Failed }
    }
}

/// Evidence as files have it.
#[derive(Serialize, Deserialize)]
struct Record {
    tries: u32,
    successes: u32,
    #[serde(default)]
    deaths: u32,
    /// Without successes: the expected decisions, or 0.
    decisions_sum: f64,
    decisions_squared: f64,
    ability: Ability,
    prior: f32,
    #[serde(default)]
    death_share: f32,
    price_factor: f32,
    #[serde(default)]
    needs: Needs,
    /// Lower and upper corner, m. Without tracks, the lower corner is above the upper.
    bounds: [Vec3; 2],
}

impl From<Record> for Evidence {
    fn from(record: Record) -> Self {
        let Record { tries, successes, deaths, ability, prior, death_share, price_factor, needs, .. } = record;
        let [low, high] = record.bounds;
        let is_expected = successes == 0 && record.decisions_sum > 0.0;
        let sums = if is_expected { [0.0; 2] } else { [record.decisions_sum, record.decisions_squared] };
        Self {
            expected: is_expected.then_some(Decisions(record.decisions_sum)),
            ability,
            prior,
            death_share,
            price_factor,
            needs,
            bounds: (!low.cmpgt(high).any()).then_some(Aabb { low, high }),
            ..Self::counted([tries, successes, deaths], sums)
        }
    }
}

impl From<Evidence> for Record {
    fn from(evidence: Evidence) -> Self {
        let Evidence { tries, successes, deaths, ability, prior, death_share, price_factor, needs, .. } = evidence;
        let sums = match evidence.expected {
            Some(Decisions(expected)) => [expected, expected * expected],
            None => [evidence.decisions_sum, evidence.decisions_squared],
        };
        let [decisions_sum, decisions_squared] = sums;
        let bounds = evidence.bounds.map_or([Vec3::MAX, Vec3::MIN], |Aabb { low, high }| [low, high]);
        Self {
            tries,
            successes,
            deaths,
            decisions_sum,
            decisions_squared,
            ability,
            prior,
            death_share,
            price_factor,
            needs,
            bounds,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn expected_decisions_count_until_a_try_arrives() {
        let mut evidence = Evidence::expected(0.8, Decisions(40.0));
        assert!(evidence.is_expected() && evidence.is_sound());
        let mut failure = Evidence::default();
        failure.note(TryEnd::Failed, 9, Ability::WALK);
        let failed = evidence.combined(&failure);
        assert!(failed.decisions_mean() == Decisions(40.0) && failed.chance().get() < evidence.chance().get());
        assert!(!failed.is_sound(), "tried, but without a success");
        evidence.note(TryEnd::Arrived, 10, Ability::WALK);
        assert!(evidence.decisions_mean() == Decisions(10.0) && !evidence.is_expected());
    }

    #[test]
    fn evidence_comes_back_from_its_record() {
        let mut probed = Evidence::forced(Decisions(7.0));
        probed.widen_bounds(Vec3::ONE);
        probed.widen_bounds(Vec3::X);
        for evidence in [Evidence::default(), Evidence::expected(0.5, Decisions(3.0)), probed] {
            let back: Evidence = postcard::from_bytes(&postcard::to_stdvec(&evidence).unwrap()).unwrap();
            assert_eq!(back, evidence);
        }
    }
}
