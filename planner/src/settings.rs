//! What a graph is built with, and the identity that follows from it.
//!
//! Settings are the numbers a user may choose; [`GraphId`] hashes them with everything else that decides a graph.

use crate::site::{PolicyHash, Site};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Deref;
use surefoot_world::navigable::NoGround;

/// Changes whenever equal settings would build another graph.
pub const BUILDER_VERSION: u32 = 4;

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

/// How many probes are spent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Probing {
    /// Every candidate, every time: the paper's way.
    Exhaustive,
    /// As few as settle the matter, chosen by a predictor.
    Frugal,
}

impl Probing {
    /// Name as used by commands.
    pub fn name(self) -> &'static str {
        match self {
            Probing::Exhaustive => "exhaustive",
            Probing::Frugal => "frugal",
        }
    }
}

/// Everything that decides a graph besides map, character and policy.
///
/// It exists only checked; [`RawBuildSettings`] is what can be asked for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawBuildSettings")]
pub struct BuildSettings(RawBuildSettings);

/// The numbers of [`BuildSettings`], as somebody asks for them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RawBuildSettings {
    /// How vertices are placed.
    pub placement: Placement,
    /// How many, at least 2.
    pub vertices: usize,
    /// Nearest vertices that each is tried against, 1 to 64.
    pub neighbours: usize,
    /// Tries per candidate edge, 1 to 32.
    pub repeats: u32,
    /// Share of tries that must succeed, above 0, at most 1.
    pub threshold: f64,
    /// Seed of placement and probes.
    pub seed: u64,
    /// How many probes are spent.
    pub probing: Probing,
    /// Whether vertices and candidates also come from devices and ledges; the paper has none.
    pub special_moves: bool,
}

impl BuildSettings {
    /// One of the paper's builders as the paper has it: every candidate tried every time, nothing from features.
    pub fn of_paper(placement: Placement) -> Self {
        Self(RawBuildSettings { placement, probing: Probing::Exhaustive, special_moves: false, ..Default::default() })
    }

    /// These settings with a change.
    ///
    /// # Errors
    /// Names the first setting out of range.
    pub fn with(&self, change: impl FnOnce(&mut RawBuildSettings)) -> Result<Self, SettingError> {
        let mut raw = self.0;
        change(&mut raw);
        raw.try_into()
    }

    /// These settings with another seed.
    #[must_use]
    pub fn with_seed(&self, seed: u64) -> Self {
        Self(RawBuildSettings { seed, ..self.0 })
    }
}

impl Deref for BuildSettings {
    type Target = RawBuildSettings;

    fn deref(&self) -> &RawBuildSettings {
        &self.0
    }
}

impl TryFrom<RawBuildSettings> for BuildSettings {
    type Error = SettingError;

    fn try_from(raw: RawBuildSettings) -> Result<Self, SettingError> {
        raw.check().map(|()| Self(raw))
    }
}

impl Default for RawBuildSettings {
    fn default() -> Self {
        Self {
            placement: Placement::Spaced,
            vertices: 300,
            neighbours: 12,
            repeats: 2,
            threshold: 0.5,
            seed: 0,
            probing: Probing::Frugal,
            special_moves: true,
        }
    }
}

/// Most vertices of any graph.
pub const MAX_VERTICES: usize = 4096;

/// A setting is out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("settings.{field} is {value}, allowed are {min} to {max}")]
pub struct SettingError {
    /// Which.
    pub field: &'static str,
    /// What was asked for.
    pub value: f64,
    /// Smallest allowed value.
    pub min: f64,
    /// Largest allowed value.
    pub max: f64,
}

/// Why a graph cannot be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BuildError {
    /// The map offers nowhere to stand.
    #[error(transparent)]
    NoGround(#[from] NoGround),
    /// The build was cancelled.
    #[error("the build was cancelled")]
    Cancelled,
}

impl RawBuildSettings {
    fn check(&self) -> Result<(), SettingError> {
        let checks = [
            ("vertices", self.vertices as f64, 2.0, MAX_VERTICES as f64),
            ("neighbours", self.neighbours as f64, 1.0, 64.0),
            ("repeats", f64::from(self.repeats), 1.0, 32.0),
            ("threshold", self.threshold, 1.0e-6, 1.0),
        ];
        for (field, value, min, max) in checks {
            if !(min..=max).contains(&value) {
                return Err(SettingError { field, value, min, max });
            }
        }
        Ok(())
    }
}

/// Identity of a graph: hash of all that decides it.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GraphId(pub [u8; 32]);

impl GraphId {
    /// The id of the graph that `settings` build on `site`, proved by the policy of these weights.
    pub fn of(site: &Site, policy: &PolicyHash, settings: &BuildSettings) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&BUILDER_VERSION.to_le_bytes());
        hasher.update(&site.map.hash().0);
        hasher.update(policy.as_str().as_bytes());
        let data = postcard::to_stdvec(&(&site.profile, settings)).expect("plain data");
        hasher.update(&data);
        Self(*hasher.finalize().as_bytes())
    }

    /// Reads 64 hexadecimal digits.
    pub fn parse(text: &str) -> Option<Self> {
        blake3::Hash::from_hex(text).ok().map(|hash| Self(*hash.as_bytes()))
    }
}

impl fmt::Display for GraphId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for GraphId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "GraphId({self})")
    }
}
