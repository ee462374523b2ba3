//! What determines a graph: the map and character, the policy, and the settings of its build.
//!
//! Users choose the settings; [`GraphId`] hashes everything that determines a graph.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Deref;
use std::sync::Arc;
use strum::{EnumString, IntoStaticStr, VariantArray};
use surefoot_world::navigable::NoGround;
use surefoot_world::{Arrival, CharacterProfile, Map};

/// Version of the builder. It changes whenever the same settings would yield a different graph.
pub const BUILDER_VERSION: u32 = 21;

/// How vertices are placed and candidate edges are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, VariantArray, IntoStaticStr, EnumString)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "kebab-case")]
pub enum Placement {
    /// Uniformly random; each vertex is probed against its nearest neighbours.
    Random,
    /// Random with a minimum distance that shrinks until all vertices are placed; each is probed against its nearest
    /// neighbours.
    Spaced,
    /// Random with probabilities inverse to the local density of navigable ground; each vertex is probed against its
    /// nearest neighbours.
    Density,
    /// Points along runs of the policy, merged where they are near; edges as the runs passed them, without probes.
    Trajectories,
    /// The vertices of `Trajectories`; each is probed against its nearest neighbours.
    TrajectoriesTested,
    /// Spreads from one vertex to wherever the policy arrives; parents and children are probed in both directions.
    Flood,
    /// `Flood`, where grandparents and grandchildren are probed as well.
    FloodGrandchildren,
}

impl Placement {
    /// All placements, in the order of the paper's table.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// Returns the name that commands use.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// How many probes a build spends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, IntoStaticStr)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "kebab-case")]
pub enum Probing {
    /// All repeats of every candidate edge, as in the paper.
    Exhaustive,
    /// As few as decide each candidate edge, chosen by a predictor that is fitted during the build.
    Frugal,
}

impl Probing {
    /// Returns the name that commands use.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Everything that determines a graph besides map, character and policy.
///
/// All values are in range; [`RawBuildSettings`] holds unchecked values.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawBuildSettings")]
pub struct BuildSettings(RawBuildSettings);

/// The values of [`BuildSettings`], not yet checked. The default is valid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RawBuildSettings {
    /// How vertices are placed. Default: [`Placement::Spaced`].
    pub placement: Placement,
    /// Most vertices, at least 2. [`Placement::Spaced`] places fewer where they would be nearer than 1 m to one
    /// another, and all others this many. Ride stops of lifts and platforms are added to them; together they may be at
    /// most [`MAX_VERTICES`]. With special moves and frugal probing, up to twice as many are added to join islands.
    /// Default: 300.
    pub vertices: usize,
    /// Number of nearest neighbours that each vertex is probed against, 1 to 64. Default: 12.
    pub neighbours: usize,
    /// Maximum number of probes per candidate edge, 1 to 32. Default: 2.
    pub repeats: u32,
    /// Share of probes that must succeed to prove an edge, 1e-6 to 1. With frugal probing, an edge that succeeded more
    /// rarely stays if nothing else leads where it leads. Default: 0.2.
    pub threshold: f64,
    /// Seed of placement and probes. Default: 0.
    pub seed: u64,
    /// How many probes the build spends. Default: [`Probing::Frugal`].
    pub probing: Probing,
    /// Whether vertices and candidate edges also come from devices, ledges and ways of the survey, unlike in the paper.
    /// Default: true.
    pub special_moves: bool,
    /// What counts as having arrived at the end of an edge. Default: [`Arrival::Stand`]; paper: [`Arrival::Touch`].
    pub arrival: Arrival,
}

impl BuildSettings {
    /// Returns the settings of the paper for a placement: exhaustive probing, no special moves, and edges that a touch
    /// proves.
    pub fn of_paper(placement: Placement) -> Self {
        let (raw, arrival) = (RawBuildSettings::default(), Arrival::Touch);
        let probing = Probing::Exhaustive;
        Self(RawBuildSettings { placement, threshold: 0.5, probing, special_moves: false, arrival, ..raw })
    }

    /// Returns these settings with a change applied.
    ///
    /// # Errors
    /// Returns the first setting that is out of range.
    pub fn with(&self, change: impl FnOnce(&mut RawBuildSettings)) -> Result<Self, SettingError> {
        let mut raw = self.0;
        change(&mut raw);
        raw.try_into()
    }

    /// Returns these settings with another seed.
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
            threshold: 0.2,
            seed: 0,
            probing: Probing::Frugal,
            special_moves: true,
            arrival: Arrival::Stand,
        }
    }
}

/// Maximum number of vertices of a graph.
pub const MAX_VERTICES: usize = 16_384;

/// A setting that is out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("settings.{field} is {value}; it must be between {min} and {max}")]
pub struct SettingError {
    /// Name of the setting.
    pub field: &'static str,
    /// The value.
    pub value: f64,
    /// Smallest allowed value.
    pub min: f64,
    /// Largest allowed value.
    pub max: f64,
}

/// Why a graph cannot be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BuildError {
    /// The map has no navigable ground.
    #[error(transparent)]
    NoGround(#[from] NoGround),
    /// There are too many vertices, because the ride stops of lifts and platforms are vertices, too.
    #[error(
        "settings.vertices is {vertices}, and the lifts and platforms of the map have {ride_stops} stops where an NPC \
         can stand; together they may be at most {MAX_VERTICES}"
    )]
    TooManyRideStops {
        /// The setting.
        vertices: usize,
        /// Number of ride stops.
        ride_stops: usize,
    },
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

/// A map and the profile of the character that moves on it.
#[derive(Debug, Clone)]
pub struct Site {
    /// The map.
    pub map: Arc<Map>,
    /// The character's profile.
    pub profile: CharacterProfile,
}

impl Site {
    /// Creates a site of `map` and the default character.
    pub fn new(map: Arc<Map>) -> Self {
        Self { map, profile: CharacterProfile::default() }
    }
}

/// Hash of a policy's weights, in hexadecimal digits, as in the policy's manifest.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PolicyHash(String);

impl PolicyHash {
    /// Wraps the hash from a manifest.
    pub fn new(weights_hash: impl Into<String>) -> Self {
        Self(weights_hash.into())
    }

    /// Returns the hexadecimal digits.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

/// Identity of a graph: the hash of everything that determines it.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GraphId(pub [u8; 32]);

impl GraphId {
    /// Returns the id of the graph that is built with `settings` on `site` and proved by `policy`.
    pub fn of(site: &Site, policy: &PolicyHash, settings: &BuildSettings) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&BUILDER_VERSION.to_le_bytes());
        hasher.update(&site.map.hash().0);
        hasher.update(policy.as_str().as_bytes());
        let data = postcard::to_stdvec(&(&site.profile, settings)).expect("plain data");
        hasher.update(&data);
        Self(*hasher.finalize().as_bytes())
    }

    /// Parses 64 hexadecimal digits; `None` if `text` is anything else.
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
