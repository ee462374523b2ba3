//! Abilities: the moves that a leg can need.

use serde::{Deserialize, Serialize};
use strum::VariantArray;

/// The most demanding ability that a leg needs, ordered from the least demanding.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Default,
    Serialize,
    Deserialize,
    strum::VariantArray,
    strum::IntoStaticStr,
    strum::EnumString,
)]
#[strum(serialize_all = "snake_case")]
pub enum Ability {
    /// Walking, sliding or dropping.
    #[default]
    Walk,
    /// A jump from the ground.
    Jump,
    /// A second jump in the air.
    DoubleJump,
    /// A jump pad.
    Pad,
    /// A zip line.
    ZipLine,
    /// A teleporter.
    Teleporter,
    /// A jetpack's thrust.
    Jetpack,
}

impl Ability {
    /// All abilities, the least demanding first.
    pub const ALL: &[Ability] = Self::VARIANTS;
    /// Jumps, from the ground and in the air.
    pub const JUMPS: [Ability; 2] = [Self::Jump, Self::DoubleJump];

    /// Name in snake case, as used in reports and exports.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// A set of abilities: those that a body used in a tick or a decision, or those that a query rules out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(from = "[bool; 6]", into = "[bool; 6]")]
pub struct AbilitySet(u8);

impl AbilitySet {
    /// Whether the set is empty.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether the set has an ability.
    pub fn contains(self, ability: Ability) -> bool {
        self.0 & 1 << ability as u8 != 0
    }

    /// Whether a device took hold of the body: a pad, zip line or teleporter.
    pub fn meets_device(self) -> bool {
        [Ability::Pad, Ability::ZipLine, Ability::Teleporter].into_iter().any(|device| self.contains(device))
    }

    /// Adds an ability.
    pub fn insert(&mut self, ability: Ability) {
        self.0 |= 1 << ability as u8;
    }

    /// The abilities of this set or of `other`.
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The abilities of this set that `other` lacks.
    pub fn difference(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// The abilities of the set, the least demanding first.
    pub fn iter(self) -> impl Iterator<Item = Ability> {
        Ability::ALL.iter().copied().filter(move |ability| self.contains(*ability))
    }

    /// The most demanding ability of the set; [`Ability::Walk`] if it is empty.
    pub fn most_demanding(self) -> Ability {
        self.iter().last().unwrap_or_default()
    }

    /// Whether `ability` is impossible without the abilities of this set. Double jumps begin with a jump.
    pub fn rules_out(self, ability: Ability) -> bool {
        self.contains(ability) || (ability == Ability::DoubleJump && self.contains(Ability::Jump))
    }
}

impl FromIterator<Ability> for AbilitySet {
    fn from_iter<T: IntoIterator<Item = Ability>>(abilities: T) -> Self {
        abilities.into_iter().fold(Self::default(), |mut set, ability| {
            set.insert(ability);
            set
        })
    }
}

/// Stored states hold one boolean for each ability but walking.
impl From<[bool; 6]> for AbilitySet {
    fn from(has: [bool; 6]) -> Self {
        Ability::ALL[1..].iter().zip(has).filter(|(_, has)| *has).map(|(ability, _)| *ability).collect()
    }
}

impl From<AbilitySet> for [bool; 6] {
    fn from(set: AbilitySet) -> Self {
        std::array::from_fn(|idx| set.contains(Ability::ALL[idx + 1]))
    }
}
