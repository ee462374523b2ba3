//! Probes of candidate edges: their inputs, their outcomes, and [`ProbeExecutor`], the trait that runs the policy.

use crate::ids::EdgeKey;
use crate::needs::{Needs, Ride};
use serde::{Deserialize, Serialize};
use surefoot_world::{Ability, Arrival, Motion, MoverAt, Vec3};

/// The input of one probe.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Position of the feet at the start, m.
    pub start: Vec3,
    /// Position that the feet should reach first, m. The body then heads for the goal on the run, like an NPC with a
    /// plan.
    pub via: Option<Vec3>,
    /// Position that the feet should reach, m.
    pub goal: Vec3,
    /// What counts as having arrived at each of them.
    pub arrival: Arrival,
    /// Number of the probe's random stream under the seed of the run.
    pub stream: u64,
    /// How the body moves.
    pub manner: Manner,
    /// Whether to record the track.
    pub keep_track: bool,
    /// A mover that is held at a stop; all others stand where movers usually stand in probes.
    pub held: Option<MoverAt>,
    /// The ride that the probe takes, if any: the body stands still on the mover.
    pub ride: Option<Ride>,
}

/// How the body of a probe moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Manner {
    /// As its policy does.
    #[default]
    Free,
    /// In the style of legs that can be walked, without jumps.
    OnFoot,
    /// Steered: by a crossing on its way, over a gap, or straight through water.
    Steered,
}

impl Manner {
    /// How the body of a run along a proved edge moves that needs `ability`.
    pub fn of_edge(ability: Ability) -> Self {
        match ability.motion() {
            Motion::Surface
            | Motion::Swim
            | Motion::Dive
            | Motion::Crouch
            | Motion::Slide
            | Motion::Dash
            | Motion::WallRun
            | Motion::Own => Self::Steered,
            Motion::Walk
            | Motion::Jump
            | Motion::AirJump
            | Motion::Throw
            | Motion::Ride
            | Motion::Teleport
            | Motion::Thrust
            | Motion::Pull => Self::Free,
        }
    }
}

impl Trial {
    /// A free run from `start` to `goal`, m, where the body must stand, with the random stream `stream`.
    pub fn walk(start: Vec3, goal: Vec3, stream: u64) -> Self {
        let arrival = Arrival::Stand;
        Self {
            start,
            via: None,
            goal,
            arrival,
            stream,
            manner: Manner::Free,
            keep_track: false,
            held: None,
            ride: None,
        }
    }
}

/// A run along an edge or candidate. Each has a random stream of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EdgeRun {
    /// A probe from the start of the edge, by its number.
    Probe(u32),
    /// A probe that reaches the start of the edge at a run, by its number.
    RunUp(u32),
    /// The probe without jumps.
    OnFoot,
    /// A run that measures the shape of the edge, by its number.
    Shape(u32),
}

impl EdgeRun {
    /// Number of the run's random stream: the runs of an edge share 16 bits in bands that do not overlap.
    pub fn stream(self, EdgeKey { from, to }: EdgeKey) -> u64 {
        let run = match self {
            Self::Probe(number) => number,
            Self::RunUp(number) => (1 << 12) + number,
            Self::OnFoot => 1 << 13,
            Self::Shape(number) => (1 << 14) + number,
        };
        u64::from(from.0) << 40 | u64::from(to.0) << 16 | u64::from(run)
    }
}

/// The outcome of one probe.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Whether the probe arrived.
    pub reached: bool,
    /// Whether the probe ended because the body fell out of the map, burnt or drowned.
    pub died: bool,
    /// Number of decisions.
    pub decisions: u32,
    /// The most demanding ability that the probe used.
    pub ability: Ability,
    /// Lower and upper corner of the bounding box of the track, m.
    pub bounds: [Vec3; 2],
    /// Positions of the feet at the start and after each decision, m; `None` in the air. Empty unless the trial asked
    /// to record the track.
    pub track: Vec<Option<Vec3>>,
    /// The movers that the probe depended on.
    pub needs: Needs,
    /// Outcome of the run to [`Trial::via`], if there was one. All other fields describe the run from there to the
    /// goal.
    pub approach: Option<Box<Outcome>>,
}

impl Outcome {
    /// The outcome of a probe that has just begun at `start`, m.
    pub fn begin(start: Vec3) -> Self {
        Self {
            reached: false,
            died: false,
            decisions: 0,
            ability: Ability::WALK,
            bounds: [start; 2],
            track: Vec::new(),
            needs: Needs::default(),
            approach: None,
        }
    }

    /// Whether the run to the goal was begun: the run to [`Trial::via`] may have failed before.
    pub fn was_begun(&self) -> bool {
        self.approach.as_ref().is_none_or(|approach| approach.reached)
    }
}

/// Watches probes finish, in any order and on any thread, and may cancel the others.
pub trait ProbeWatch: Sync {
    /// Called once for each trial, by its index, as soon as its outcome is known.
    fn finished(&self, trial: usize, outcome: &Outcome);

    /// Whether the remaining trials need not be run.
    fn is_cancelled(&self) -> bool;
}

/// Runs probes.
pub trait ProbeExecutor {
    /// Runs all trials and returns their outcomes, in order. The same trials and seed give the same outcomes.
    ///
    /// Returns `None` if `watch` cancelled before the last trial finished.
    fn run(&self, trials: &[Trial], seed: u64, watch: &dyn ProbeWatch) -> Option<Vec<Outcome>>;

    /// Whether bodies are steered over gaps where [`Manner::Steered`] asks for it.
    fn steers_leaps(&self) -> bool {
        true
    }
}
