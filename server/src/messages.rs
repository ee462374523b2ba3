//! Messages between a world and the workers that decide for its NPCs. `wire/worker.rs` converts them.

use crate::hosted::{NpcPlan, Standing};
use crate::ids::WorkerId;
use crate::ids::{NpcId, WorldId};
use serde::{Deserialize, Serialize};
use surefoot_planner::{Tags, Zone};
use surefoot_world::map::Piece;
use surefoot_world::{
    Action, Arrival, CharacterProfile, End, Gait, MapHash, MapSpec, MoverAt, ProfileIdx, Tick, Trajectory, Vec3,
};

/// How a world's time passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum TimeMode {
    /// 60 ticks a second.
    Realtime,
    /// As fast as answers arrive: the world waits for every answer.
    Lockstep,
}

/// A message to a worker.
#[derive(Debug, Clone, PartialEq)]
pub enum ToWorker {
    /// The first message: the worker's id.
    Welcome(WorkerId),
    /// NPCs that the worker no longer decides for.
    Release(WorldId, Vec<NpcId>),
    /// NPCs that the worker decides for from now on.
    Assignment(Assignment),
    /// Attempts that ended.
    Ended(WorldId, Vec<AttemptEnd>),
    /// Observations to answer.
    Observations(ObservationBatch),
    /// A world whose map was edited, and all of its pieces now.
    Edited(WorldId, Vec<Piece>),
    /// Changes of zones and tags.
    ZonesChanged {
        /// The world.
        world: WorldId,
        /// All of its zones now; `None` if they have not changed.
        zones: Option<Vec<Zone>>,
        /// NPCs with their new tags.
        tags: Vec<(NpcId, Tags)>,
    },
    /// A world that has ended: no more messages about it follow.
    Over(WorldId),
    /// The last message: why its stream ends.
    Goodbye(Goodbye),
}

/// NPCs of one world that are assigned to one worker.
#[derive(Debug, Clone, PartialEq)]
pub struct Assignment {
    /// The world of the NPCs.
    pub world: WorldId,
    /// Spec of the world's map; `None` for an imported map.
    pub spec: Option<MapSpec>,
    /// Content hash of the world's map without its pieces.
    pub map_hash: MapHash,
    /// Pieces on the map.
    pub pieces: Vec<Piece>,
    /// How the world's time passes.
    pub mode: TimeMode,
    /// Whether NPCs of the world collide with each other.
    pub solid_npcs: bool,
    /// Zones of the world.
    pub zones: Vec<Zone>,
    /// The assigned NPCs.
    pub npcs: Vec<NpcId>,
    /// Their tags.
    pub tags: Vec<(NpcId, Tags)>,
    /// Index of their body among those of the world, and the body.
    pub body: (ProfileIdx, CharacterProfile),
}

/// An attempt that ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AttemptEnd {
    /// NPC of the attempt.
    pub npc: NpcId,
    /// Number of the attempt among the NPC's attempts.
    pub attempt: u32,
    /// Outcome of the attempt.
    pub end: End,
}

/// Observations of NPCs of one world that are due for a decision.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservationBatch {
    /// The world of the NPCs.
    pub world: WorldId,
    /// Tick at which the observations were made.
    pub tick: Tick,
    /// The NPCs, in the order of all lists below.
    pub npcs: Vec<NpcId>,
    /// Number of values of an observation.
    pub observation_len: usize,
    /// The observation of each NPC; empty if the worker observes them itself.
    pub observations: Vec<f32>,
    /// Position of each NPC's feet, m.
    pub positions: Vec<Vec3>,
    /// Goal of each NPC, m.
    pub goals: Vec<Vec3>,
    /// Whether each NPC may arrive in flight.
    pub touches: Vec<bool>,
    /// How each NPC goes; empty if all go as fast as they can.
    pub gaits: Vec<Gait>,
    /// Number of each NPC's attempt.
    pub attempts: Vec<u32>,
    /// Whether each NPC has reached its waypoint.
    pub waypoint_reached: Vec<bool>,
    /// Whether each NPC stands on walkable ground.
    pub grounded: Vec<bool>,
    /// Complete state of each NPC, see [`Npc::to_bytes`](surefoot_world::Npc::to_bytes), with the profile index 0.
    pub states: Vec<Vec<u8>>,
    /// Index of their body among those of the world.
    pub body: ProfileIdx,
    /// State of each mover, see [`MoverState::pack`](surefoot_world::MoverState::pack); empty if there are none.
    pub movers: Vec<u8>,
}

impl ObservationBatch {
    /// An empty batch.
    pub fn new(world: WorldId, tick: Tick, body: ProfileIdx, observation_len: usize) -> Self {
        Self {
            body,
            world,
            tick,
            npcs: Vec::new(),
            observation_len,
            observations: Vec::new(),
            positions: Vec::new(),
            goals: Vec::new(),
            touches: Vec::new(),
            gaits: Vec::new(),
            attempts: Vec::new(),
            waypoint_reached: Vec::new(),
            grounded: Vec::new(),
            states: Vec::new(),
            movers: Vec::new(),
        }
    }
}

/// Why a worker's stream ends.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Goodbye {
    /// The server is shutting down.
    #[error("the service is shutting down: reconnect later")]
    ShuttingDown,
    /// Too many messages are waiting for the worker.
    #[error("messages were not read: reconnect")]
    NotReading,
    /// The worker sent something other than actions after its hello.
    #[error("only actions may be sent after hello")]
    Unexpected,
    /// An answer is invalid: the field and the reason.
    #[error("{1}")]
    BadAnswer(String, String),
}

/// The first message of a worker, checked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hello {
    /// Name for logs and metrics.
    pub name: String,
    /// Policy of the worker, for logs and metrics.
    pub policy: String,
    /// Most NPCs that the worker can decide for.
    pub capacity: u32,
    /// Whether its policy sees other NPCs and players.
    pub sees_others: bool,
}

impl Hello {
    /// The hello of a worker whose policy does not see others.
    pub fn new(name: &str, policy: &str, capacity: u32) -> Self {
        Self { name: name.to_owned(), policy: policy.to_owned(), capacity, sees_others: false }
    }
}

/// A worker's answer, checked.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Answer {
    /// Tick of the observations that this answers.
    pub tick: Tick,
    /// Decisions, each for another NPC.
    pub decisions: Vec<Decision>,
    /// New waypoints, m, what counts as having arrived there, and the attempts that they are for.
    pub waypoints: Vec<(NpcId, u32, (Vec3, Arrival))>,
    /// Attempts to give up, and their outcome: no progress, or an unreachable goal.
    pub gave_up: Vec<(NpcId, u32, End)>,
    /// New plans, with the attempts that they are for.
    pub plans: Vec<(NpcId, u32, NpcPlan)>,
    /// Plans that the planner failed to deliver since the worker's last answer.
    pub plans_failed: u32,
    /// Movers that NPCs call, and the stops to which they call them.
    pub mover_calls: Vec<MoverAt>,
    /// What is predicted of NPCs, and the attempts for which that holds.
    pub predictions: Vec<(NpcId, u32, Trajectory)>,
    /// Whether the worker observes the NPCs of the decisions itself from now on.
    pub observes: bool,
    /// Actions, waypoints, plans and predictions that were left out because a number was invalid.
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
    /// Why the NPC stands, if it does and its worker knows.
    pub standing: Option<Standing>,
}
