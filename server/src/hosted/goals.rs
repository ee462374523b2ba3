//! The goals of NPCs: places and targets that move, when an NPC has arrived there, and its place among others.

use super::commands::NpcError;
use super::events::EventKind;
use super::gathering::{NEAR_M, PLACE_RADIUS_M, Reserved, touch};
use super::pursuit::{GoalOrder, GoalSet, NoWay, Pursuit, Retry, Target, moved};
use super::world::{HostedWorld, NpcRecord};
use crate::ids::NpcId;
use std::sync::Arc;
use surefoot_world::arrival::{NoFooting, RETRY_TICKS, SNAP_M};
use surefoot_world::{Action, Arrival, End, TICKS_PER_DECISION, Vec3};

/// Distance between two goals of an NPC up to which they are one target that moves: in metres, and as a share of the
/// NPC's distance from the first. A plan to a goal that is farther away is of more use elsewhere too.
const SAME_TARGET_M: f32 = 4.0;
const SAME_TARGET_SHARE: f32 = 0.25;
/// Speed up to which a body is at rest, m/s.
const REST_SPEED: f32 = 0.3;
/// Distance that a target moves before the goal follows it, m.
const TARGET_STEP_M: f32 = 0.1;

impl HostedWorld {
    /// Sends an NPC to a goal, or to the nearest place where it can stand.
    pub fn set_goal(&mut self, id: NpcId, order: impl Into<GoalOrder>) -> Result<GoalSet, NpcError> {
        let GoalOrder { goal, pursuit } = order.into();
        let record = self.records.get(&id).ok_or(NpcError::Unknown(id))?;
        if self.world.npc(record.slot).is_some_and(|npc| npc.harm.is_some()) {
            return Err(NpcError::Down(id));
        }
        let slot = record.slot;
        let asked = match (pursuit.target, goal) {
            (Some(target), _) => self.place_of(id, target)?,
            (None, goal) => goal.unwrap_or_default(),
        };
        self.check_inside(asked, "goal")?;
        let goal = match self.world.footing(slot, asked, pursuit.snap) {
            _ if pursuit.arrival == Arrival::Pass => asked,
            Ok(goal) => goal,
            // A body in the air comes down again.
            Err(_) if pursuit.target.is_some() => asked,
            Err(why) => return Err(NpcError::NoFooting(why, pursuit.snap)),
        };
        let attempt = self.continue_attempt(id, goal, pursuit).unwrap_or_else(|| {
            self.log_replaced_attempt(id);
            self.records.get_mut(&id).expect("an NPC that exists").no_way = None;
            self.begin_attempt(id, goal, pursuit)
        });
        Ok(GoalSet { attempt, goal, moved_by_m: goal.distance(asked) })
    }

    /// Moves the goal of the attempt under way, m, as a target that moves on with `velocity`, m/s.
    pub fn move_target(&mut self, id: NpcId, goal: Vec3, velocity: Vec3) -> Result<(), NpcError> {
        self.check_inside(goal, "position")?;
        let moving = Target::Moving { from: goal, velocity, since: self.tick() };
        let record = self.records.get(&id).ok_or(NpcError::Unknown(id))?;
        let no_footing = NpcError::NoFooting(NoFooting::InAir, SNAP_M);
        let goal = self.place_below(record, goal).ok_or(no_footing)?;
        let record = self.records.get_mut(&id).ok_or(NpcError::Unknown(id))?;
        if let Some(retry) = record.retry.as_mut().filter(|retry| !retry.pursuit.is_of_route) {
            retry.goal = goal;
            return Ok(());
        }
        if record.goal.is_none() || record.pursuit.is_of_route {
            return Err(NpcError::NoGoal(id));
        }
        record.pursuit.target = (velocity != Vec3::ZERO).then_some(moving);
        self.move_goal(id, goal);
        Ok(())
    }

    /// Ends the attempt under way and the route, if there are any; the NPC comes to rest.
    pub fn clear_goal(&mut self, id: NpcId) -> Result<(), NpcError> {
        self.set_route(id, None)?;
        self.drop_goal(id)
    }

