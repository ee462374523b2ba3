//! Conversions between the wire types of `surefoot.world.v1` and the world's checked types.

use crate::reason::{self, Reason};
use crate::world::v1 as wire;
use std::ops::RangeInclusive;
use std::sync::Arc;
use surefoot_planner::zones::ZoneError;
use surefoot_world::character::bodies::{BODIES, NamedBody};
use surefoot_world::character::{OwnMotion, OwnMove, OwnMoveError, ProfileError, RawCharacterProfile};
use surefoot_world::formation::Shape;
use surefoot_world::map::{Features, MapKind, MapSize, MoverDensities, MoverKind};
use surefoot_world::mesh::Surface;
use surefoot_world::{
    Ability, CharacterProfile, End, GAITS, Gait, MAX_OWN_MOVES, MapSpec, NamedGait, PlayerContact, RawMapSpec,
    SpecError, Vec3,
};
use tonic_types::{ErrorDetails, StatusExt};

/// Why a field of a message is invalid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the texts say what the variants mean")]
pub enum FieldError {
    #[error("{0} is missing")]
    Missing(&'static str),
    #[error("{0} is not finite")]
    NotFinite(&'static str),
    #[error("map.{0}")]
    Spec(#[from] SpecError),
    #[error("{0}")]
    Body(#[from] ProfileError),
    #[error("body.preset is \"{found}\"; there are {names}", names = BODIES.map(|body| body.name).join(", "))]
    UnknownBody { found: String },
    #[error("gait.name is \"{found}\"; there are {names}", names = GAITS.map(|gait| gait.name).join(", "))]
    UnknownGait { found: String },
    #[error("{field} is {value}; it must be between {min} and {max}")]
    Range { field: &'static str, value: f64, min: f64, max: f64 },
    #[error("{field} has {found} {what}; at most {limit} are allowed")]
    Count { field: &'static str, what: &'static str, found: usize, limit: usize },
    #[error("{field} has the unknown value {value}")]
    Unknown { field: &'static str, value: i32 },
    #[error("{0} and {1} exclude each other")]
    Exclusive(&'static str, &'static str),
    #[error("{field}: zone `{name}`: {error}")]
    Zone { field: &'static str, name: String, error: ZoneError },
    #[error("{field}: {error}")]
    Tags { field: &'static str, error: ZoneError },
    #[error("{field} has {found} bytes, expected {expected}")]
    Length { field: &'static str, found: usize, expected: usize },
}

impl FieldError {
    /// Returns the path of the field.
    pub fn field(&self) -> String {
        match self {
            FieldError::Missing(field) | FieldError::NotFinite(field) | FieldError::Exclusive(field, _) => {
                (*field).to_owned()
            }
            FieldError::Spec(SpecError { field, .. }) => format!("map.{field}"),
            FieldError::Body(error) => format!("body.{}", error.field()),
            FieldError::UnknownBody { .. } => "body.preset".to_owned(),
            FieldError::UnknownGait { .. } => "gait.name".to_owned(),
            FieldError::Range { field, .. }
            | FieldError::Count { field, .. }
            | FieldError::Unknown { field, .. }
            | FieldError::Zone { field, .. }
            | FieldError::Tags { field, .. }
            | FieldError::Length { field, .. } => (*field).to_owned(),
        }
    }
}

impl From<FieldError> for tonic::Status {
    fn from(error: FieldError) -> Self {
        let message = error.to_string();
        let mut details = ErrorDetails::with_bad_request_violation(error.field(), message.clone());
        details.set_error_info(Reason::InvalidField.name(), reason::DOMAIN, []);
        tonic::Status::with_error_details(tonic::Code::InvalidArgument, message, details)
    }
}

/// Converts a required point from the wire.
pub fn point(value: Option<&wire::Vec3>, field: &'static str) -> Result<Vec3, FieldError> {
    let &wire::Vec3 { x, y, z } = value.ok_or(FieldError::Missing(field))?;
    let point = Vec3::new(x, y, z);
    if point.is_finite() { Ok(point) } else { Err(FieldError::NotFinite(field)) }
}

/// Converts a gait from the wire: values of 0 become those of the named gait, or the defaults.
pub fn gait(value: &wire::Gait) -> Result<Gait, FieldError> {
    let &wire::Gait { speed, acceleration, turn_rate, wall_distance, avoids_jumps, ref name } = value;
    let usual = match name.as_str() {
        "" => Gait::DEFAULT,
        name => NamedGait::find(name).ok_or_else(|| FieldError::UnknownGait { found: name.to_owned() })?.gait,
    };
    let within = |value: f32, usual: f32, allowed: RangeInclusive<f32>, field| {
        let value = if value == 0.0 { usual } else { value };
        in_range(f64::from(value), f64::from(*allowed.start()), f64::from(*allowed.end()), field)?;
        Ok::<f32, FieldError>(value)
    };
    Ok(Gait {
        speed: within(speed, usual.speed, Gait::SPEEDS, "gait.speed")?,
        acceleration: within(acceleration, usual.acceleration, Gait::ACCELERATIONS, "gait.acceleration")?,
        turn_rate: within(turn_rate, usual.turn_rate, Gait::TURN_RATES, "gait.turn_rate")?,
        wall_distance: within(wall_distance, usual.wall_distance, Gait::WALL_DISTANCES, "gait.wall_distance")?,
        avoids_jumps: avoids_jumps || usual.avoids_jumps,
    })
}

/// Converts a gait to the wire, without a name.
pub fn gait_to_wire(gait: Gait) -> wire::Gait {
    let Gait { speed, acceleration, turn_rate, wall_distance, avoids_jumps } = gait;
    wire::Gait { speed, acceleration, turn_rate, wall_distance, avoids_jumps, name: String::new() }
}

/// Converts a point to the wire.
pub fn to_wire(point: Vec3) -> wire::Vec3 {
    wire::Vec3 { x: point.x, y: point.y, z: point.z }
}

/// Converts a required map spec from the wire; absent parts become defaults.
pub fn map_spec(value: Option<&wire::MapSpec>) -> Result<MapSpec, FieldError> {
    let value = value.ok_or(FieldError::Missing("map"))?;
    let mut spec = RawMapSpec::new(value.seed);
    spec.size = value.size.map_or(spec.size, MapSize::from);
    spec.features = value.features.map_or(spec.features, Features::from);
    spec.movers = value.movers.map_or(spec.movers, MoverDensities::from);
    spec.repair = value.repair.unwrap_or(true);
    spec.kind = enum_or(value.kind, MapKind::Terrain, "map.kind")?;
    Ok(spec.try_into()?)
}

/// Converts a body from the wire; absent means the default body, absent fields those of its preset.
pub fn body(value: Option<&wire::Body>) -> Result<CharacterProfile, FieldError> {
    let Some(value) = value else { return Ok(CharacterProfile::default()) };
    let preset = match value.preset.as_str() {
        "" => CharacterProfile::default(),
        name => NamedBody::find(name).ok_or_else(|| FieldError::UnknownBody { found: name.to_owned() })?.profile(),
    };
    let count = |value: Option<u32>, default: u8, field| {
        let value = value.map(|value| in_range(f64::from(value), 0.0, f64::from(u8::MAX), field)).transpose()?;
        Ok::<u8, FieldError>(value.map_or(default, |value| value as u8))
    };
    let extra_jumps = count(value.extra_jumps, preset.extra_jumps, "body.extra_jumps")?;
    let moves = own_moves(&value.moves)?;
    let coyote_ticks = count(value.coyote_ticks, preset.coyote_ticks, "body.coyote_ticks")?;
    let changed = preset.with(|it| {
        *it = RawCharacterProfile {
            height: value.height.unwrap_or(it.height),
            radius: value.radius.unwrap_or(it.radius),
            forward_speed: value.forward_speed.unwrap_or(it.forward_speed),
            side_speed_share: value.side_speed_share.unwrap_or(it.side_speed_share),
            turn_speed: value.turn_speed.unwrap_or(it.turn_speed),
            jump_speed: value.jump_speed.unwrap_or(it.jump_speed),
            gravity: value.gravity.unwrap_or(it.gravity),
            extra_jumps,
            max_slope: value.max_slope.unwrap_or(it.max_slope),
            step_height: value.step_height.unwrap_or(it.step_height),
            ground_acceleration: value.ground_acceleration.unwrap_or(it.ground_acceleration),
            air_acceleration: value.air_acceleration.unwrap_or(it.air_acceleration),
            coyote_ticks,
            climb_speed: value.climb_speed.unwrap_or(it.climb_speed),
            mantle_height: value.mantle_height.unwrap_or(it.mantle_height),
            swim_speed: value.swim_speed.unwrap_or(it.swim_speed),
            crouch_height: value.crouch_height.unwrap_or(it.crouch_height),
            dash_speed: value.dash_speed.unwrap_or(it.dash_speed),
            wall_run_seconds: value.wall_run_seconds.unwrap_or(it.wall_run_seconds),
            slide_seconds: value.slide_seconds.unwrap_or(it.slide_seconds),
            dive_seconds: value.dive_seconds.unwrap_or(it.dive_seconds),
            moves: if moves.is_empty() { it.moves.clone() } else { moves },
            uses_zip_lines: value.uses_zip_lines.unwrap_or(it.uses_zip_lines),
            zip_line_speed: value.zip_line_speed.unwrap_or(it.zip_line_speed),
            uses_jetpacks: value.uses_jetpacks.unwrap_or(it.uses_jetpacks),
            jetpack_acceleration: value.jetpack_acceleration.unwrap_or(it.jetpack_acceleration),
            jetpack_climb_speed: value.jetpack_climb_speed.unwrap_or(it.jetpack_climb_speed),
        }
    });
    Ok(changed?)
}

/// Converts the moves of a body from the wire.
fn own_moves(moves: &[wire::OwnMove]) -> Result<Arc<[OwnMove]>, FieldError> {
    if moves.len() > MAX_OWN_MOVES {
        return Err(ProfileError::Moves(OwnMoveError::TooMany(moves.len())).into());
    }
    let own = |it: &wire::OwnMove| {
        let unknown = || FieldError::Unknown { field: "body.moves.motion", value: it.motion };
        let usual = OwnMove::new(&it.id, OwnMotion::from_wire(it.motion).ok_or_else(unknown)?);
        Ok(OwnMove {
            spot: it.spot.clone(),
            speed: it.speed.unwrap_or(usual.speed),
            rise: it.rise.unwrap_or(usual.rise),
            range: it.range.unwrap_or(usual.range),
            animation: it.animation.clone(),
            ..usual
        })
    };
    moves.iter().map(own).collect()
}

/// Converts a move of a body's own to the wire.
fn own_move_to_wire(own: &OwnMove) -> wire::OwnMove {
    wire::OwnMove {
        id: own.id.clone(),
        motion: own.motion.to_wire().into(),
        spot: own.spot.clone(),
        speed: Some(own.speed),
        rise: Some(own.rise),
        range: Some(own.range),
        animation: own.animation.clone(),
    }
}

/// Converts a body to the wire, with all of its numbers, and with the preset that it equals, if there is one.
pub fn body_to_wire(body: &CharacterProfile) -> wire::Body {
    let preset = BODIES.iter().find(|preset| preset.profile() == *body);
    wire::Body {
        preset: preset.map_or_else(String::new, |preset| preset.name.to_owned()),
        height: Some(body.height),
        radius: Some(body.radius),
        forward_speed: Some(body.forward_speed),
        side_speed_share: Some(body.side_speed_share),
        turn_speed: Some(body.turn_speed),
        jump_speed: Some(body.jump_speed),
        gravity: Some(body.gravity),
        extra_jumps: Some(body.extra_jumps.into()),
        max_slope: Some(body.max_slope),
        step_height: Some(body.step_height),
        ground_acceleration: Some(body.ground_acceleration),
        air_acceleration: Some(body.air_acceleration),
        coyote_ticks: Some(body.coyote_ticks.into()),
        uses_zip_lines: Some(body.uses_zip_lines),
        zip_line_speed: Some(body.zip_line_speed),
        uses_jetpacks: Some(body.uses_jetpacks),
        jetpack_acceleration: Some(body.jetpack_acceleration),
        jetpack_climb_speed: Some(body.jetpack_climb_speed),
        climb_speed: Some(body.climb_speed),
        mantle_height: Some(body.mantle_height),
        swim_speed: Some(body.swim_speed),
        crouch_height: Some(body.crouch_height),
        dash_speed: Some(body.dash_speed),
        wall_run_seconds: Some(body.wall_run_seconds),
        slide_seconds: Some(body.slide_seconds),
        dive_seconds: Some(body.dive_seconds),
        moves: body.moves.iter().map(own_move_to_wire).collect(),
    }
}

/// Converts a struct to and from the one on the wire that has the same fields.
macro_rules! wire_struct {
    ($name:ident: $($field:ident)+) => {
        impl From<wire::$name> for $name {
            fn from(wire::$name { $($field),+ }: wire::$name) -> Self {
                Self { $($field),+ }
            }
        }

        impl From<$name> for wire::$name {
            fn from($name { $($field),+ }: $name) -> Self {
                Self { $($field),+ }
            }
        }
    };
}

wire_struct!(MapSize: width height depth);
wire_struct!(Features: plateaus buildings water lava pads zip_lines ravines caves teleporters jetpacks);
wire_struct!(MoverDensities: doors lifts platforms floors conveyors crates);

/// Converts a map spec to the wire.
pub fn map_spec_to_wire(spec: &MapSpec) -> wire::MapSpec {
    wire::MapSpec {
        seed: spec.seed,
        size: Some(spec.size.into()),
        features: Some(spec.features.into()),
        kind: spec.kind.to_wire().into(),
        movers: Some(spec.movers.into()),
        repair: Some(spec.repair),
    }
}

/// Returns `value` if it is between `min` and `max`.
pub fn in_range(value: f64, min: f64, max: f64, field: &'static str) -> Result<f64, FieldError> {
    if (min..=max).contains(&value) { Ok(value) } else { Err(FieldError::Range { field, value, min, max }) }
}

/// An enum whose values have the names of an enum on the wire.
pub trait WireEnum: Copy {
    /// The enum on the wire, which also has a value for "unspecified".
    type Wire;

    /// The value on the wire.
    fn to_wire(self) -> Self::Wire;

    /// The value with that number; `None` if it is unspecified or unknown.
    fn from_wire(number: i32) -> Option<Self>;
}

/// Implements [`WireEnum`] for an enum and the one on the wire: lists the names that both have.
#[macro_export]
macro_rules! wire_enum {
    ($($ours:ident)::+ = $($theirs:ident)::+: $($value:ident)+) => {
        impl $crate::convert::WireEnum for $($ours)::+ {
            type Wire = $($theirs)::+;

            fn to_wire(self) -> Self::Wire {
                use $($theirs)::+ as Theirs;
                match self { $(Self::$value => Theirs::$value,)+ }
            }

            fn from_wire(number: i32) -> Option<Self> {
                use $($theirs)::+ as Theirs;
                match Theirs::try_from(number) {
                    $(Ok(Theirs::$value) => Some(Self::$value),)+
                    Ok(_) | Err(_) => None,
                }
            }
        }
    };
}

wire_enum!(MapKind = wire::MapKind: Terrain Islands Interior Arena Tower Open Keep Flooded Vents Rooftops Canyon);
wire_enum!(OwnMotion = wire::OwnMotion: Curve Tether);
wire_enum!(End = wire::Outcome: Reached Fell Burnt Drowned NoProgress Unreachable ReachedNear);

/// On the wire, abilities are numbered as in the table, from 1 on.
impl WireEnum for Ability {
    type Wire = wire::Ability;

    fn to_wire(self) -> wire::Ability {
        i32::try_from(self.idx() + 1).ok().and_then(|number| number.try_into().ok()).unwrap_or_default()
    }

    fn from_wire(number: i32) -> Option<Self> {
        usize::try_from(number).ok()?.checked_sub(1).and_then(Self::at)
    }
}

wire_enum!(Surface = wire::Surface: Ground Water Lava Pad ZipLine Teleporter Jetpack Climb);
wire_enum!(Shape = wire::Formation: Column Line Wedge Loose);
wire_enum!(MoverKind = wire::MoverKind: Door Lift Platform Floor Conveyor Crate);
wire_enum!(PlayerContact = wire::PlayerContact: Block Push Ghost);

/// Reads an enum; unspecified means `usual`.
pub fn enum_or<T: WireEnum>(number: i32, usual: T, field: &'static str) -> Result<T, FieldError> {
    match number {
        0 => Ok(usual),
        value => T::from_wire(value).ok_or(FieldError::Unknown { field, value }),
    }
}

/// Converts an outcome to the wire; `None` becomes unspecified.
pub fn outcome(end: Option<End>) -> wire::Outcome {
    end.map_or(wire::Outcome::Unspecified, End::to_wire)
}

/// Converts an outcome from the wire; `None` if it is unspecified or unknown.
pub fn end(value: i32) -> Option<End> {
    End::from_wire(value)
}

/// Converts an ability to the wire.
pub fn ability_to_wire(ability: Ability) -> wire::Ability {
    ability.to_wire()
}

/// Converts an ability from the wire. Unspecified and unknown values become walking.
pub fn ability(value: i32) -> Ability {
    Ability::from_wire(value).unwrap_or(Ability::WALK)
}

/// Packs floats as little-endian bytes.
pub fn pack(values: impl IntoIterator<Item = f32>) -> Vec<u8> {
    // Collecting a vector does not copy it; the loop below then copies whole chunks.
    let values: Vec<f32> = values.into_iter().collect();
    let mut bytes = vec![0; values.len() * 4];
    let (chunks, _) = bytes.as_chunks_mut::<4>();
    chunks.iter_mut().zip(values).for_each(|(chunk, value)| *chunk = value.to_le_bytes());
    bytes
}

/// Packs points as little-endian floats, three each.
pub fn pack_points(points: impl IntoIterator<Item = Vec3>) -> Vec<u8> {
    pack(points.into_iter().flat_map(|point| point.to_array()))
}

/// Unpacks little-endian floats as points, three each.
pub fn unpack_points(bytes: &[u8], count: usize, field: &'static str) -> Result<Vec<Vec3>, FieldError> {
    let values = unpack(bytes, 3 * count, field)?;
    let points: Vec<Vec3> = values.as_chunks::<3>().0.iter().copied().map(Vec3::from_array).collect();
    if points.iter().all(|point| point.is_finite()) { Ok(points) } else { Err(FieldError::NotFinite(field)) }
}

/// Unpacks little-endian floats.
pub fn unpack(bytes: &[u8], count: usize, field: &'static str) -> Result<Vec<f32>, FieldError> {
    if bytes.len() != count * 4 {
        return Err(FieldError::Length { field, found: bytes.len(), expected: count * 4 });
    }
    Ok(bytes.as_chunks::<4>().0.iter().map(|chunk| f32::from_le_bytes(*chunk)).collect())
}
