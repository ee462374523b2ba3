//! The NPCs that a world's task decides for.

use std::collections::BTreeMap;
use surefoot_rollout::rehearse::NoiseStream;
use surefoot_rollout::{Attempt, Follower};
use surefoot_world::{Body, Trajectory, Vec3};

/// NPCs by id.
pub(super) type Npcs = BTreeMap<u64, Npc>;

/// An NPC in an attempt.
pub(super) struct Npc {
    /// Number of the attempt.
    pub number: u32,
    pub attempt: Attempt,
    pub noise: NoiseStream,
    /// The policy's memory row for the attempt.
    pub memory: Vec<f32>,
    pub planning: PlanState,
    pub hold: Hold,
    pub news: News,
    /// Position of the feet at the last decision, m.
    pub feet: Vec3,
}

/// Where an NPC's plan comes from, and whether it needs another one.
#[derive(Default)]
pub(super) struct PlanState {
    /// Whether a plan is requested and has not arrived.
    pub is_requested: bool,
    /// Revision of designers' edits with which the plan was made.
    pub revision: Option<u64>,
    /// The latest revision for which the NPC dropped its plan.
    pub replanned_for: Option<u64>,
    /// Whether the plan was made on the map before an edit, for other zones, for another gait, or for a goal that has
    /// moved far. The NPC follows it until it has another one.
    pub is_outdated: bool,
    /// Whether zones or tags that concern the NPC have changed since it last reviewed its plan.
    pub has_new_rules: bool,
}

/// Why an NPC stands still.
#[derive(Default)]
pub(super) struct Hold {
    /// Whether it stands still in this decision.
    pub holds: bool,
    /// Decisions for which it has waited for its turn to rehearse.
    pub turn_waited: u32,
    /// Decisions without a plan.
    pub unplanned: u32,
    /// Decision without a plan at which it rehearses the straight way to its goal.
    pub next_try: u32,
}

/// What the server does not know yet.
#[derive(Default)]
pub(super) struct News {
    /// A new waypoint, m.
    pub waypoint: Option<Vec3>,
    /// Whether the NPC has a new plan.
    pub has_plan: bool,
}

impl Npc {
    /// Begins attempt `number` of an NPC.
    pub fn begin(number: u32, follower: Follower, memory_len: usize, noise: NoiseStream) -> Self {
        Self {
            number,
            attempt: Attempt::new(follower),
            noise,
            memory: vec![0.0; memory_len],
            planning: PlanState::default(),
            hold: Hold::default(),
            news: News::default(),
            feet: Vec3::ZERO,
        }
    }

    /// Follows a goal that may have moved, m: the NPC heads for its new place if it is on the last leg, and needs
    /// another plan once the goal has moved far.
    pub fn follow_goal(&mut self, goal: Vec3, has_arrived: bool) {
        let follower = &self.attempt.follower;
        if follower.waypoint().is_none() && follower.goal() != goal {
            // The straight way to it was not rehearsed.
            self.hold.next_try = 0;
        }
        if let Some(waypoint) = self.attempt.follow_goal(goal, self.feet, has_arrived) {
            self.news.waypoint = Some(waypoint);
        }
        self.planning.is_outdated |= self.attempt.follower.has_goal_drifted(self.feet);
    }

    /// What the NPC with this `body` will do in the next second, as far as it is known.
    pub fn trajectory(&self, body: &Body) -> Trajectory {
        if !self.hold.holds {
            return self.attempt.trajectory(body);
        }
        // An NPC that waits for something else may go on with its next decision.
        let stays = self.attempt.follower.is_barred() && body.is_at_rest();
        if stays { Trajectory::at_rest(body) } else { Trajectory::default() }
    }

    /// Whether the NPC has a waypoint to rehearse and act for.
    pub fn has_waypoint(&self) -> bool {
        self.attempt.follower.waypoint().is_some()
    }
}