    /// Ends the attempt under way, if there is one; the NPC comes to rest.
    pub(super) fn drop_goal(&mut self, id: NpcId) -> Result<(), NpcError> {
        self.log_replaced_attempt(id);
        let record = self.records.get_mut(&id).ok_or(NpcError::Unknown(id))?;
        record.clear_goal();
        self.world.clear_waypoint(record.slot);
        self.gatherings.release(id);
        self.disband(id)
    }

    /// Where the target of an NPC is, m.
    pub(super) fn place_of(&self, id: NpcId, target: Target) -> Result<Vec3, NpcError> {
        match target {
            Target::Npc(other) if other == id => Err(NpcError::OwnTarget(id)),
            Target::Npc(other) => {
                let slot = self.records.get(&other).ok_or(NpcError::Unknown(other))?.slot;
                let npc = self.world.npc(slot).filter(|npc| npc.harm.is_none());
                npc.map(|npc| npc.body.feet).ok_or(NpcError::Down(other))
            }
            Target::Player(slot) => {
                let player = self.world.player(slot).ok_or(NpcError::NoPlayer(self.id, slot.0))?;
                Ok(player.feet)
            }
            Target::Moving { from, velocity, since } => Ok(moved(from, velocity, since, self.tick())),
            Target::Rank(rank) => self.place_in_group(id, rank),
        }
    }

    /// Begins an attempt and returns its number.
    pub(super) fn begin_attempt(&mut self, id: NpcId, goal: Vec3, pursuit: Pursuit) -> u32 {
        let tick = self.tick();
        self.gatherings.release(id);
        let record = self.records.get_mut(&id).expect("an NPC that exists");
        record.stop_turning(&mut self.world);
        record.clear_goal();
        (record.goal, record.pursuit) = (Some(goal), pursuit);
        record.attempts += 1;
        record.began = tick;
        let attempt = record.attempts;
        self.world.head_for(record.slot, goal, pursuit.arrival);
        self.log_event(id, EventKind::AttemptBegan { attempt, goal, pursuit });
        attempt
    }

    /// Lets the attempt under way go on to `goal`, m, if it has the same target or the goal is near the present one.
    /// The NPC keeps its plan, so that clients may follow a moving target with one call in each of their frames.
    fn continue_attempt(&mut self, id: NpcId, goal: Vec3, pursuit: Pursuit) -> Option<u32> {
        let record = self.records.get_mut(&id)?;
        let is_same = |former: &Pursuit| {
            !former.is_of_route && former.body() == pursuit.body() && former.arrival == pursuit.arrival
        };
        if let Some(retry) = record.retry.as_mut().filter(|retry| pursuit.keeps && is_same(&retry.pursuit)) {
            (retry.goal, retry.pursuit) = (goal, pursuit);
            return Some(record.attempts);
        }
        let former = record.goal?;
        let feet = self.world.npc(record.slot)?.body.feet;
        let is_near = former.distance(goal) <= SAME_TARGET_M.max(SAME_TARGET_SHARE * feet.distance(former));
        if !(is_same(&record.pursuit) && (pursuit.target.is_some() || is_near)) {
            return None;
        }
        record.pursuit = pursuit;
        if record.is_at_target {
            record.stop_turning(&mut self.world);
            record.turns_to = pursuit.facing;
        }
        let attempt = record.attempts;
        self.move_goal(id, goal);
        Some(attempt)
    }

    /// Moves the goal of the attempt under way, m.
    pub(super) fn move_goal(&mut self, id: NpcId, goal: Vec3) {
        let Some(record) = self.records.get_mut(&id) else { return };
        if record.goal.replace(goal) == Some(goal) {
            return;
        }
        if record.reserved.take().is_some() {
            self.gatherings.release(id);
        }
        if record.waypoint.is_none() {
            self.world.head_for(record.slot, goal, record.pursuit.arrival);
        }
    }

    /// Lets goals follow their targets, and NPCs that keep to their targets try again.
    pub(super) fn follow_targets(&mut self) {
        let tick = self.tick();
        let moving = self.records.iter().filter_map(|(&id, record)| {
            let target = record.pursuit.target.filter(|_| record.goal.is_some())?;
            Some((id, self.place_of(id, target).ok()))
        });
        for (id, place) in moving.collect::<Vec<_>>() {
            match place {
                Some(place) => self.follow_to(id, place),
                None => self.lose_target(id),
            }
        }
        let due = self.records.iter().filter_map(|(&id, record)| Some((id, record.retry?)));
        for (id, retry) in due.filter(|(_, retry)| retry.at <= tick).collect::<Vec<_>>() {
            let place = retry.pursuit.target.and_then(|target| self.place_of(id, target).ok());
            let target = retry.pursuit.target.filter(|_| place.is_some());
            self.begin_attempt(id, place.unwrap_or(retry.goal), Pursuit { target, ..retry.pursuit });
        }
    }

