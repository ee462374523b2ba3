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

use crate::build::{BuildError, BuildSettings};
use crate::candidates::Candidate;
use crate::graph::Evidence;
use crate::probe::{ProbeContext, ProbeExecutor};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64};
use surefoot_world::{Map, Vec3};

/// How a graph's vertices are placed and its candidates found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Placement {
    /// Uniformly random; each vertex is tried against its nearest.
    Random,
    /// Random with a minimum distance that shrinks until all are placed; each is tried against its nearest.
    Spaced,
    /// Random with chances inverse to the local density of standing room; each is tried against its nearest.
    Density,
    /// Points along the policy's own runs, merged where they are near; edges as the runs passed them, untried.
    Trajectories,
    /// The same vertices; each is tried against its nearest.
    TrajectoriesTested,
    /// Spreads from one vertex to wherever the policy gets; parents and children are tried both ways.
    Flood,
    /// The same; grandparents and grandchildren too.
    FloodGrandchildren,
}

impl Placement {
    /// All of them, in the order of the paper's table.
    pub const ALL: [Placement; 7] = [
        Placement::Random,
        Placement::Spaced,
        Placement::Density,
        Placement::Trajectories,
        Placement::TrajectoriesTested,
        Placement::Flood,
        Placement::FloodGrandchildren,
    ];

    /// Name as used by commands.
    pub fn name(self) -> &'static str {
        match self {
            Placement::Random => "random",
            Placement::Spaced => "spaced",
            Placement::Density => "density",
            Placement::Trajectories => "trajectories",
            Placement::TrajectoriesTested => "trajectories-tested",
            Placement::Flood => "flood",
            Placement::FloodGrandchildren => "flood-grandchildren",
        }
    }

    /// The placement of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|placement| placement.name() == name)
    }
}

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
    /// On this map, as this character, with this policy.
    pub context: &'a ProbeContext,
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
    let Placing { context, settings, .. } = placing;
    let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
    let (map, profile, count) = (&context.map, &context.profile, settings.vertices);
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
