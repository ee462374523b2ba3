//! Placement of vertices, and the candidate edges that some placements find on the way.
//!
//! Each placement of the paper has a module of its own. Random, spaced and density-based placement yield only vertices;
//! placements that run the policy also yield candidate edges. The later stages of a build are the same for all.

mod anchors;
pub(crate) mod around;
mod density;
mod flood;
mod spaced;
mod trajectories;

pub use anchors::beside_devices;

use crate::build::Progress;
use crate::build::candidates::Candidate;
use crate::build::probe::{ProbeExecutor, ProbeWatch};
use crate::evidence::Evidence;
use crate::ride_stops::{Clearance, RideStops};
use crate::settings::Site;
use crate::settings::{BuildError, BuildSettings, Placement};
use rand::rngs::ChaCha8Rng;
use rand::{Rng, SeedableRng};
use std::collections::BTreeMap;
use surefoot_world::character::MoveScratch;
use surefoot_world::{Map, Vec3, navigable};

/// Placed vertices, with candidate edges and evidence where the placement ran the policy.
#[derive(Debug, Clone, Default)]
pub struct Draft {
    /// Positions of the vertices, m.
    pub vertices: Vec<Vec3>,
    /// Candidate edges; `None` to pair each vertex with its nearest neighbours.
    pub candidates: Option<Vec<Candidate>>,
    /// Evidence from runs of the policy during placement.
    pub seen: BTreeMap<Candidate, Evidence>,
    /// Number of episodes that were run.
    pub episodes: u64,
}

/// Inputs of a placement.
pub struct PlacementContext<'a> {
    /// The map and the character.
    pub site: &'a Site,
    /// Settings of the build.
    pub settings: &'a BuildSettings,
    /// The ride stops of the map, which become vertices.
    pub ride_stops: &'a RideStops,
    /// Runs episodes.
    pub executor: &'a dyn ProbeExecutor,
    /// Counts the episodes, and cancels them.
    pub progress: &'a Progress,
}

impl PlacementContext<'_> {
    fn check_cancelled(&self) -> Result<(), BuildError> {
        if self.progress.is_cancelled() { Err(BuildError::Cancelled) } else { Ok(()) }
    }

    /// Draws positions to stand at.
    fn sample(&self, count: usize, rng: &mut impl Rng) -> Result<Vec<Vec3>, BuildError> {
        let mut scratch = MoveScratch::default();
        let draw = |_| {
            self.check_cancelled()?;
            Ok(navigable::sample(&self.site.map, &self.site.profile, rng, &mut scratch)?)
        };
        (0..count).map(draw).collect()
    }
}

/// Places all vertices.
///
/// # Errors
/// If the map has no navigable ground, or the build was cancelled.
pub fn place(placing: &PlacementContext<'_>) -> Result<Draft, BuildError> {
    let PlacementContext { site, settings, .. } = placing;
    let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
    let (map, profile, count) = (&site.map, &site.profile, settings.vertices);
    let clearance = Clearance::of(site);
    let only = |mut vertices: Vec<Vec3>| {
        // A body waiting in a mover's path would block it.
        vertices.retain(|feet| clearance.is_clear(*feet));
        Draft { vertices, ..Draft::default() }
    };
    let mut draft = match settings.placement {
        // The paper's first builder (section "Unconstrained random vertex placement").
        Placement::Random => only(placing.sample(count, &mut rng)?),
        Placement::Spaced => {
            let anchors = if settings.special_moves {
                beside_devices(map, profile, count / MAX_ANCHOR_DIVISOR)
            } else {
                Vec::new()
            };
            only(spaced::place(placing, anchors, &mut rng)?)
        }
        Placement::Density => only(density::place(placing, &mut rng)?),
        Placement::Trajectories => trajectories::place(placing, &mut rng)?,
        Placement::TrajectoriesTested => {
            let Draft { vertices, episodes, .. } = trajectories::place(placing, &mut rng)?;
            Draft { vertices, episodes, ..Draft::default() }
        }
        Placement::Flood => flood::place(placing, false, &mut rng)?,
        Placement::FloodGrandchildren => flood::place(placing, true, &mut rng)?,
    };
    draft.vertices.extend(placing.ride_stops.places());
    Ok(draft)
}

/// At most one vertex in this many is reserved for devices.
const MAX_ANCHOR_DIVISOR: usize = 4;

/// Returns the spacing of `count` points spread evenly over a plane of the map's area, m.
pub fn even_spacing(map: &Map, count: usize) -> f32 {
    let extent = map.extent();
    (extent.x * extent.z / count as f32).sqrt()
}
