//! Data of a hosted world for clients, copied from the world's thread.

use super::itinerary::RouteKind;
use super::pursuit::Target;
use crate::ids::NpcId;
use crate::ids::WorkerId;
use crate::times::TickTimes;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::SystemTime;
use surefoot_world::map::MoverStop;
use surefoot_world::{
    Ability, Chance, End, Gait, Locomotion, MoverState, Player, PlayerSlot, ProfileIdx, Seconds, Tick, Trajectory, Vec3,
};

/// Status of an NPC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NpcStatus {
    /// The NPC has no goal.
    Idle,
    /// The NPC is on its way to its goal.
    Seeking,
    /// The NPC fell, burnt or drowned.
    Down,
}

/// What supports an NPC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Support {
    /// Nothing: the NPC is in the air.
    Air,
    /// Ground that can be walked on.
    Ground,
    /// A face that is too steep to stand on.
    Steep,
    /// The bottom of a pool.
    Water,
    /// A zip line.
    ZipLine,
}

/// Why an NPC with a goal or a route stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Standing {
    /// No worker decides for it.
    NoWorker,
    /// Its worker does not answer.
    SilentWorker,
    /// Its worker loads the map.
    AwaitsMap,
    /// The planner builds the graph.
    AwaitsGraph,
    /// It has no plan yet.
    AwaitsPlan,
    /// It waits for its turn to rehearse.
    AwaitsRehearsal,
    /// It waits for a mover, or rides on one.
    AwaitsMover,
    /// Movers bar all ways.
    Barred,
    /// It tries to move, but does not get away.
    Blocked,
    /// It keeps to its goal and is there.
    AtTarget,
    /// Its route is to hold a place, and it is there.
    Holds,
    /// It rests on its route, or until it tries again.
    Rests,
    /// It wanders, and no place was found in its area.
    NoPlace,
    /// It leads a group, and waits for its followers.
    AwaitsGroup,
}

impl Standing {
    /// All reasons, in the order of their declaration.
    pub const ALL: [Self; 14] = [
        Self::NoWorker,
        Self::SilentWorker,
        Self::AwaitsMap,
        Self::AwaitsGraph,
        Self::AwaitsPlan,
        Self::AwaitsRehearsal,
        Self::AwaitsMover,
        Self::Barred,
        Self::Blocked,
        Self::AtTarget,
        Self::Holds,
        Self::Rests,
        Self::NoPlace,
        Self::AwaitsGroup,
    ];

    /// Lower-case name as used in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::NoWorker => "no_worker",
            Self::SilentWorker => "silent_worker",
            Self::AwaitsMap => "awaits_map",
            Self::AwaitsGraph => "awaits_graph",
            Self::AwaitsPlan => "awaits_plan",
            Self::AwaitsRehearsal => "awaits_rehearsal",
            Self::AwaitsMover => "awaits_mover",
            Self::Barred => "barred",
            Self::Blocked => "blocked",
            Self::AtTarget => "at_target",
            Self::Holds => "holds",
            Self::Rests => "rests",
            Self::NoPlace => "no_place",
            Self::AwaitsGroup => "awaits_group",
        }
    }
}

/// One NPC at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NpcState {
    /// Id of the NPC.
    pub id: NpcId,
    /// Position of the feet, m.
    pub position: Vec3,
    /// Velocity, m/s.
    pub velocity: Vec3,
    /// Heading, rad.
    pub yaw: f32,
    /// Status of the NPC.
    pub status: NpcStatus,
    /// Goal of the current attempt, m.
    pub goal: Option<Vec3>,
    /// Waypoint that the NPC heads for, m.
    pub waypoint: Option<Vec3>,
    /// Outcome of the last attempt that ended.
    pub last_outcome: Option<End>,
    /// Attempts that began.
    pub attempts_begun: u32,
    /// Attempts that ended with an outcome.
    pub attempts_ended: u32,
    /// The worker that decides for the NPC.
    pub worker: Option<WorkerId>,
    /// What supports the NPC.
    pub support: Support,
    /// Ability that the NPC has used since its last decision.
    pub ability: Ability,
    /// How the NPC died, if it is down.
    pub cause: Option<End>,
    /// Index of its body among those of the world.
    pub body: ProfileIdx,
    /// Why the NPC stands while it is seeking, or rests on its route.
    pub standing: Option<Standing>,
    /// Kind of its route.
    pub route: Option<RouteKind>,
    /// Of a patrol: index of the stop to which it goes, or goes after its rest.
    pub route_stop: u32,
    /// How it goes where it can walk.
    pub gait: Gait,
    /// What it looks at while it rests.
    pub looks_at: Option<Target>,
    /// How it moves; `None` where that is left out.
    pub movement: Option<Movement>,
}

