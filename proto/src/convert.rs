//! Conversions between wire types and the world's checked types.

use crate::reason::{self, Reason};
use crate::world::v1 as wire;
use surefoot_world::map::{Features, MapSize};
use surefoot_world::{Ability, End, MapSpec, RawMapSpec, SpecError, Vec3};
use tonic_types::{ErrorDetails, StatusExt};

/// A field of a request that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FieldError {
    /// The field must be set.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// The field holds NaN or an infinity.
    #[error("{0} is not finite")]
    NotFinite(&'static str),
    /// A number of the map spec is out of range.
    #[error("map.{0}")]
    Spec(#[from] SpecError),
    /// A number is out of range.
    #[error("{field} is {value}, allowed are {min} to {max}")]
    Range {
        /// Path of the field.
        field: &'static str,
        /// What was sent.
        value: f64,
        /// Smallest allowed value.
        min: f64,
        /// Largest allowed value.
        max: f64,
    },
    /// There are too many of something.
    #[error("{field} has {found} {what}, allowed are {limit}")]
    Count {
        /// Path of the field.
        field: &'static str,
        /// What it holds.
        what: &'static str,
        /// How many were sent.
        found: usize,
        /// How many are allowed.
        limit: usize,
    },
    /// An enum holds a value that is not one of its own.
    #[error("{field} has the unknown value {value}")]
    Unknown {
        /// Path of the field.
        field: &'static str,
        /// What was sent.
        value: i32,
    },
    /// A packed array has the wrong length.
    #[error("{field} holds {found} bytes, expected {expected}")]
    Length {
        /// Path of the field.
        field: &'static str,
        /// Bytes sent.
        found: usize,
        /// Bytes expected.
        expected: usize,
    },
}

impl FieldError {
    /// Path of the field.
    pub fn field(&self) -> String {
        match self {
            FieldError::Missing(field) | FieldError::NotFinite(field) => (*field).to_owned(),
            FieldError::Spec(SpecError { field, .. }) => format!("map.{field}"),
            FieldError::Range { field, .. }
            | FieldError::Count { field, .. }
            | FieldError::Unknown { field, .. }
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

/// Reads a required point.
///
/// # Errors
/// If it is missing or not finite; `field` names it.
pub fn point(value: Option<&wire::Vec3>, field: &'static str) -> Result<Vec3, FieldError> {
    let &wire::Vec3 { x, y, z } = value.ok_or(FieldError::Missing(field))?;
    let point = Vec3::new(x, y, z);
    if point.is_finite() { Ok(point) } else { Err(FieldError::NotFinite(field)) }
}

/// A point on the wire.
pub fn to_wire(point: Vec3) -> wire::Vec3 {
    wire::Vec3 { x: point.x, y: point.y, z: point.z }
}

/// Reads and checks a map spec.
///
/// # Errors
/// If it is missing or a number is out of range.
pub fn map_spec(value: Option<&wire::MapSpec>) -> Result<MapSpec, FieldError> {
    let value = value.ok_or(FieldError::Missing("map"))?;
    let mut spec = RawMapSpec::new(value.seed);
    if let Some(size) = &value.size {
        spec.size = MapSize { width: size.width, height: size.height, depth: size.depth };
    }
    if let Some(features) = &value.features {
        let &wire::Features {
            plateaus,
            buildings,
            water,
            lava,
            pads,
            zip_lines,
            ravines,
            caves,
            teleporters,
            jetpacks,
        } = features;
        spec.features =
            Features { plateaus, buildings, water, lava, pads, zip_lines, ravines, caves, teleporters, jetpacks };
    }
    Ok(spec.try_into()?)
}

/// The extent of a map on the wire.
pub fn map_size_to_wire(MapSize { width, height, depth }: MapSize) -> wire::MapSize {
    wire::MapSize { width, height, depth }
}

/// A map spec on the wire.
pub fn map_spec_to_wire(spec: &MapSpec) -> wire::MapSpec {
    let Features { plateaus, buildings, water, lava, pads, zip_lines, ravines, caves, teleporters, jetpacks } =
        spec.features;
    wire::MapSpec {
        seed: spec.seed,
        size: Some(map_size_to_wire(spec.size)),
        features: Some(wire::Features {
            plateaus,
            buildings,
            water,
            lava,
            pads,
            zip_lines,
            ravines,
            caves,
            teleporters,
            jetpacks,
        }),
    }
}

/// Reads a number within a range.
///
/// # Errors
/// If it is outside (or NaN); `field` names it.
pub fn in_range(value: f64, min: f64, max: f64, field: &'static str) -> Result<f64, FieldError> {
    if (min..=max).contains(&value) { Ok(value) } else { Err(FieldError::Range { field, value, min, max }) }
}

/// An outcome on the wire.
pub fn outcome(end: Option<End>) -> wire::Outcome {
    match end {
        None => wire::Outcome::Unspecified,
        Some(End::Reached) => wire::Outcome::Reached,
        Some(End::Fell) => wire::Outcome::Fell,
        Some(End::Burnt) => wire::Outcome::Burnt,
        Some(End::Drowned) => wire::Outcome::Drowned,
        Some(End::NoProgress) => wire::Outcome::NoProgress,
    }
}

/// An ability on the wire.
pub fn ability_to_wire(ability: Ability) -> wire::Ability {
    match ability {
        Ability::Walk => wire::Ability::Walk,
        Ability::Jump => wire::Ability::Jump,
        Ability::DoubleJump => wire::Ability::DoubleJump,
        Ability::Pad => wire::Ability::Pad,
        Ability::ZipLine => wire::Ability::ZipLine,
        Ability::Teleporter => wire::Ability::Teleporter,
        Ability::Jetpack => wire::Ability::Jetpack,
    }
}

/// An ability from the wire; one that is not set or not known counts as walking.
pub fn ability(value: i32) -> Ability {
    match wire::Ability::try_from(value) {
        Ok(wire::Ability::Jump) => Ability::Jump,
        Ok(wire::Ability::DoubleJump) => Ability::DoubleJump,
        Ok(wire::Ability::Pad) => Ability::Pad,
        Ok(wire::Ability::ZipLine) => Ability::ZipLine,
        Ok(wire::Ability::Teleporter) => Ability::Teleporter,
        Ok(wire::Ability::Jetpack) => Ability::Jetpack,
        Ok(wire::Ability::Walk | wire::Ability::Unspecified) | Err(_) => Ability::Walk,
    }
}

/// Packs floats as little-endian bytes.
pub fn pack(values: impl IntoIterator<Item = f32>) -> Vec<u8> {
    values.into_iter().flat_map(f32::to_le_bytes).collect()
}

/// Unpacks little-endian floats.
///
/// # Errors
/// If there are not exactly `count` of them; `field` names the array.
pub fn unpack(bytes: &[u8], count: usize, field: &'static str) -> Result<Vec<f32>, FieldError> {
    if bytes.len() != count * 4 {
        return Err(FieldError::Length { field, found: bytes.len(), expected: count * 4 });
    }
    Ok(bytes.as_chunks::<4>().0.iter().map(|chunk| f32::from_le_bytes(*chunk)).collect())
}
