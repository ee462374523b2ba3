//! What searches minimise: the price of edges and unproved legs in decisions, and how much caution adds to it.

use crate::ids::EdgeKey;
use std::collections::{BTreeMap, HashMap};
use std::ops::RangeInclusive;
use surefoot_world::{Ability, Chance, Decisions, Seconds};

/// How far a plan goes to keep the NPC alive, from 0 (bold: a death costs no more than any failure) to 1 (careful).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Caution(f32);

impl Caution {
    /// A death costs most.
    pub const CAREFUL: Self = Self(1.0);
    /// A death costs no more than any failure.
    pub const BOLD: Self = Self(0.0);

    /// Returns this caution; `None` unless it is in [0, 1].
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

/// What plans may pay for an ability, in addition to its time, s.
pub const ABILITY_PRICES: RangeInclusive<f32> = 0.0..=1000.0;

/// What a plan pays for each leg by its most demanding ability, in addition to the leg's time: detours up to this long
/// are preferred.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AbilityPrices(BTreeMap<Ability, Seconds>);

impl AbilityPrices {
    /// Adds to the price of an ability; false, and nothing is changed, unless both are in [`ABILITY_PRICES`] then.
    pub fn add(&mut self, ability: Ability, price: Seconds) -> bool {
        let sum = Seconds(self.seconds(ability).0 + price.0);
        let is_valid = ABILITY_PRICES.contains(&price.0) && ABILITY_PRICES.contains(&sum.0);
        if is_valid && sum.0 > 0.0 {
            self.0.insert(ability, sum);
        }
        is_valid
    }

    /// Whether all abilities are free.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The abilities that have prices, s.
    pub fn iter(&self) -> impl Iterator<Item = (Ability, Seconds)> {
        self.0.iter().map(|(ability, price)| (*ability, *price))
    }

    fn seconds(&self, ability: Ability) -> Seconds {
        self.0.get(&ability).copied().unwrap_or_default()
    }

    /// The price of an ability, in decisions.
    pub(crate) fn of(&self, ability: Ability) -> f32 {
        self.seconds(ability).decisions().0 as f32
    }
}

/// Cost of an edge in decisions, for searches of any caution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeCost {
    /// Cost for careful searches.
    pub careful: f32,
    /// The part of `careful` that the risk of death makes up.
    pub by_death: f32,
}

/// Current costs of the edges whose cost has changed since a graph was prepared for queries.
pub type EdgeCosts = HashMap<EdgeKey, EdgeCost>;

impl EdgeCost {
    /// The cost of an edge on which NPCs also wait for `delay`.
    pub(crate) fn delayed(self, delay: Decisions) -> Self {
        Self { careful: self.careful + delay.0 as f32, ..self }
    }

    /// Returns the cost for a search of this caution.
    pub fn at(self, caution: Caution) -> f32 {
        self.careful - (1.0 - caution.0) * self.by_death
    }
}

/// Returns the cost of a leg in decisions: the expected decisions of all tries until one succeeds, plus terms for the
/// risks of failing and of dying. The terms are logarithmic in the chances, because chances multiply along a plan.
/// `death_chance` is at most `1 - chance`.
pub fn price(decisions: Decisions, chance: Chance, death_chance: f64, caution: Caution) -> f64 {
    decisions.0 / chance.get()
        - RISK_DECISIONS * libm::log(chance.get())
        - f64::from(caution.0) * DEATH_DECISIONS * libm::log(1.0 - death_chance)
}

/// Weight of risk: the number of additional decisions that a plan may take to avoid a leg with a chance of 1/e.
pub(crate) const RISK_DECISIONS: f64 = 200.0;
/// Weight of the risk of death: the number of additional decisions that a careful plan may take to avoid a leg that an
/// NPC survives with a chance of 1/e.
pub(crate) const DEATH_DECISIONS: f64 = 1000.0;
