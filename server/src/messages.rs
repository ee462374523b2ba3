//! What a world and the workers that carry its NPCs say to each other. How it looks on the wire is decided in `wire.rs`.

use crate::hosted::{NpcPlan, TimeMode};
use crate::ids::WorkerId;
use crate::ids::{NpcId, WorldId};
use surefoot_world::{Action, End, MapHash, MapSpec, Tick, Vec3};

/// What a worker is sent.
#[derive(Debug, Clone, PartialEq)]
pub enum ToWorker {
    /// The first message: its id.
    Welcome(WorkerId),
    /// NPCs that it no longer carries.
    Release(WorldId, Vec<NpcId>),
    /// NPCs that it carries from now on.
    Assignment(Assignment),
    /// Attempts that ended.
    Ended(WorldId, Vec<AttemptEnd>),
    /// Observations to be answered.
    Observations(ObservationBatch),
    /// A world that has ended: nothing more will come of it.
    Over(WorldId),
    /// The last message: why its stream ends.
    Goodbye(Goodbye),
}

/// NPCs of one world for one worker.
#[derive(Debug, Clone, PartialEq)]
pub struct Assignment {
    /// The world.
    pub world: WorldId,
    /// What its map was generated from; `None` for an imported one.
    pub spec: Option<MapSpec>,
    /// Hash of its map.
    pub map_hash: MapHash,
    /// How its time passes.
    pub mode: TimeMode,
    /// The NPCs.
    pub npcs: Vec<NpcId>,
}

/// An attempt that ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AttemptEnd {
    /// Whose.
    pub npc: NpcId,
    /// Its number among that NPC's attempts.
    pub attempt: u32,
    /// How.
    pub end: End,
}

/// Observations of NPCs whose decision is due.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservationBatch {
    /// Their world.
    pub world: WorldId,
    /// When they were made.
    pub tick: Tick,
    /// Whose they are.
    pub npcs: Vec<NpcId>,
    /// [`OBSERVATION_LEN`](surefoot_world::OBSERVATION_LEN) values for each.
    pub observations: Vec<f32>,
    /// Where the feet of each are, m.
    pub positions: Vec<Vec3>,
    /// The goal of each, m.
    pub goals: Vec<Vec3>,
    /// The number of the attempt of each.
    pub attempts: Vec<u32>,
    /// Whether each has touched its waypoint.
    pub waypoint_reached: Vec<bool>,
    /// Whether each stands on ground that can be walked.
    pub grounded: Vec<bool>,
}

impl ObservationBatch {
    /// No observations yet.
    pub fn new(world: WorldId, tick: Tick) -> Self {
        Self {
            world,
            tick,
            npcs: Vec::new(),
            observations: Vec::new(),
            positions: Vec::new(),
            goals: Vec::new(),
            attempts: Vec::new(),
            waypoint_reached: Vec::new(),
            grounded: Vec::new(),
        }
    }
}

/// Why a worker's stream ends.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Goodbye {
    /// The server is shutting down.
    #[error("the service is shutting down: connect again later")]
    ShuttingDown,
    /// Too many messages wait for it.
    #[error("messages were not read: connect again")]
    NotReading,
    /// It sent something other than actions after its hello.
    #[error("after hello only actions may be sent")]
    Unexpected,
    /// An answer makes no sense: the field, and what is wrong with it.
    #[error("{1}")]
    BadAnswer(String, String),
}

/// What a worker says first, checked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hello {
    /// Name for people.
    pub name: String,
    /// What it decides with, for people.
    pub policy: String,
    /// NPCs that it is ready to carry.
    pub capacity: u32,
}

/// A worker's answer, checked.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Answer {
    /// Tick of the observations.
    pub tick: Tick,
    /// Decisions, each for another NPC.
    pub decisions: Vec<Decision>,
    /// New waypoints, m, with the attempts that they are for.
    pub waypoints: Vec<(NpcId, u32, Vec3)>,
    /// Attempts to be given up.
    pub gave_up: Vec<(NpcId, u32)>,
    /// New plans, with the attempts that they are for.
    pub plans: Vec<(NpcId, u32, NpcPlan)>,
    /// Plans that the planner has not delivered since the worker's last answer.
    pub plans_failed: u32,
    /// Actions, waypoints and plans among these that were left out because a number made no sense.
    pub invalid: u64,
}

/// What a worker decided for one NPC.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decision {
    /// The NPC.
    pub npc: NpcId,
    /// The attempt that was observed.
    pub attempt: u32,
    /// The action; `None` if it is not finite.
    pub action: Option<Action>,
}
