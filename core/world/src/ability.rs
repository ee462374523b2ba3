//! Abilities: the moves of the table that a leg can need. docs/adr/0064-moves-are-data.md says where this leads.

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::cmp::Ordering;

/// A move of [`MOVES`], by its place there, or a move of the body's own. Legs need the most demanding one, and the more
/// demanding of two is the greater one.
/// Text formats have its name in camel case, binary ones its number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Ability(u8);

/// A move that bodies can make.
#[derive(Debug)]
pub struct Move {
    /// Name in snake case, as in reports, exports and queries.
    pub id: &'static str,
    /// What it does to a body.
    pub motion: Motion,
}

/// What a move does to a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// The body walks, slides or drops.
    Walk,
    /// The body jumps from the ground.
    Jump,
    /// The body jumps in the air.
    AirJump,
    /// A device throws the body.
    Throw,
    /// The body rides along a line.
    Ride,
    /// The body is somewhere else at once.
    Teleport,
    /// The body is pushed up as long as it wants to be.
    Thrust,
    /// The body moves along the face that it touches, as long as it wants to move into it.
    Surface,
    /// The body pulls itself up to the ledge above the face that it touches, as long as it wants to move into it.
    Pull,
    /// The body floats in water.
    Swim,
    /// The body makes itself lower.
    Crouch,
    /// The body flies straight ahead for a moment.
    Dash,
    /// The body runs along an upright face in the air.
    WallRun,
    /// The body keeps its speed while it is low.
    Slide,
    /// The body swims below what reaches into the water.
    Dive,
    /// What the body's profile says.
    Own,
}

impl Motion {
    /// How demanding a motion is. Moves that begin at certain places are more demanding than those that a body makes
    /// anywhere.
    fn demand(self) -> u8 {
        match self {
            Self::Walk => 0,
            Self::Crouch => 1,
            Self::Slide => 2,
            Self::Jump => 3,
            Self::AirJump => 4,
            Self::Throw => 5,
            Self::Ride => 6,
            Self::Teleport => 7,
            Self::Thrust => 8,
            Self::Pull => 9,
            Self::Swim => 10,
            Self::Dive => 11,
            Self::Surface => 12,
            Self::Dash => 13,
            Self::WallRun => 14,
            Self::Own => 15,
        }
    }
}

const fn made(id: &'static str, motion: Motion) -> Move {
    Move { id, motion }
}

/// All moves that every body may have.
pub const MOVES: [Move; 15] = [
    made("walk", Motion::Walk),
    made("jump", Motion::Jump),
    made("double_jump", Motion::AirJump),
    made("pad", Motion::Throw),
    made("zip_line", Motion::Ride),
    made("teleporter", Motion::Teleport),
    made("jetpack", Motion::Thrust),
    made("climb", Motion::Surface),
    made("mantle", Motion::Pull),
    made("swim", Motion::Swim),
    made("crouch", Motion::Crouch),
    made("dash", Motion::Dash),
    made("wall_run", Motion::WallRun),
    made("slide", Motion::Slide),
    made("dive", Motion::Dive),
];

/// Place of the first move of a body's own.
const OWN_BEGIN: u8 = 16;
/// Most moves of a body's own.
pub const MAX_OWN_MOVES: usize = 16;
/// Names of the moves of a body's own where its profile is not known.
const OWN_NAMES: [&str; MAX_OWN_MOVES] = [
    "own_1", "own_2", "own_3", "own_4", "own_5", "own_6", "own_7", "own_8", "own_9", "own_10", "own_11", "own_12",
    "own_13", "own_14", "own_15", "own_16",
];

impl Ability {
    /// Walking, sliding or dropping.
    pub const WALK: Self = Self(0);
    /// A jump from the ground.
    pub const JUMP: Self = Self(1);
    /// A second jump in the air.
    pub const DOUBLE_JUMP: Self = Self(2);
    /// A jump pad.
    pub const PAD: Self = Self(3);
    /// A zip line.
    pub const ZIP_LINE: Self = Self(4);
    /// A teleporter.
    pub const TELEPORTER: Self = Self(5);
    /// A jetpack's thrust.
    pub const JETPACK: Self = Self(6);
    /// Climbing a ladder, a net or a wall.
    pub const CLIMB: Self = Self(7);
    /// Pulling oneself up to a ledge.
    pub const MANTLE: Self = Self(8);
    /// Swimming.
    pub const SWIM: Self = Self(9);
    /// Going under what is lower than the body.
    pub const CROUCH: Self = Self(10);
    /// A dash in the air.
    pub const DASH: Self = Self(11);
    /// Running along a wall.
    pub const WALL_RUN: Self = Self(12);
    /// Sliding under what is lower than the body.
    pub const SLIDE: Self = Self(13);
    /// Swimming below what reaches into the water.
    pub const DIVE: Self = Self(14);
    /// Jumps, from the ground and in the air.
    pub const JUMPS: [Self; 2] = [Self::JUMP, Self::DOUBLE_JUMP];

