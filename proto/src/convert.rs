//! Conversions between wire types and the world's checked types.

use crate::world::v1 as wire;
use surefoot_world::map::{Features, MapSize};
use surefoot_world::{End, MapSpec, SpecError, Vec3};

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
            FieldError::Range { field, .. } | FieldError::Length { field, .. } => (*field).to_owned(),
        }
    }
}

impl From<FieldError> for tonic::Status {
    fn from(error: FieldError) -> Self {
        crate::status::invalid(error.field(), error.to_string())
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
    let mut spec = MapSpec::new(value.seed);
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
    spec.validate()?;
    Ok(spec)
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
