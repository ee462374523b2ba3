//! Where vertices go, and what a placement already knows of the ways between them.
//!
//! One module per builder of the paper. Random and spaced ones only place; those that run the policy while placing
//! also say which pairs they saw joined. Whatever comes out passes through the same later stages.

mod anchors;
mod density;
mod flood;
mod random;
mod spaced;
mod trajectories;

pub use anchors::beside_devices;

use crate::candidates::Candidate;
use crate::evidence::Evidence;
use crate::probe::ProbeExecutor;
use crate::settings::{BuildError, BuildSettings, Placement};
use crate::site::Site;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64};
use surefoot_world::{Map, Vec3};

/// Vertices, and what placing them has shown.
#[derive(Debug, Clone, Default)]
pub struct Draft {
    /// Positions, m.
    pub vertices: Vec<Vec3>,
    /// Pairs to try instead of each vertex's nearest.
    pub candidates: Option<Vec<Candidate>>,
    /// What runs between them have shown already.
    pub seen: BTreeMap<Candidate, Evidence>,
    /// Episodes run.
    pub episodes: u64,
}

/// What a placement works with.
pub struct Placing<'a> {
    /// The map and the character.
    pub site: &'a Site,
    /// As asked for.
    pub settings: &'a BuildSettings,
    /// Runs episodes.
    pub executor: &'a dyn ProbeExecutor,
    /// Counts them.
    pub progress: &'a AtomicU64,
    /// Set to stop.
    pub cancel: &'a AtomicBool,
}

/// Places all vertices.
///
/// # Errors
/// If the map has no ground to stand on, or `cancel` was set.
pub fn place(placing: &Placing<'_>) -> Result<Draft, BuildError> {
    let Placing { site, settings, .. } = placing;
    let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
    let (map, profile, count) = (&site.map, &site.profile, settings.vertices);
    let only = |vertices| Draft { vertices, ..Draft::default() };
    Ok(match settings.placement {
        Placement::Random => only(random::place(map, profile, count, &mut rng)?),
        Placement::Spaced => {
            let anchors = if settings.special_moves {
                beside_devices(map, profile, count / MAX_ANCHOR_DIVISOR)
            } else {
                Vec::new()
            };
            only(spaced::place(map, profile, anchors, count, &mut rng)?)
        }
        Placement::Density => only(density::place(map, profile, count, &mut rng)?),
        Placement::Trajectories => trajectories::place(placing, &mut rng)?,
        Placement::TrajectoriesTested => {
            let Draft { vertices, episodes, .. } = trajectories::place(placing, &mut rng)?;
            Draft { vertices, episodes, ..Draft::default() }
        }
        Placement::Flood => flood::place(placing, false, &mut rng)?,
        Placement::FloodGrandchildren => flood::place(placing, true, &mut rng)?,
    })
}

/// At most one vertex in so many stands beside a device for its sake.
const MAX_ANCHOR_DIVISOR: usize = 4;

/// Spacing of `count` points spread evenly on a plane of the map's area, m.
pub fn even_spacing(map: &Map, count: usize) -> f32 {
    let extent = map.extent();
    (extent.x * extent.z / count as f32).sqrt()
}
