//! Character profiles: the size and the motion of a kind of character.

use super::own::{OwnMotion, OwnMove, OwnMoveError};
use crate::Ability;
use crate::map::{Device, DeviceKind, Liquid};
use serde::{Deserialize, Serialize};
use std::ops::Deref;
use std::sync::Arc;

/// Largest `coyote_ticks`. After a jump, a body counts as 255 ticks in the air, which must exceed any `coyote_ticks`.
const MAX_COYOTE_TICKS: u8 = u8::MAX - 1;
/// `step_height` of the default body, m: the stairs of buildings rise by up to 0.2 m, those of games by more.
const STEP_M: f32 = 0.35;
/// `climb_speed` of the default body, m/s: twice that of people, as in games.
const CLIMB_SPEED: f32 = 3.0;

/// Size and motion of a kind of character. All values are in range: a profile is a checked [`RawCharacterProfile`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawCharacterProfile")]
pub struct CharacterProfile(RawCharacterProfile);

/// The values of a [`CharacterProfile`] before they are checked.
///
/// The default is the paper's body, [`of_paper`](Self::of_paper), with steps as high as stairs have. In files, missing
/// fields have the default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RawCharacterProfile {
    /// Height from soles to crown, m.
    pub height: f32,
    /// Radius of the capsule, m.
    pub radius: f32,
    /// Top speed forward, m/s.
    pub forward_speed: f32,
    /// Top speed backwards and sideways as a share of `forward_speed`.
    pub side_speed_share: f32,
    /// Top turning speed, rad/s.
    pub turn_speed: f32,
    /// Upward speed given by a jump, m/s.
    pub jump_speed: f32,
    /// Gravity, m/s2.
    pub gravity: f32,
    /// Jumps that the character can make in the air before it lands.
    pub extra_jumps: u8,
    /// Steepest walkable slope, rad.
    pub max_slope: f32,
    /// Highest step that the character climbs without a jump, m.
    pub step_height: f32,
    /// Horizontal acceleration on the ground, m/s2.
    pub ground_acceleration: f32,
    /// Horizontal acceleration in the air, m/s2.
    pub air_acceleration: f32,
    /// Ticks after leaving the ground during which a jump still counts as one from the ground, at most 254.
    pub coyote_ticks: u8,
    /// Speed up ladders and other faces that bodies climb, m/s; 0 if the character cannot climb.
    pub climb_speed: f32,
    /// Greatest height above its feet of a ledge to which the character pulls itself up, m; 0 if it cannot.
    pub mantle_height: f32,
    /// Speed in water that is too deep to wade, m/s; 0 if the character cannot swim, and drowns.
    pub swim_speed: f32,
    /// Height of the character when it crouches, m; 0 if it cannot.
    pub crouch_height: f32,
    /// Speed of the dash that the character makes when it jumps in the air and has no jump left, m/s; 0 if it makes
    /// none.
    pub dash_speed: f32,
    /// How long the character runs along a wall in the air, s; 0 if it cannot.
    pub wall_run_seconds: f32,
    /// How long the character keeps its speed under what is lower than it, s, before it crouches; 0 if it does not.
    pub slide_seconds: f32,
    /// How long the character can be under water, s; 0 if it cannot dive.
    pub dive_seconds: f32,
    /// Moves of its own, at most [`MAX_OWN_MOVES`](crate::MAX_OWN_MOVES).
    pub moves: Arc<[OwnMove]>,
    /// Whether the character can use zip lines.
    pub uses_zip_lines: bool,
    /// Speed along a zip line, m/s.
    pub zip_line_speed: f32,
    /// Whether the character can use jetpacks.
    pub uses_jetpacks: bool,
    /// Upward acceleration of a jetpack, gravity not subtracted, m/s2.
    pub jetpack_acceleration: f32,
    /// Upward speed at which a jetpack stops pushing, m/s.
    pub jetpack_climb_speed: f32,
}

