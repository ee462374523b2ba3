//! Sets of goals on maps.

use super::VERSION;
use crate::{EvalError, EvalMap, MapName, draw_goals};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surefoot_rollout::Goal;
use surefoot_world::map::MapKind;
use surefoot_world::{CharacterProfile, Map, MapSpec, Vec3};

/// Names of the sets of the challenge, from the smallest.
pub const SETS: [&str; 3] = ["paper-like", "kinds", "benchmark"];
/// Goals of each map of the named sets.
const GOALS: usize = 300;
/// Seed of the goals of the named sets.
pub(super) const SEED: u64 = 0;

/// Goals on maps, for one body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GoalSet {
    /// Version of the challenge.
    pub challenge: u32,
    /// Name of the set; `custom` for one that is not of the challenge.
    pub set: String,
    /// Body of the characters.
    pub body: CharacterProfile,
    /// Maps with their goals.
    pub maps: Vec<SetMap>,
}

/// A map of a set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SetMap {
    /// Name of the map, unique in the set.
    pub name: String,
    /// What the map is generated from; absent for a level.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spec: Option<MapSpec>,
    /// File of the level; absent for a generated map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// Content hash of the map.
    pub hash: String,
    /// Goals, the nearest first.
    pub goals: Vec<SetGoal>,
}

/// A start and a goal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SetGoal {
    /// Position of the feet at the start, m.
    pub start: [f32; 3],
    /// Heading at the start, rad.
    pub yaw: f32,
    /// Position that the feet must reach, m.
    pub goal: [f32; 3],
}

impl From<Goal> for SetGoal {
    fn from(Goal { start, yaw, goal }: Goal) -> Self {
        Self { start: start.to_array(), yaw, goal: goal.to_array() }
    }
}

impl From<SetGoal> for Goal {
    fn from(SetGoal { start, yaw, goal }: SetGoal) -> Self {
        Self { start: Vec3::from_array(start), yaw, goal: Vec3::from_array(goal) }
    }
}

/// Why a set cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SetError {
    /// There is no such set.
    #[error("there is no set `{0}`: there are {names}", names = SETS.join(", "))]
    Unknown(String),
    /// There is no such part of a set.
    #[error("`{0}` is no part of a set: after the colon, give the numbers of maps and goals, such as benchmark:8x128")]
    Part(String),
    /// The set has another version.
    #[error("the set has version {0} of the challenge, this program has version {VERSION}")]
    Version(u32),
    /// Two maps have the same name.
    #[error("two maps of the set have the name `{0}`")]
    SameName(String),
    /// Its goals are out of bounds.
    #[error("goal {idx} of map `{map}` is not a place: numbers must be finite and within 10 km")]
    Goal {
        /// Name of the map.
        map: String,
        /// Index of the goal.
        idx: usize,
    },
    /// The content of a map differs from the map of the goals.
    #[error("map `{0}` differs from the map that the goals were drawn on: another content hash")]
    OtherMap(String),
    /// A map has movers, so attempts depend on their time and on other NPCs.
    #[error("map {0} has doors, lifts or other movers: attempts on it cannot be repeated one by one")]
    Movers(MapName),
    /// A map's file cannot be read.
    #[error("cannot read {path}: {reason}")]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Goals cannot be drawn.
    #[error(transparent)]
    Draw(#[from] EvalError),
}

impl GoalSet {
    /// A set of the challenge. It is the same on every machine. Its maps are generated, which takes about a second for
    /// four. A name such as `benchmark:8x128` stands for a part: the first 8 maps with 128 goals each, near and far
    /// ones.
    ///
    /// # Errors
    /// If there is no such set, or no such part.
    pub fn named(name: &str) -> Result<Self, SetError> {
        let terrain = |seeds: std::ops::Range<u64>| seeds.map(MapSpec::new).collect::<Vec<_>>();
        let (whole, part) = name.split_once(':').map_or((name, None), |(whole, part)| (whole, Some(part)));
        let mut specs = match whole {
            "paper-like" => terrain(2000..2004),
            "benchmark" => terrain(5000..5064),
            "kinds" => {
                let of = |kind| terrain(5000..5004).into_iter().map(move |spec| (kind, spec));
                let with = |(kind, spec): (MapKind, MapSpec)| spec.with(|it| it.kind = kind).expect("any kind will do");
                MapKind::USUAL.into_iter().flat_map(of).map(with).collect()
            }
            _ => return Err(SetError::Unknown(name.to_owned())),
        };
        let wrong = || SetError::Part(name.to_owned());
        let part = part.map(|part| part.split_once('x').ok_or_else(wrong)).transpose()?;
        let count = |text: &str, most: usize| {
            text.parse::<usize>().ok().filter(|count| (1..=most).contains(count)).ok_or_else(wrong)
        };
        let goals = part.map(|(_, goals)| count(goals, GOALS)).transpose()?;
        specs.truncate(part.map(|(maps, _)| count(maps, specs.len())).transpose()?.unwrap_or(specs.len()));
        let maps = specs.into_iter().map(|spec| (EvalMap::from(spec), None)).collect();
        let mut set = Self::draw(name, maps, CharacterProfile::of_paper(), GOALS, SEED)?;
        if let Some(goals) = goals {
            for map in &mut set.maps {
                map.goals = (0..goals).map(|idx| map.goals[idx * GOALS / goals]).collect();
            }
        }
        Ok(set)
    }

