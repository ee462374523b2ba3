//! What an NPC goes to, as data.

use crate::ids::NpcId;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use surefoot_world::arrival::{KEEP_SLACK_M, SNAP_M};
use surefoot_world::formation::{Formation, Shape};
use surefoot_world::{Arrival, PlayerSlot, TICKS_PER_SECOND, Tick, Vec3};

/// What a goal follows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Target {
    /// An NPC of the same world.
    Npc(NpcId),
    /// A player of the same world.
    Player(PlayerSlot),
    /// A place that moves from where a client put it.
    Moving {
        /// The place at that time, m.
        from: Vec3,
        /// Its velocity, m/s.
        velocity: Vec3,
        /// When the client put it there.
        since: Tick,
    },
    /// A place in a group of the same world.
    Rank(Rank),
}

impl Target {
    /// A place that does not move, m.
    pub fn at(place: Vec3) -> Self {
        Self::Moving { from: place, velocity: Vec3::ZERO, since: Tick(0) }
    }

    /// Whether the content is valid, which the checksum of a save does not prove.
    pub(super) fn is_sound(&self) -> bool {
        match self {
            Self::Moving { from, velocity, .. } => from.is_finite() && velocity.is_finite(),
            Self::Rank(rank) => rank.spacing.is_finite() && rank.spacing > 0.0,
            Self::Npc(_) | Self::Player(_) => true,
        }
    }
}

/// The place of a follower in a group.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Rank {
    /// Who leads the group.
    pub leader: NpcId,
    /// The follower's number: those with lower ones are nearer to the leader.
    pub number: u32,
    /// How the group stands.
    pub shape: Shape,
    /// Distance between neighbours, m.
    pub spacing: f32,
}

/// What keeps an NPC from its target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NoWay {
    /// The graph has no path.
    NoPath,
    /// The graph has paths, but the NPC has failed on them.
    Failed,
}

/// A group under way.
#[derive(Debug)]
pub(super) struct Group {
    pub formation: Formation,
    /// Where each follower should be, m.
    pub places: BTreeMap<NpcId, Vec3>,
}

/// Longest time for which a place moves without news from its client.
const MOVES_TICKS: u64 = TICKS_PER_SECOND as u64;

/// Where a place is at `tick` that was at `from`, m, at `since`, and moves with `velocity`, m/s.
pub(super) fn moved(from: Vec3, velocity: Vec3, since: Tick, tick: Tick) -> Vec3 {
    from + velocity * (tick.since(since).min(MOVES_TICKS) as f32 / TICKS_PER_SECOND as f32)
}

/// How an NPC goes to its goal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pursuit {
    /// What the goal follows; `None` if it stays where clients put it.
    pub target: Option<Target>,
    /// Distance within which the NPC arrives, m.
    pub radius: f32,
    /// Whether the attempt goes on after the NPC has arrived.
    pub keeps: bool,
    /// How much farther than its radius the goal gets from an NPC that keeps to it, until the NPC follows again, m.
    pub slack: f32,
    /// Distance by which the goal may be moved to a place to stand, m.
    pub snap: f32,
    /// Heading to which the NPC turns after it has arrived, rad.
    pub facing: Option<f32>,
    /// What counts as having arrived.
    pub arrival: Arrival,
    /// Whether the NPC must have come to rest when the attempt ends as reached.
    pub stops: bool,
    /// Whether the attempt is of the NPC's route, rather than for a client.
    pub is_of_route: bool,
}

impl Default for Pursuit {
    fn default() -> Self {
        Self {
            target: None,
            radius: 1.0,
            keeps: false,
            slack: KEEP_SLACK_M,
            snap: SNAP_M,
            facing: None,
            arrival: Arrival::Stand,
            stops: false,
            is_of_route: false,
        }
    }
}

impl Pursuit {
    /// The body that the goal follows; `None` for places.
    pub fn body(&self) -> Option<Target> {
        self.target.filter(|target| !matches!(target, Target::Moving { .. }))
    }

    /// The place in a group, of a follower.
    pub fn rank(&self) -> Option<Rank> {
        match self.target {
            Some(Target::Rank(rank)) => Some(rank),
            _ => None,
        }
    }

    /// Lets a follower have another leader.
    pub(super) fn lead_by(&mut self, leader: NpcId) {
        if let Some(Target::Rank(rank)) = &mut self.target {
            rank.leader = leader;
        }
    }

    /// Whether the content is valid, which the checksum of a save does not prove.
    pub(super) fn is_sound(&self) -> bool {
        self.target.is_none_or(|target| target.is_sound()) && self.facing.is_none_or(f32::is_finite)
    }
}

/// A goal that a client sets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoalOrder {
    /// The goal, m; `None`: where the target is.
    pub goal: Option<Vec3>,
    /// How the NPC goes there.
    pub pursuit: Pursuit,
}

impl From<Vec3> for GoalOrder {
    fn from(goal: Vec3) -> Self {
        Self { goal: Some(goal), pursuit: Pursuit::default() }
    }
}

/// A goal that was set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoalSet {
    /// Number of the attempt that begins, or of the attempt under way if its goal merely moves.
    pub attempt: u32,
    /// The place to stand that the NPC goes to, m.
    pub goal: Vec3,
    /// Its distance from the goal that was asked for, m.
    pub moved_by_m: f32,
}

/// A goal to which an NPC that keeps to its target returns.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Retry {
    /// Where the goal is, m.
    pub goal: Vec3,
    pub pursuit: Pursuit,
    /// When the next attempt begins.
    pub at: Tick,
}
