//! What a map is asked to be: [`MapSpec`], checked before anything is allocated.

use serde::{Deserialize, Serialize};

/// Smallest side of a map in metres.
pub const MIN_SIDE_M: u32 = 50;
/// Largest side of a map in metres.
pub const MAX_SIDE_M: u32 = 1000;
/// Smallest height of a map in metres.
pub const MIN_HEIGHT_M: u32 = 40;
/// Largest height of a map in metres.
pub const MAX_HEIGHT_M: u32 = 200;
/// Largest feature density; 1 is the default map's.
pub const MAX_DENSITY: f32 = 4.0;

/// Everything that decides a generated map: same spec, same bits, on every run and thread count.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MapSpec {
    /// Seed of the noise and of every placement.
    pub seed: u64,
    /// Width (x), height (y) and depth (z) in metres.
    pub size: MapSize,
    /// How much of each feature is placed.
    pub features: Features,
}

/// Extent of a map in metres; the map spans `0..width`, `0..height`, `0..depth`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct MapSize {
    /// Along x, `MIN_SIDE_M..=MAX_SIDE_M`.
    pub width: u32,
    /// Along y, `MIN_HEIGHT_M..=MAX_HEIGHT_M`.
    pub height: u32,
    /// Along z, `MIN_SIDE_M..=MAX_SIDE_M`.
    pub depth: u32,
}

/// Density of each feature: 0 places none, 1 is the default map's, at most [`MAX_DENSITY`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Features {
    /// Flat-topped columns of rock.
    pub plateaus: f32,
    /// Boxes with a walkable roof.
    pub buildings: f32,
    /// Water pools (drown after five seconds).
    pub water: f32,
    /// Lava pools (burn at once).
    pub lava: f32,
    /// Jump pads besides those that serve a tall plateau or building.
    pub pads: f32,
}

impl Default for Features {
    fn default() -> Self {
        Self { plateaus: 1.0, buildings: 1.0, water: 1.0, lava: 1.0, pads: 1.0 }
    }
}

impl MapSpec {
    /// The default map of 250 x 80 x 250 m with the paper's set of features.
    pub fn new(seed: u64) -> Self {
        Self { seed, size: MapSize { width: 250, height: 80, depth: 250 }, features: Features::default() }
    }

    /// A square default map with `side` metres to a side and 80 m of height.
    pub fn with_side(seed: u64, side: u32) -> Self {
        Self { size: MapSize { width: side, height: 80, depth: side }, ..Self::new(seed) }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// Names the first field that lies outside its range.
    pub fn validate(&self) -> Result<(), SpecError> {
        let sides = [
            ("size.width", self.size.width, MIN_SIDE_M, MAX_SIDE_M),
            ("size.height", self.size.height, MIN_HEIGHT_M, MAX_HEIGHT_M),
            ("size.depth", self.size.depth, MIN_SIDE_M, MAX_SIDE_M),
        ];
        for (field, value, min, max) in sides {
            if !(min..=max).contains(&value) {
                return Err(SpecError { field, value: f64::from(value), min: f64::from(min), max: f64::from(max) });
            }
        }
        let Features { plateaus, buildings, water, lava, pads } = self.features;
        let densities = [
            ("features.plateaus", plateaus),
            ("features.buildings", buildings),
            ("features.water", water),
            ("features.lava", lava),
            ("features.pads", pads),
        ];
        for (field, value) in densities {
            if !(0.0..=MAX_DENSITY).contains(&value) {
                return Err(SpecError { field, value: f64::from(value), min: 0.0, max: f64::from(MAX_DENSITY) });
            }
        }
        Ok(())
    }
}

/// A field of a [`MapSpec`] outside its range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{field} is {value}, allowed are {min} to {max}")]
pub struct SpecError {
    /// Path of the field inside the spec.
    pub field: &'static str,
    /// What was asked for.
    pub value: f64,
    /// Smallest allowed value.
    pub min: f64,
    /// Largest allowed value.
    pub max: f64,
}