    /// Moves the goal of an NPC to the place to stand at its target, m; while the target is in the air, it stays.
    fn follow_to(&mut self, id: NpcId, place: Vec3) {
        let Some(record) = self.records.get(&id) else { return };
        if record.goal.is_none_or(|goal| goal.distance(place) > TARGET_STEP_M)
            && let Some(goal) = self.place_below(record, place)
        {
            self.move_goal(id, goal);
        }
    }

    /// The place to stand right below `place`, m, or `place` itself if a touch is enough.
    fn place_below(&self, record: &NpcRecord, place: Vec3) -> Option<Vec3> {
        match record.pursuit.arrival {
            Arrival::Pass => Some(place),
            _ => self.world.footing_below(record.slot, place),
        }
    }

    /// The target of an NPC is gone or down: its goal stays where the target was last.
    fn lose_target(&mut self, id: NpcId) {
        let Some(record) = self.records.get_mut(&id) else { return };
        if record.pursuit.rank().is_some() {
            record.pursuit.keeps = false;
        }
        record.pursuit.target = None;
        let attempt = record.attempts;
        self.log_event(id, EventKind::TargetLost { attempt });
    }

    /// Takes note of the path in the latest plan of an NPC: without one it takes no place at the goal from others.
    pub(super) fn note_path(&mut self, id: NpcId) {
        let Some(record) = self.records.get_mut(&id) else { return };
        if !record.has_no_path() {
            if record.no_way == Some(NoWay::NoPath) {
                self.tell_way(id);
            }
            return;
        }
        let no_path = record.why_unreachable(End::Unreachable);
        if record.reserved.take_if(|reserved| Some(reserved.at) == record.goal).is_some() {
            self.gatherings.release(id);
        }
        self.tell_no_way(id, NoWay::NoPath, no_path);
    }

    /// Tells clients, once, that an NPC which keeps to its target has no way to it.
    pub(super) fn tell_no_way(&mut self, id: NpcId, why: NoWay, no_path: Arc<str>) {
        let Some(record) = self.records.get_mut(&id) else { return };
        if record.pursuit.keeps && record.pursuit.rank().is_none() && record.no_way.is_none() {
            record.no_way = Some(why);
            let attempt = record.attempts;
            self.log_event(id, EventKind::TargetUnreachable { attempt, no_path });
        }
    }

    /// Tells clients that an NPC has a way to its target again, if they heard that it had none.
    fn tell_way(&mut self, id: NpcId) {
        let Some(record) = self.records.get_mut(&id) else { return };
        if record.no_way.take().is_some() {
            let attempt = record.attempts;
            self.log_event(id, EventKind::TargetReachable { attempt });
        }
    }

    /// Lets an NPC that keeps to its target try again later, after an attempt that did not reach it.
    pub(super) fn retry_later(&mut self, id: NpcId, goal: Vec3, pursuit: Pursuit) {
        let at = self.tick() + RETRY_TICKS;
        if let Some(record) = self.records.get_mut(&id) {
            record.retry = Some(Retry { goal, pursuit, at });
        }
    }

    /// How the attempt of an NPC ends if it has arrived: at its place at the goal, if it shares the goal with others.
    pub(super) fn arrival_of(&self, record: &NpcRecord) -> Option<End> {
        let goal = record.goal?;
        let is_within = |place, radius| self.world.has_arrived(record.slot, place, radius, record.pursuit.arrival);
        let is_at_goal = is_within(goal, record.pursuit.radius);
        let Some(reserved) = record.reserved.filter(|reserved| reserved.at != goal) else {
            return is_at_goal.then_some(End::Reached);
        };
        let end = if is_at_goal { End::Reached } else { End::ReachedNear };
        is_within(reserved.at, PLACE_RADIUS_M).then_some(end)
    }