impl RawCharacterProfile {
    /// The body of the environment that the paper's authors released.
    pub fn of_paper() -> Self {
        Self {
            height: 1.8,
            radius: 0.3,
            forward_speed: 11.0,
            side_speed_share: 0.6,
            turn_speed: std::f32::consts::PI,
            jump_speed: 10.0,
            gravity: 20.0,
            extra_jumps: 1,
            max_slope: 35.0f32.to_radians(),
            step_height: 0.1,
            ground_acceleration: 60.0,
            air_acceleration: 25.0,
            coyote_ticks: 6,
            climb_speed: 0.0,
            mantle_height: 0.0,
            swim_speed: 0.0,
            crouch_height: 0.0,
            dash_speed: 0.0,
            wall_run_seconds: 0.0,
            slide_seconds: 0.0,
            dive_seconds: 0.0,
            moves: Arc::default(),
            uses_zip_lines: true,
            zip_line_speed: 14.0,
            uses_jetpacks: true,
            jetpack_acceleration: 38.0,
            jetpack_climb_speed: 8.0,
        }
    }

    /// Height of a jump from level ground, m.
    pub fn jump_height(&self) -> f32 {
        0.5 * self.jump_speed * self.jump_speed / self.gravity
    }
}

impl Default for RawCharacterProfile {
    fn default() -> Self {
        Self { step_height: STEP_M, climb_speed: CLIMB_SPEED, ..Self::of_paper() }
    }
}

/// Why a [`RawCharacterProfile`] is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ProfileError {
    /// A field is outside its range.
    #[error("body.{field} is {value}, but must be {min} to {max}")]
    Range {
        /// Name of the field.
        field: &'static str,
        /// The rejected value.
        value: f32,
        /// Smallest allowed value.
        min: f32,
        /// Largest allowed value.
        max: f32,
    },
    /// A move lacks another one.
    #[error("body.{field} needs body.{other}, which is 0")]
    Needs {
        /// Name of the field.
        field: &'static str,
        /// Name of the field that it needs.
        other: &'static str,
    },
    /// A move of its own is not valid.
    #[error(transparent)]
    Moves(#[from] OwnMoveError),
}

impl ProfileError {
    /// Name of the field that is wrong.
    pub fn field(&self) -> &'static str {
        match self {
            Self::Range { field, .. } | Self::Needs { field, .. } => field,
            Self::Moves(_) => "moves",
        }
    }
}

impl CharacterProfile {
    /// The body of the environment that the paper's authors released. It cannot climb stairs.
    pub fn of_paper() -> Self {
        Self(RawCharacterProfile::of_paper())
    }

    /// Returns a copy of this profile with a change.
    ///
    /// # Errors
    /// Names the first field outside its range.
    pub fn with(&self, change: impl FnOnce(&mut RawCharacterProfile)) -> Result<Self, ProfileError> {
        let mut raw = self.0.clone();
        change(&mut raw);
        raw.try_into()
    }

    /// Whether the character can use devices of a kind.
    pub fn uses(&self, kind: DeviceKind) -> bool {
        match kind {
            DeviceKind::Pad | DeviceKind::Teleporter => true,
            DeviceKind::ZipLine => self.uses_zip_lines,
            DeviceKind::Jetpack => self.uses_jetpacks,
        }
    }

    /// The least room that the character needs above its feet, m.
    pub fn least_height(&self) -> f32 {
        if self.crouch_height > 0.0 { self.crouch_height } else { self.height }
    }

    /// This profile with the height of the character when it crouches, or as it is.
    pub fn crouched(&self) -> Self {
        Self(RawCharacterProfile { height: self.least_height(), ..self.0.clone() })
    }

    /// The part of the body, as low as it gets, that is higher than `lift` metres above the feet: at least a sphere.
    pub(crate) fn torso(&self, lift: f32) -> Self {
        let height = (self.least_height() - lift).max(2.0 * self.radius);
        Self(RawCharacterProfile { height, crouch_height: 0.0, ..self.0.clone() })
    }

    /// Name of one of the character's moves, in snake case.
    pub fn move_name(&self, ability: Ability) -> &str {
        OwnMove::name_in(&self.moves, ability)
    }

    /// The move with this name: one of all bodies, or one of the character's own.
    pub fn move_named(&self, name: &str) -> Option<Ability> {
        OwnMove::named_in(&self.moves, name)
    }

    /// The character's own moves, with the abilities that they are.
    pub fn own_moves(&self) -> impl Iterator<Item = (Ability, &OwnMove)> {
        self.moves.iter().enumerate().map(|(idx, own)| (Ability::own(idx), own))
    }