    /// Draws `goals` goals on each map, as [`evaluate`](crate::evaluate) does; levels come with their files.
    ///
    /// # Errors
    /// If a map has too few goals.
    pub fn draw(
        name: &str,
        maps: Vec<(EvalMap, Option<PathBuf>)>,
        body: CharacterProfile,
        goals: usize,
        seed: u64,
    ) -> Result<Self, SetError> {
        let drawn = maps.into_iter().map(|(choice, file)| {
            let map = choice.load();
            if !map.movers().is_empty() {
                return Err(SetError::Movers(choice.name()));
            }
            let goals = draw_goals((&map, &choice), (&body, None), &(1.0..f32::INFINITY), goals, seed)?;
            let (name, spec) = match &choice {
                EvalMap::Generated(spec) => (format!("{}-{}", spec.kind.name(), spec.seed), Some(*spec)),
                EvalMap::Level { name, .. } => (name.clone(), None),
            };
            let goals = goals.into_iter().map(SetGoal::from).collect();
            Ok(SetMap { name, spec, file, hash: map.hash().to_hex(), goals })
        });
        let maps = drawn.collect::<Result<Vec<_>, SetError>>()?;
        let set = Self { challenge: VERSION, set: name.to_owned(), body, maps };
        set.check().map(|()| set)
    }

    /// Hash of everything in the set: maps, body and goals.
    pub fn hash(&self) -> String {
        let text = serde_json::to_vec(self).expect("a set is plain data");
        blake3::hash(&text).to_hex().to_string()
    }

    /// Checks a set that was read from a file.
    ///
    /// # Errors
    /// If the version, the names of maps or the goals are invalid.
    pub fn check(&self) -> Result<(), SetError> {
        /// m.
        const FARTHEST: f32 = 1.0e4;
        if self.challenge != VERSION {
            return Err(SetError::Version(self.challenge));
        }
        for (idx, map) in self.maps.iter().enumerate() {
            if self.maps[..idx].iter().any(|other| other.name == map.name) {
                return Err(SetError::SameName(map.name.clone()));
            }
            let is_place = |goal: &SetGoal| {
                let numbers = goal.start.iter().chain(&goal.goal).chain([&goal.yaw]);
                numbers.into_iter().all(|value| value.abs() <= FARTHEST)
            };
            if let Some(idx) = map.goals.iter().position(|goal| !is_place(goal)) {
                return Err(SetError::Goal { map: map.name.clone(), idx });
            }
        }
        Ok(())
    }
}

impl SetMap {
    /// What reports call the map.
    pub fn report_name(&self) -> MapName {
        MapName::Level(self.name.clone())
    }

    /// The map: generated, or read from its file in `folder`.
    ///
    /// # Errors
    /// If the file cannot be read, or the map is not the one that the goals were drawn on.
    pub fn load(&self, folder: &Path) -> Result<Arc<Map>, SetError> {
        let map = match (&self.spec, &self.file) {
            (Some(spec), _) => surefoot_generate::generate(spec),
            (None, Some(file)) => read(&folder.join(file))?,
            (None, None) => return Err(SetError::OtherMap(self.name.clone())),
        };
        if map.hash().to_hex() == self.hash { Ok(Arc::new(map)) } else { Err(SetError::OtherMap(self.name.clone())) }
    }
}

fn read(path: &Path) -> Result<Map, SetError> {
    let wrong = |reason: String| SetError::File { path: path.to_owned(), reason };
    let bytes = std::fs::read(path).map_err(|error| wrong(error.to_string()))?;
    surefoot_levels::decode(&bytes).map_err(|error| wrong(error.to_string()))
}
