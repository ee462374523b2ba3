//! The stages of generating a map, and the rules that several of them share.

use super::features::{PAD_EXTRA_M, PAD_GRAVITY, Pad};
use super::spec::MapSpec;
use crate::Vec3;

/// Area that the feature counts below are given for: the default map's, m2.
const REFERENCE_AREA_M2: f32 = 62_500.0;

/// Where a generation stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Sampling noise.
    Terrain,
    /// Placing what is cut into the ground and stands on it.
    Features,
    /// Extracting and indexing triangles.
    Mesh,
    /// Surveying which ground is connected.
    Survey,
    /// Adding devices where ground has no way in or out.
    Repair,
    /// Done.
    Done,
}

impl Stage {
    /// All stages in their order.
    pub const ALL: [Stage; 6] =
        [Stage::Terrain, Stage::Features, Stage::Mesh, Stage::Survey, Stage::Repair, Stage::Done];

    /// A few words on what goes on.
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

/// How many of a feature belong on a map of `spec`'s area.
pub(super) fn count_on(spec: &MapSpec, reference: f32, density: f32) -> usize {
    let area = (spec.size.width * spec.size.depth) as f32;
    (reference * density * area / REFERENCE_AREA_M2).round() as usize
}

/// A pad that throws 10 m higher than `rise`: `v = sqrt(2 g (rise + 10))`.
pub(super) fn pad(centre: Vec3, rise: f32) -> Pad {
    Pad { centre, speed: (2.0 * PAD_GRAVITY * (rise.max(-4.0) + PAD_EXTRA_M)).sqrt() }
}