    /// Gives NPCs that come near a goal which others share a place there. Where others block an NPC for a while, it
    /// stays beside them: returns these NPCs.
    pub(super) fn gather(&mut self) -> Vec<NpcId> {
        let tick = self.tick();
        let mut blocked = Vec::new();
        if !self.has_solid_npcs() {
            return blocked;
        }
        let Self { records, world, gatherings, .. } = self;
        for (&id, record) in records.iter_mut() {
            let is_due = (tick + u64::from(record.slot.0)).0.is_multiple_of(u64::from(TICKS_PER_DECISION));
            let shares = is_due && !record.pursuit.keeps && (record.reserved.is_some() || !record.has_no_path());
            let Some(goal) = record.goal.filter(|_| shares) else { continue };
            let body = world.npc(record.slot).expect("every record has an NPC").body;
            if !body.is_grounded() || body.feet.distance(goal) > NEAR_M && record.reserved.is_none() {
                continue;
            }
            let place = record.reserved.get_or_insert_with(|| gatherings.reserve(world, (id, record.slot), goal));
            if place.is_blocked(body.feet, tick) {
                blocked.push(id);
            }
        }
        blocked.retain(|&id| self.is_beside_others(id));
        blocked
    }

    /// Lets an NPC that has arrived keep its place, the reserved one or where it stands, and turn to its heading, rad.
    pub(super) fn stay_at(&mut self, id: NpcId, goal: Vec3, (reserved, facing): (Option<Reserved>, Option<f32>)) {
        let Some(record) = self.records.get_mut(&id) else { return };
        (record.turns_to, record.pursuit.facing) = (facing, facing);
        let feet = self.world.npc(record.slot).expect("every record has an NPC").body.feet;
        if reserved.is_some_and(|reserved| reserved.at.distance(feet) > PLACE_RADIUS_M) {
            self.gatherings.keep(id, goal, feet);
        }
    }

    /// Whether an NPC touches one that has arrived at the same goal.
    fn is_beside_others(&self, id: NpcId) -> bool {
        let record = &self.records[&id];
        let Some(goal) = record.goal else { return false };
        let others = self.gatherings.npcs_at(goal).filter(|other| *other != id).filter_map(|it| self.records.get(&it));
        others.filter(|other| other.goal.is_none()).any(|other| touch(&self.world, record.slot, other.slot))
    }

    /// Whether an NPC may end its attempt as it is: it need not stop, or has come to rest.
    pub(super) fn has_stopped(&self, record: &NpcRecord) -> bool {
        let npc = self.world.npc(record.slot).expect("every record has an NPC");
        !record.pursuit.stops || npc.body.velocity.length() <= REST_SPEED
    }

    /// Lets an NPC that must stop at its goal come to rest while it `is_there`. Returns whether it has just come there.
    pub(super) fn brake(&mut self, id: NpcId, is_there: bool) -> bool {
        let Some(record) = self.records.get_mut(&id) else { return false };
        let was_there = std::mem::replace(&mut record.is_at_target, is_there);
        if is_there && !was_there {
            (record.awaiting, record.prediction) = (None, None);
            self.world.decide(record.slot, Action::default());
        }
        is_there && !was_there
    }

    /// Lets an NPC that keeps to its goal stand while it is there.
    pub(super) fn keep_still(&mut self, id: NpcId) {
        let Some(record) = self.records.get_mut(&id) else { return };
        let (Some(goal), Pursuit { radius, facing, .. }) = (record.goal, record.pursuit) else { return };
        let slack = if record.is_at_target { record.pursuit.slack } else { 0.0 };
        let is_there = self.world.has_arrived(record.slot, goal, radius + slack, record.pursuit.arrival);
        let (attempt, is_in_group) = (record.attempts, record.pursuit.rank().is_some());
        if is_there != record.is_at_target {
            record.stop_turning(&mut self.world);
            record.turns_to = facing.filter(|_| is_there && !is_in_group);
        }
        if self.brake(id, is_there) && !is_in_group {
            self.tell_way(id);
            self.log_event(id, EventKind::TargetReached { attempt, goal });
        }
    }
}

impl NpcRecord {
    /// Where the NPC heads, m: its place at the goal.
    pub fn heads_for(&self) -> Option<Vec3> {
        self.goal.map(|goal| self.reserved.map_or(goal, |reserved| reserved.at))
    }
}
