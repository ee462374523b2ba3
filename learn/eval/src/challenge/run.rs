//! Runs: an entrant's attempts at the goals of a set.

use super::VERSION;
use super::set::GoalSet;
use serde::{Deserialize, Serialize};
use surefoot_rollout::drive::PathPoint;
use surefoot_world::character::{ACTION_LEN, Action};

/// Most points of a path.
pub const MAX_POINTS: usize = 10_000;
/// Most decisions of an attempt: 300 s.
pub const MAX_DECISIONS: usize = 1800;

/// Number of values of a body in a track.
pub const SAMPLE_LEN: usize = 8;

/// An entrant's attempts at the goals of a set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Run {
    /// Version of the challenge.
    pub challenge: u32,
    /// Name of the set.
    pub set: String,
    /// Name of the entrant.
    pub entrant: String,
    /// Description of the entrant: its version, and the machine that it ran on.
    #[serde(default)]
    pub about: String,
    /// One run for each map of the set, in any order.
    pub maps: Vec<MapRun>,
}

/// The attempts on one map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapRun {
    /// Name of the map.
    pub name: String,
    /// Time for preparing the map, s; printed beside the score.
    #[serde(default)]
    pub build_s: f64,
    /// Size of the prepared data, bytes; printed beside the score.
    #[serde(default)]
    pub bytes: u64,
    /// One for each goal, in the order of the set.
    pub attempts: Vec<Approach>,
}

/// The attempt at one goal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Approach {
    /// A path from the start to the goal, which a plain controller drives.
    Path(Vec<PathPoint>),
    /// The actions of every decision of 10 ticks: forward, strafe, turn, jump, each -1 to 1.
    Actions(Vec<[f32; ACTION_LEN]>),
    /// Where a body of another program was at the start and after every 10 ticks: `x y z`, heading, velocity `x y z`,
    /// and 1 in the air, otherwise 0; in m, rad and m/s. Its motion can be measured; it has no score.
    Track(Vec<[f32; SAMPLE_LEN]>),
    /// The entrant reports the goal as unreachable.
    Unreachable,
}

/// Why a run cannot be scored.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The run has another version.
    #[error("the run has version {0} of the challenge, this program has version {VERSION}")]
    Version(u32),
    /// The run belongs to another set.
    #[error("the run belongs to the set `{run}`, not to `{set}`")]
    OtherSet {
        /// Set of the run.
        run: String,
        /// Set of the goals.
        set: String,
    },
    /// A map is missing, unknown or given twice.
    #[error("the run has {count} entries for the map `{map}`; each map of the set needs one, and there are no others")]
    Map {
        /// Name of the map.
        map: String,
        /// Entries for it.
        count: usize,
    },
    /// Attempts are missing, or there are too many.
    #[error("the run has {count} attempts on `{map}`; the set has {goals} goals there")]
    Count {
        /// Name of the map.
        map: String,
        /// Attempts on it.
        count: usize,
        /// Goals of the set.
        goals: usize,
    },
    /// Attempts are tracks, which have no score.
    #[error("the attempts on `{0}` are tracks, which another program's physics made: only their motion is measured")]
    Track(String),
    /// An attempt is invalid.
    #[error("attempt {idx} on `{map}`: {wrong}")]
    Attempt {
        /// Name of the map.
        map: String,
        /// Index of the attempt.
        idx: usize,
        /// What is wrong with it.
        wrong: String,
    },
}

impl Run {
    /// Checks the run against a set, and returns its maps in the order of the set.
    ///
    /// # Errors
    /// If versions, sets, maps or attempts do not match.
    pub fn check(&self, set: &GoalSet) -> Result<Vec<&MapRun>, RunError> {
        if self.challenge != VERSION {
            return Err(RunError::Version(self.challenge));
        }
        if self.set != set.set {
            return Err(RunError::OtherSet { run: self.set.clone(), set: set.set.clone() });
        }
        for run in &self.maps {
            let count = self.maps.iter().filter(|it| it.name == run.name).count();
            let is_known = set.maps.iter().any(|it| it.name == run.name);
            if count != 1 || !is_known {
                return Err(RunError::Map { map: run.name.clone(), count });
            }
            for (idx, attempt) in run.attempts.iter().enumerate() {
                attempt.check().map_err(|wrong| RunError::Attempt { map: run.name.clone(), idx, wrong })?;
            }
        }
        let of = |map: &super::set::SetMap| {
            let run = self.maps.iter().find(|it| it.name == map.name);
            let run = run.ok_or_else(|| RunError::Map { map: map.name.clone(), count: 0 })?;
            if run.attempts.len() == map.goals.len() {
                return Ok(run);
            }
            Err(RunError::Count { map: map.name.clone(), count: run.attempts.len(), goals: map.goals.len() })
        };
        set.maps.iter().map(of).collect()
    }
}

impl Approach {
    fn check(&self) -> Result<(), String> {
        /// m.
        const FARTHEST: f32 = 1.0e4;
        match self {
            Self::Unreachable => Ok(()),
            Self::Path(points) if points.len() > MAX_POINTS => {
                Err(format!("its path has {} points, at most {MAX_POINTS} are allowed", points.len()))
            }
            Self::Path(points) => {
                let is_place = |point: &PathPoint| point.at.iter().all(|value| value.abs() <= FARTHEST);
                match points.iter().position(|point| !is_place(point)) {
                    Some(idx) => Err(format!("point {idx} is not a place: numbers must be finite and within 10 km")),
                    None => Ok(()),
                }
            }
            Self::Track(samples) if samples.len() > MAX_DECISIONS + 1 => {
                Err(format!("its track has {} bodies, at most {} are allowed", samples.len(), MAX_DECISIONS + 1))
            }
            Self::Track(samples) => match samples.iter().position(|it| !it.iter().all(|value| value.abs() <= FARTHEST))
            {
                Some(idx) => Err(format!("body {idx} of its track has numbers that are not within 10,000")),
                None => Ok(()),
            },
            Self::Actions(actions) if actions.len() > MAX_DECISIONS => {
                Err(format!("it has {} decisions, at most {MAX_DECISIONS} (300 s) are allowed", actions.len()))
            }
            Self::Actions(actions) => actions
                .iter()
                .try_for_each(|action| Action::from_array(*action).map(|_| ()).map_err(|error| error.to_string())),
        }
    }
}
