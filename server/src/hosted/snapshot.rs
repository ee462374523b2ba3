//! What clients see of a hosted world: plain data, copied out of its thread.

use crate::ids::NpcId;
use crate::ids::WorkerId;
use crate::times::TickTimes;
use serde::{Deserialize, Serialize};
use std::time::SystemTime;
use surefoot_world::{Ability, Chance, End, Seconds, Tick, Vec3};

/// What an NPC is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NpcStatus {
    /// Without a goal.
    Idle,
    /// On its way.
    Seeking,
    /// Fell, burnt or drowned.
    Down,
}

/// What supports an NPC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Support {
    /// Nothing.
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

/// One NPC at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NpcState {
    /// Its id.
    pub id: NpcId,
    /// Where its feet are, m.
    pub position: Vec3,
    /// Velocity, m/s.
    pub velocity: Vec3,
    /// Heading, rad.
    pub yaw: f32,
    /// What it is doing.
    pub status: NpcStatus,
    /// Where it was sent, m.
    pub goal: Option<Vec3>,
    /// Where it heads right now, m.
    pub waypoint: Option<Vec3>,
    /// How its last attempt that ended did.
    pub last_outcome: Option<End>,
    /// Attempts that began.
    pub attempts_begun: u32,
    /// Attempts that ended with an outcome.
    pub attempts_ended: u32,
    /// The worker that carries it.
    pub worker: Option<WorkerId>,
    /// What supports it.
    pub support: Support,
    /// What it has used since its last decision.
    pub ability: Ability,
    /// The harm that it came to.
    pub cause: Option<End>,
}

/// All NPCs of a world at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// When, in the world's time.
    pub tick: Tick,
    /// When, by the server's clock.
    pub time: SystemTime,
    /// By id.
    pub npcs: Vec<NpcState>,
}

impl Default for Snapshot {
    fn default() -> Self {
        Self { tick: Tick(0), time: SystemTime::UNIX_EPOCH, npcs: Vec::new() }
    }
}

/// Figures of a world.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WorldStats {
    /// Counters since it began.
    pub counters: Counters,
    /// From when ticks were due until they were done.
    pub times: TickTimes,
    /// NPCs that no worker carries.
    pub without_worker: u32,
}

/// Counters since the world began.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Decisions asked for.
    pub asked: u64,
    /// Answered within their period.
    pub answered: u64,
    /// Not answered within it.
    pub missed: u64,
    /// Answers that nobody waited for any more.
    pub stale: u64,
    /// Actions, waypoints and plans that were ignored because a number made no sense.
    pub invalid: u64,
    /// Plans that planners failed to deliver to workers.
    pub plans_failed: u64,
    /// Ticks left out because the world was too far behind.
    pub ticks_dropped: u64,
    /// Ticks that were done later than a period after they were due.
    pub ticks_late: u64,
    /// Attempts by how they ended, in the order of [`End::ALL`].
    pub ends: [u64; End::ALL.len()],
}

/// NPCs of a world by what they do.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    /// Without a goal.
    pub idle: u32,
    /// On their way.
    pub seeking: u32,
    /// Fell, burnt or drowned.
    pub down: u32,
    /// Whatever they do: not carried by a worker.
    pub without_worker: u32,
}

/// An attempt that ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndedAttempt {
    /// Its number among the NPC's attempts.
    pub attempt: u32,
    /// How it ended.
    pub end: End,
    /// Where it led, m.
    pub goal: Option<Vec3>,
    /// How long it took.
    pub seconds: Seconds,
}

/// The plan that an NPC follows, as its worker reported it; as many legs as waypoints.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NpcPlan {
    /// Where each leg ends, m.
    pub waypoints: Vec<Vec3>,
    /// What each leg takes.
    pub legs: Vec<PlanLeg>,
    /// Why the plan only heads for the goal; empty for a real path.
    pub no_path: String,
}

/// One leg of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanLeg {
    /// The most demanding ability it needs.
    pub ability: Ability,
    /// Expected duration.
    pub seconds: Seconds,
    /// Chance of success.
    pub chance: Chance,
}