    /// The abilities of [`MOVES`].
    pub fn all() -> impl DoubleEndedIterator<Item = Self> + ExactSizeIterator {
        (0..MOVES.len() as u8).map(Self)
    }

    /// The ability at a place of the table, or of the bodies' own moves after it.
    pub fn at(idx: usize) -> Option<Self> {
        let ability = Self(u8::try_from(idx).ok()?);
        (idx < MOVES.len() || ability.own_idx().is_some_and(|own| own < MAX_OWN_MOVES)).then_some(ability)
    }

    /// The move of a body's own with this place in its profile, below [`MAX_OWN_MOVES`].
    pub fn own(idx: usize) -> Self {
        Self(OWN_BEGIN + idx.min(MAX_OWN_MOVES - 1) as u8)
    }

    /// Place of a move of the body's own in its profile; `None` for the moves of [`MOVES`].
    pub fn own_idx(self) -> Option<usize> {
        self.0.checked_sub(OWN_BEGIN).map(usize::from)
    }

    /// The ability of [`MOVES`] with this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::all().find(|ability| ability.name() == name)
    }

    /// Its place in the table.
    pub fn idx(self) -> usize {
        usize::from(self.0)
    }

    /// Name in snake case, as used in reports and exports; [`CharacterProfile::move_name`] knows those of own moves.
    ///
    /// [`CharacterProfile::move_name`]: crate::CharacterProfile::move_name
    pub fn name(self) -> &'static str {
        self.own_idx().map_or_else(|| MOVES[self.idx()].id, |idx| OWN_NAMES[idx])
    }

    /// What it does to a body.
    pub fn motion(self) -> Motion {
        if self.own_idx().is_some() { Motion::Own } else { MOVES[self.idx()].motion }
    }
}

impl Ord for Ability {
    fn cmp(&self, other: &Self) -> Ordering {
        self.motion().demand().cmp(&other.motion().demand()).then(self.0.cmp(&other.0))
    }
}

impl PartialOrd for Ability {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Serialize for Ability {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if serializer.is_human_readable() {
            serializer.serialize_str(&in_camel_case(self.name()))
        } else {
            serializer.serialize_u8(self.0)
        }
    }
}

impl<'de> Deserialize<'de> for Ability {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        if !deserializer.is_human_readable() {
            return Self::try_from(u8::deserialize(deserializer)?).map_err(D::Error::custom);
        }
        let name = String::deserialize(deserializer)?;
        let own = (0..MAX_OWN_MOVES).map(Self::own);
        let found = Self::all().chain(own).find(|ability| in_camel_case(ability.name()) == name);
        found.ok_or_else(|| D::Error::custom(format!("`{name}` is no ability")))
    }
}

/// A name in snake case, in camel case.
fn in_camel_case(name: &str) -> String {
    let words = name.split('_').map(|word| {
        let (first, rest) = word.split_at(word.len().min(1));
        first.to_uppercase() + rest
    });
    words.collect()
}

impl From<Ability> for u8 {
    fn from(ability: Ability) -> Self {
        ability.0
    }
}

impl TryFrom<u8> for Ability {
    type Error = NoAbility;

    fn try_from(idx: u8) -> Result<Self, NoAbility> {
        Self::at(idx.into()).ok_or(NoAbility(idx))
    }
}

/// There is no ability with this number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("there is no ability {0}: there are {count}", count = MOVES.len())]
pub struct NoAbility(u8);

/// A set of abilities: those that a body used in a tick or a decision, or those that a query rules out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct AbilitySet(u64);

impl AbilitySet {
    /// Whether the set is empty.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether the set has an ability.
    pub fn contains(self, ability: Ability) -> bool {
        self.0 & 1 << ability.0 != 0
    }

    /// Whether a device took hold of the body: a pad, zip line or teleporter.
    pub fn meets_device(self) -> bool {
        self.iter().any(|ability| matches!(ability.motion(), Motion::Throw | Motion::Ride | Motion::Teleport))
    }

    /// Adds an ability.
    pub fn insert(&mut self, ability: Ability) {
        self.0 |= 1 << ability.0;
    }

    /// The abilities of this set or of `other`.
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The abilities of this set that `other` lacks.
    pub fn difference(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// The abilities of the set, in the order of the table.
    pub fn iter(self) -> impl Iterator<Item = Ability> {
        let mut left = self.0;
        std::iter::from_fn(move || {
            let idx = left.trailing_zeros();
            left &= left.wrapping_sub(1);
            Ability::at(idx as usize)
        })
    }

    /// The most demanding ability of the set; [`Ability::WALK`] if it is empty.
    pub fn most_demanding(self) -> Ability {
        self.iter().max().unwrap_or_default()
    }

    /// Whether `ability` is impossible without the abilities of this set. Double jumps begin with a jump.
    pub fn rules_out(self, ability: Ability) -> bool {
        self.contains(ability) || (ability == Ability::DOUBLE_JUMP && self.contains(Ability::JUMP))
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
