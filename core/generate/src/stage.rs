//! The stages of map generation, and the rules that several stages share.

use surefoot_world::Vec3;
use surefoot_world::map::features::{PAD_EXTRA_M, PAD_GRAVITY};
use surefoot_world::map::{MapSpec, Pad};

/// Area of the default map, for which feature counts are given, m2.
const REFERENCE_AREA_M2: f32 = 62_500.0;

/// A stage of map generation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Samples the noise of the terrain.
    Terrain,
    /// Places what is cut into the ground and what stands on it.
    Features,
    /// Extracts and indexes triangles.
    Mesh,
    /// Surveys which ground is connected.
    Survey,
    /// Adds devices to ground without an entrance or exit.
    Repair,
    /// The map is complete.
    Done,
}

impl Stage {
    /// All stages in order.
    pub const ALL: [Stage; 6] =
        [Stage::Terrain, Stage::Features, Stage::Mesh, Stage::Survey, Stage::Repair, Stage::Done];

    /// Short description of the stage, for progress displays.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Terrain => "shaping the terrain",
            Stage::Features => "placing features",
            Stage::Mesh => "indexing triangles",
            Stage::Survey => "surveying the ground",
            Stage::Repair => "connecting the ground",
            Stage::Done => "done",
        }
    }
}

/// Number of instances of a feature on a map of `spec`; `reference` is the number on the default map at density 1.
pub(crate) fn count_on(spec: &MapSpec, reference: f32, density: f32) -> usize {
    let area = (spec.size.width * spec.size.depth) as f32;
    (reference * density * area / REFERENCE_AREA_M2).round() as usize
}

/// A pad that throws characters 10 m higher than `rise` metres: `v = sqrt(2 g (rise + 10))`, with `rise` at least -4 m.
pub(crate) fn pad(centre: Vec3, rise: f32) -> Pad {
    Pad { centre, speed: (2.0 * PAD_GRAVITY * (rise.max(-4.0) + PAD_EXTRA_M)).sqrt() }
}
