//! One attempt in our physics, with its track.

use super::run::{Approach, MAX_DECISIONS, SAMPLE_LEN};
use super::set::SetGoal;
use std::sync::Arc;
use surefoot_rollout::drive::{Driver, PathPoint};
use surefoot_rollout::motion::Sample;
use surefoot_rollout::{AttemptResult, Goal};
use surefoot_world::character::{ACTION_LEN, Action};
use surefoot_world::{AbilitySet, CharacterProfile, End, Map, NpcSlot, TICKS_PER_DECISION, TaskConfig, Vec3, World};

/// Ticks after which an attempt by path ends.
const MAX_TICKS: u32 = MAX_DECISIONS as u32 * TICKS_PER_DECISION;

/// Makes one attempt, and returns its track: the body at the start and after each decision. A path is driven; actions
/// are done again; a track is taken as it is; an entrant that says that the goal is out of reach is believed.
pub(super) fn attempt(
    map: &Arc<Map>,
    body: &CharacterProfile,
    goal: &SetGoal,
    approach: &Approach,
) -> (AttemptResult, Vec<Sample>) {
    match approach {
        Approach::Unreachable => Trial::new(map, body, goal).ended(End::Unreachable),
        Approach::Path(points) => Trial::new(map, body, goal).drive(points, body),
        Approach::Actions(actions) => Trial::new(map, body, goal).repeat(actions),
        Approach::Track(samples) => follow(samples, goal),
    }
}

/// The result of a track of another program, which has reached the goal where it comes within the radius of the task.
fn follow(samples: &[[f32; SAMPLE_LEN]], goal: &SetGoal) -> (AttemptResult, Vec<Sample>) {
    let goal = Vec3::from_array(goal.goal);
    let radius = TaskConfig::default().goal_radius;
    let all: Vec<Sample> = samples.iter().map(sample).collect();
    // Floors of a NavMesh are up to two voxels above the ground.
    let has_arrived = |it: &Sample| {
        let to = goal - it.feet;
        to.with_y(0.0).length() <= radius && to.y.abs() <= radius
    };
    let arrived = all.iter().position(has_arrived);
    let track = all[..arrived.map_or(all.len(), |idx| idx + 1)].to_vec();
    let length = track.windows(2).map(|pair| pair[0].feet.distance(pair[1].feet)).sum();
    let decisions = track.len().saturating_sub(1) as u32;
    let end = if arrived.is_some() { End::Reached } else { End::NoProgress };
    (AttemptResult::without_plans(end, decisions, length), track)
}

fn sample(&[x, y, z, yaw, velocity_x, velocity_y, velocity_z, in_air]: &[f32; SAMPLE_LEN]) -> Sample {
    let velocity = Vec3::new(velocity_x, velocity_y, velocity_z);
    Sample { feet: Vec3::new(x, y, z), yaw, velocity, in_air: in_air > 0.5, ..Sample::default() }
}

/// A world with one body that has one goal.
struct Trial {
    world: World,
    slot: NpcSlot,
    ticks: u32,
    length: f32,
    feet: Vec3,
    track: Vec<Sample>,
    /// Abilities that were used since the last decision ended.
    used: AbilitySet,
}

impl Trial {
    fn new(map: &Arc<Map>, body: &CharacterProfile, goal: &SetGoal) -> Self {
        // The run ends attempts itself.
        let task = TaskConfig { patience: u32::MAX, ..TaskConfig::default() };
        let mut world = World::new(map.clone(), body.clone(), task);
        let Goal { start, yaw, goal } = Goal::from(*goal);
        let slot = world.spawn(start, yaw);
        world.set_waypoint(slot, goal);
        let track = vec![Sample::of(world.npc(slot).expect("just spawned"))];
        Self { world, slot, ticks: 0, length: 0.0, feet: start, track, used: AbilitySet::default() }
    }

    fn repeat(mut self, actions: &[[f32; ACTION_LEN]]) -> (AttemptResult, Vec<Sample>) {
        for action in actions {
            self.world.decide(self.slot, Action::from_array(*action).unwrap_or_default());
            self.world.tick_decision();
            if let Some(end) = self.advance(TICKS_PER_DECISION) {
                return self.ended(end);
            }
        }
        self.ended(End::NoProgress)
    }

    fn drive(mut self, points: &[PathPoint], body: &CharacterProfile) -> (AttemptResult, Vec<Sample>) {
        let mut driver = Driver::new(points);
        while self.ticks < MAX_TICKS {
            let npc = self.world.npc(self.slot).expect("the only NPC");
            let Some(action) = driver.steer(&npc.body, body) else { break };
            self.world.decide(self.slot, action);
            self.world.tick();
            if let Some(end) = self.advance(1) {
                return self.ended(end);
            }
        }
        self.ended(End::NoProgress)
    }

    /// Accounts for `ticks` ticks that have run, and returns the end of the attempt, if it has ended.
    fn advance(&mut self, ticks: u32) -> Option<End> {
        let npc = self.world.npc(self.slot).expect("the only NPC");
        self.ticks += ticks;
        self.length += npc.body.feet.distance(self.feet);
        self.feet = npc.body.feet;
        self.used = self.used.union(npc.used_abilities);
        if self.ticks.is_multiple_of(TICKS_PER_DECISION) {
            self.track.push(Sample { used: std::mem::take(&mut self.used), ..Sample::of(npc) });
        }
        npc.episode.and_then(|episode| episode.end)
    }

    fn ended(self, end: End) -> (AttemptResult, Vec<Sample>) {
        let decisions = self.ticks.div_ceil(TICKS_PER_DECISION);
        (AttemptResult::without_plans(end, decisions, self.length), self.track)
    }
}
