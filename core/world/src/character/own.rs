//! Moves that a body brings along, at the [spots](Spot) of a map.

use crate::Vec3;
use crate::ability::{Ability, MAX_OWN_MOVES};
use crate::map::spot::{MAX_TAG_LEN, Spot, is_tag};
use serde::{Deserialize, Serialize};

/// A move of a body's own. In files, fields that its motion does not use may be missing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OwnMove {
    /// Name, as edges, plans and queries have it: 1 to 32 lower-case letters, digits and `_`.
    pub id: String,
    /// What it does to the body.
    pub motion: OwnMotion,
    /// Tag of the spots where the body can make it; empty for `id`.
    #[serde(default)]
    pub spot: String,
    /// Speed along the way or to the anchor, m/s.
    #[serde(default = "default_speed")]
    pub speed: f32,
    /// How far the middle of a curve is above the straight line, m; below it if negative.
    #[serde(default)]
    pub rise: f32,
    /// Greatest distance of an anchor, m.
    #[serde(default = "default_range")]
    pub range: f32,
    /// What a game plays meanwhile; empty for `id`. Surefoot only passes it on.
    #[serde(default)]
    pub animation: String,
}

/// What a move of a body's own does to the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OwnMotion {
    /// The body follows a curve from one end of the spot to the other. It begins where the body walks over one end
    /// towards the other.
    Curve,
    /// The body is pulled to the spot, and goes on from there in the air. It begins where the body jumps in the air,
    /// has no jump left, and sees the spot ahead.
    Tether,
}

fn default_speed() -> f32 {
    5.0
}

fn default_range() -> f32 {
    15.0
}

/// Why a move of a body's own is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OwnMoveError {
    /// There are too many.
    #[error("body.moves has {0} entries, but at most {MAX_OWN_MOVES} fit")]
    TooMany(usize),
    /// A name is not valid.
    #[error(
        "body.moves[{idx}].{field} is `{value}`, but must be 1 to {MAX_TAG_LEN} lower-case letters, digits and `_`, a \
         letter first"
    )]
    Name {
        /// Place of the move.
        idx: usize,
        /// The field.
        field: &'static str,
        /// The beginning of its value.
        value: String,
    },
    /// Two moves have one name.
    #[error("body.moves[{idx}].id is `{id}`, which is the name of another move")]
    Taken {
        /// Place of the move.
        idx: usize,
        /// Its name.
        id: String,
    },
    /// A number is out of range.
    #[error("body.moves[{idx}].{field} is {value}, but must be {min} to {max}")]
    Range {
        /// Place of the move.
        idx: usize,
        /// The field.
        field: &'static str,
        /// The rejected value.
        value: f32,
        /// Smallest allowed value.
        min: f32,
        /// Largest allowed value.
        max: f32,
    },
}

impl OwnMove {
    /// A move with the default numbers, at the spots whose tag is its name.
    pub fn new(id: &str, motion: OwnMotion) -> Self {
        let (speed, range) = (default_speed(), default_range());
        Self { id: id.to_owned(), motion, spot: String::new(), speed, rise: 0.0, range, animation: String::new() }
    }

    /// The tag of its spots.
    pub fn tag(&self) -> &str {
        if self.spot.is_empty() { &self.id } else { &self.spot }
    }

    /// What a game plays meanwhile.
    pub fn animation(&self) -> &str {
        if self.animation.is_empty() { &self.id } else { &self.animation }
    }

    /// The place on a curve between two ends after `share` of it, m.
    pub(super) fn at(&self, [from, to]: [Vec3; 2], share: f32) -> Vec3 {
        from.lerp(to, share) + Vec3::Y * (4.0 * self.rise * share * (1.0 - share))
    }

    /// Time that the body takes for a curve, s: that of a straight line over the top of the curve.
    pub(super) fn seconds(&self, [from, to]: [Vec3; 2]) -> f32 {
        let top = self.at([from, to], 0.5);
        (from.distance(top) + top.distance(to)) / self.speed
    }

    /// Whether the body can make it at a spot.
    pub fn fits(&self, spot: &Spot) -> bool {
        let needs_end = self.motion == OwnMotion::Curve;
        spot.tag == self.tag() && (!needs_end || spot.to.is_some())
    }

    /// Checks the moves of a body.
    ///
    /// # Errors
    /// Names the first field that is wrong.
    pub fn check(moves: &[Self]) -> Result<(), OwnMoveError> {
        if moves.len() > MAX_OWN_MOVES {
            return Err(OwnMoveError::TooMany(moves.len()));
        }
        for (idx, own) in moves.iter().enumerate() {
            own.check_at(idx)?;
            if Ability::named(&own.id).is_some() || moves[..idx].iter().any(|it| it.id == own.id) {
                return Err(OwnMoveError::Taken { idx, id: own.id.clone() });
            }
        }
        Ok(())
    }

    /// The name of an ability of a body with these moves, in snake case.
    pub fn name_in(moves: &[Self], ability: Ability) -> &str {
        let own = ability.own_idx().and_then(|idx| moves.get(idx));
        own.map_or(ability.name(), |own| own.id.as_str())
    }

    /// The ability with this name of a body with these moves.
    pub fn named_in(moves: &[Self], name: &str) -> Option<Ability> {
        Self::all_with(moves).find(|(_, own)| *own == name).map(|(ability, _)| ability)
    }

    /// The abilities that a body with these moves may have, with their names.
    pub fn all_with(moves: &[Self]) -> impl Iterator<Item = (Ability, &str)> {
        let own = moves.iter().enumerate().map(|(idx, own)| (Ability::own(idx), own.id.as_str()));
        Ability::all().map(|ability| (ability, ability.name())).chain(own)
    }

    fn check_at(&self, idx: usize) -> Result<(), OwnMoveError> {
        let names = [("id", &self.id, false), ("spot", &self.spot, true)];
        for (field, value, may_lack) in names {
            let is_allowed = is_tag(value) || may_lack && value.is_empty();
            if !is_allowed {
                return Err(OwnMoveError::Name { idx, field, value: beginning(value) });
            }
        }
        if self.animation.len() > MAX_ANIMATION_LEN {
            let max = MAX_ANIMATION_LEN as f32;
            let value = self.animation.len() as f32;
            return Err(OwnMoveError::Range { idx, field: "animation's length", value, min: 0.0, max });
        }
        let ranges =
            [("speed", self.speed, 0.1, 40.0), ("rise", self.rise, -20.0, 20.0), ("range", self.range, 1.0, 50.0)];
        for (field, value, min, max) in ranges {
            // False for NaN.
            if !(min..=max).contains(&value) {
                return Err(OwnMoveError::Range { idx, field, value, min, max });
            }
        }
        Ok(())
    }
}

/// Longest name of an animation, bytes.
const MAX_ANIMATION_LEN: usize = 128;

/// The beginning of a text for a message.
fn beginning(text: &str) -> String {
    text.chars().take(2 * MAX_TAG_LEN).collect()
}