impl NpcState {
    /// The same state for readers that do not animate the NPC.
    #[must_use]
    pub fn without_movement(self) -> Self {
        Self { movement: None, ..self }
    }
}

/// How an NPC moves, for animation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Movement {
    /// Its pace, its stride, and the phase of its leap.
    pub locomotion: Locomotion,
    /// What it will do in the second that begins at the tick, if that is known.
    pub prediction: Option<(Tick, Trajectory)>,
}

/// All NPCs of a world at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// Tick of the snapshot.
    pub tick: Tick,
    /// Time of the server's clock at the snapshot.
    pub time: SystemTime,
    /// The NPCs, ordered by id.
    pub npcs: Vec<NpcState>,
    /// State and pose of each mover of the map.
    pub movers: Vec<(MoverState, MoverStop)>,
    /// The players.
    pub players: Vec<(PlayerSlot, Player)>,
    /// Revision of the map.
    pub map_revision: u64,
}

impl Default for Snapshot {
    fn default() -> Self {
        Self {
            tick: Tick(0),
            time: SystemTime::UNIX_EPOCH,
            npcs: Vec::new(),
            movers: Vec::new(),
            players: Vec::new(),
            map_revision: 0,
        }
    }
}

/// An NPC or a player.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum BodyId {
    /// An NPC.
    Npc(NpcId),
    /// A player.
    Player(PlayerSlot),
}

/// Where one body is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyPose {
    /// The body.
    pub id: BodyId,
    /// Position of the feet, m.
    pub feet: Vec3,
    /// Heading, rad; 0 for players.
    pub yaw: f32,
}

/// Where all bodies of a world are at one tick: the part of a snapshot for readers that need every tick.
#[derive(Debug, Clone, PartialEq)]
pub struct Poses {
    /// Tick of the poses.
    pub tick: Tick,
    /// NPCs by id, then players.
    pub bodies: Vec<BodyPose>,
}

/// Statistics of a world.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WorldStats {
    /// Counters since the world began.
    pub counters: Counters,
    /// Times from when ticks were due until they were done.
    pub times: TickTimes,
    /// NPCs without a worker.
    pub without_worker: u32,
}

/// Counters since the world began.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Decisions requested from workers.
    pub asked: u64,
    /// Decisions answered within their period.
    pub answered: u64,
    /// Decisions not answered within their period.
    pub missed: u64,
    /// Answers to decisions that were no longer pending.
    pub stale: u64,
    /// Actions, waypoints, plans and predictions that were ignored because a number was invalid.
    pub invalid: u64,
    /// Plans that planners failed to deliver to workers.
    pub plans_failed: u64,
    /// Ticks left out because the world was too far behind.
    pub ticks_dropped: u64,
    /// Ticks that were done later than a period after they were due.
    pub ticks_late: u64,
    /// Attempts by outcome, in the order of [`End::ALL`].
    pub ends: [u64; End::ALL.len()],
}

/// Number of NPCs by status.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    /// NPCs without a goal.
    pub idle: u32,
    /// NPCs on their way to a goal.
    pub seeking: u32,
    /// NPCs that fell, burnt or drowned.
    pub down: u32,
    /// NPCs without a worker, of any status.
    pub without_worker: u32,
    /// NPCs that stand, by reason, in the order of [`Standing::ALL`].
    pub standing: [u32; Standing::ALL.len()],
}

/// An attempt that ended.
#[derive(Debug, Clone, PartialEq)]
pub struct EndedAttempt {
    /// Number among the NPC's attempts.
    pub attempt: u32,
    /// Outcome of the attempt.
    pub end: End,
    /// Goal of the attempt, m.
    pub goal: Option<Vec3>,
    /// Distance of the feet from the goal, m.
    pub distance_m: f32,
    /// Duration of the attempt.
    pub seconds: Seconds,
    /// Why the goal is unreachable, for people; empty for other outcomes.
    pub no_path: Arc<str>,
}

/// The plan that an NPC follows, as its worker reported it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NpcPlan {
    /// End of each leg, m.
    pub waypoints: Vec<Vec3>,
    /// The legs, one for each waypoint.
    pub legs: Vec<PlanLeg>,
    /// Why no path was found and the NPC heads straight for its goal; empty if a path was found.
    pub no_path: String,
}

/// One leg of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanLeg {
    /// The most demanding ability that the leg needs.
    pub ability: Ability,
    /// Expected duration.
    pub seconds: Seconds,
    /// Estimated chance of success.
    pub chance: Chance,
}