    /// The move of the character's own that an ability is.
    pub fn own_move(&self, ability: Ability) -> Option<&OwnMove> {
        ability.own_idx().and_then(|idx| self.moves.get(idx))
    }

    /// The character's own moves with a motion.
    pub(crate) fn own_with(&self, motion: OwnMotion) -> impl Iterator<Item = (Ability, &OwnMove)> {
        self.own_moves().filter(move |(_, own)| own.motion == motion)
    }

    /// Whether a liquid harms the character.
    pub fn is_harmed_by(&self, liquid: Liquid) -> bool {
        liquid == Liquid::Lava || self.swim_speed <= 0.0
    }

    /// Greatest height above a device to which it takes the character, m; `None` for devices that lead to a place.
    pub fn rise_by(&self, device: Device) -> Option<f32> {
        match device.kind {
            DeviceKind::Pad => Some(0.5 * device.power * device.power / self.gravity + 2.0),
            DeviceKind::Jetpack => Some(self.jetpack_climb_speed * device.power),
            DeviceKind::ZipLine | DeviceKind::Teleporter => None,
        }
    }
}

impl Deref for CharacterProfile {
    type Target = RawCharacterProfile;

    fn deref(&self) -> &RawCharacterProfile {
        &self.0
    }
}

impl TryFrom<RawCharacterProfile> for CharacterProfile {
    type Error = ProfileError;

    fn try_from(raw: RawCharacterProfile) -> Result<Self, ProfileError> {
        raw.check().map(|()| Self(raw))
    }
}

impl RawCharacterProfile {
    fn check(&self) -> Result<(), ProfileError> {
        let least_crouch = if self.crouch_height > 0.0 { 2.0 * self.radius } else { 0.0 };
        let ranges = [
            ("radius", self.radius, 0.15, 1.0),
            ("height", self.height, 2.0 * self.radius, 4.0),
            ("forward_speed", self.forward_speed, 0.1, 20.0),
            ("side_speed_share", self.side_speed_share, 0.0, 1.0),
            ("turn_speed", self.turn_speed, 0.1, 20.0),
            ("jump_speed", self.jump_speed, 0.0, 30.0),
            ("gravity", self.gravity, 1.0, 100.0),
            ("max_slope", self.max_slope, 0.0, 1.4),
            ("step_height", self.step_height, 0.0, 0.5 * self.height),
            ("ground_acceleration", self.ground_acceleration, 1.0, 1000.0),
            ("air_acceleration", self.air_acceleration, 0.0, 1000.0),
            ("coyote_ticks", self.coyote_ticks.into(), 0.0, f32::from(MAX_COYOTE_TICKS)),
            ("climb_speed", self.climb_speed, 0.0, 10.0),
            ("mantle_height", self.mantle_height, 0.0, 2.0 * self.height),
            ("swim_speed", self.swim_speed, 0.0, 10.0),
            ("crouch_height", self.crouch_height, least_crouch, self.height),
            ("dash_speed", self.dash_speed, 0.0, 40.0),
            ("wall_run_seconds", self.wall_run_seconds, 0.0, 10.0),
            ("slide_seconds", self.slide_seconds, 0.0, 10.0),
            ("dive_seconds", self.dive_seconds, 0.0, 600.0),
            ("zip_line_speed", self.zip_line_speed, 1.0, 40.0),
            ("jetpack_acceleration", self.jetpack_acceleration, 0.0, 200.0),
            ("jetpack_climb_speed", self.jetpack_climb_speed, 0.0, 40.0),
        ];
        for (field, value, min, max) in ranges {
            if !(min..=max).contains(&value) {
                return Err(ProfileError::Range { field, value, min, max });
            }
        }
        let needs = [
            ("slide_seconds", self.slide_seconds, "crouch_height", self.crouch_height),
            ("dive_seconds", self.dive_seconds, "swim_speed", self.swim_speed),
        ];
        if let Some((field, _, other, _)) =
            needs.into_iter().find(|(_, value, _, needed)| *value > 0.0 && *needed <= 0.0)
        {
            return Err(ProfileError::Needs { field, other });
        }
        Ok(OwnMove::check(&self.moves)?)
    }
}
