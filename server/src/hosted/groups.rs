//! Groups of NPCs in formation: the followers' goals are places behind their leader, until it has arrived.

use super::commands::NpcError;
use super::gathering::PLACE_RADIUS_M;
use super::pursuit::{GoalOrder, GoalSet, Group, Pursuit, Rank, Target};
use super::world::HostedWorld;
use crate::ids::NpcId;
use std::collections::BTreeMap;
use surefoot_world::formation::{Formation, Orders};
use surefoot_world::{Action, Body, End, NpcSlot, TICKS_PER_DECISION, Vec3};

/// Least gap between bodies of a group, m.
const GAP_M: f32 = 0.2;

impl HostedWorld {
    /// Lets an NPC follow the leader of a group, which is on its way to a goal.
    pub fn follow_leader(&mut self, id: NpcId, rank: Rank, facing: Option<f32>) -> Result<GoalSet, NpcError> {
        let slot = self.records.get(&id).ok_or(NpcError::Unknown(id))?.slot;
        if id == rank.leader {
            return Err(NpcError::OwnTarget(id));
        }
        let leader = self.records.get(&rank.leader).ok_or(NpcError::OtherWorld(id, rank.leader))?;
        if leader.pursuit.rank().is_some() && leader.goal.is_some() {
            return Err(NpcError::Follows(rank.leader));
        }
        let least = [slot, leader.slot].map(|slot| self.radius_of(slot)).iter().sum::<f32>() + GAP_M;
        if rank.spacing < least {
            return Err(NpcError::TooDense { spacing: rank.spacing, least });
        }
        let target = Some(Target::Rank(rank));
        let pursuit = Pursuit { target, keeps: true, radius: PLACE_RADIUS_M, facing, ..Pursuit::default() };
        let set = self.set_goal(id, GoalOrder { goal: None, pursuit })?;
        self.begin_group(rank);
        Ok(set)
    }

    /// Begins the way of a group, unless it has begun.
    fn begin_group(&mut self, rank: Rank) {
        let Some(leader) = self.records.get(&rank.leader) else { return };
        let feet = self.world.npc(leader.slot).expect("every record has an NPC").body.feet;
        let is_same = |group: &Group| group.formation.layout() == (rank.shape, rank.spacing);
        if !self.groups.get(&rank.leader).is_some_and(is_same) {
            let formation = Formation::new(rank.shape, rank.spacing, feet, leader.goal.unwrap_or(feet));
            self.groups.insert(rank.leader, Group { formation, places: BTreeMap::new() });
        }
    }

    fn radius_of(&self, slot: NpcSlot) -> f32 {
        self.world.npc(slot).map_or(0.0, |npc| self.world.profile_of(npc).radius)
    }

    /// The place of a follower, m: where it is, before the group has set out.
    pub(super) fn place_in_group(&self, id: NpcId, rank: Rank) -> Result<Vec3, NpcError> {
        if !self.is_under_way(rank.leader) {
            return Err(NpcError::Unknown(rank.leader));
        }
        let place = self.groups.get(&rank.leader).and_then(|group| group.places.get(&id));
        let record = self.records.get(&id).ok_or(NpcError::Unknown(id))?;
        let feet = self.world.npc(record.slot).expect("every record has an NPC").body.feet;
        Ok(place.copied().unwrap_or(record.goal.unwrap_or(feet)))
    }

    /// Whether the leader of a group has a goal, or will try again to reach it.
    fn is_under_way(&self, leader: NpcId) -> bool {
        self.records.get(&leader).is_some_and(|record| record.goal.is_some() || record.retry.is_some())
    }

    /// All followers with their places in their groups.
    fn ranks(&self) -> impl Iterator<Item = (NpcId, Rank)> {
        self.records.iter().filter_map(|(&id, record)| {
            let pursuit = record.retry.map_or(record.pursuit, |retry| retry.pursuit);
            let is_member = record.goal.is_some() || record.retry.is_some();
            Some((id, pursuit.rank().filter(|_| is_member)?))
        })
    }

    /// The followers of a leader, the first one first.
    fn followers(&self, leader: NpcId) -> Vec<NpcId> {
        in_order(self.ranks().filter(|(_, rank)| rank.leader == leader).collect())
    }

    /// Moves the places of all followers, once in each decision, and lets leaders wait for them.
    pub(super) fn lead_groups(&mut self) {
        if !self.tick().0.is_multiple_of(u64::from(TICKS_PER_DECISION)) {
            return;
        }
        let mut members: BTreeMap<NpcId, Vec<(NpcId, Rank)>> = BTreeMap::new();
        self.ranks().for_each(|(id, rank)| members.entry(rank.leader).or_default().push((id, rank)));
        // Groups are not saved: after a restart they begin again where they are.
        members.values().for_each(|members| self.begin_group(members[0].1));
        let mut groups = std::mem::take(&mut self.groups);
        groups.retain(|leader, group| {
            let followers = in_order(members.remove(leader).unwrap_or_default());
            self.lead(*leader, group, followers)
        });
        self.groups = groups;
    }

    /// Moves the places of a group. Returns whether it has followers and a leader under way.
    fn lead(&mut self, leader: NpcId, group: &mut Group, followers: Vec<NpcId>) -> bool {
        let slots: Vec<NpcSlot> = followers.iter().map(|id| self.records[id].slot).collect();
        let is_under_way = self.is_under_way(leader);
        let Some(record) = self.records.get_mut(&leader) else { return false };
        let is_group = is_under_way && !followers.is_empty();
        let Orders { places, leader_waits } = group.formation.update(&self.world, record.slot, &slots);
        let waited = std::mem::replace(&mut record.awaits_group, is_group && leader_waits && record.goal.is_some());
        if record.awaits_group && !waited {
            record.awaiting = None;
            self.world.decide(record.slot, Action::default());
        }
        group.places = followers.into_iter().zip(places).filter_map(|(id, place)| Some((id, place?))).collect();
        is_group
    }

    /// Ends the way of a group whose leader's attempt at `goal`, m, has ended: followers go to their places there, go
    /// on without it, or end as it did.
    pub(super) fn end_group(&mut self, leader: NpcId, end: End, goal: Vec3, pursuit: Pursuit) {
        let followers = self.followers(leader);
        match end {
            _ if followers.is_empty() => {}
            End::Reached | End::ReachedNear => self.form_up(leader, &followers, goal, pursuit.facing),
            _ if end.is_harm() => self.replace_leader(leader, &followers, Some((goal, pursuit))),
            _ if pursuit.keeps => {}
            _ => followers.into_iter().for_each(|id| self.end_of_follower(id, end)),
        }
    }

    /// Lets the followers end as their leader, which has no goal any more.
    fn end_of_follower(&mut self, id: NpcId, end: End) {
        if let Some(record) = self.records.get_mut(&id) {
            record.pursuit.keeps = false;
            record.retry = None;
            self.end_attempt(id, end);
        }
    }

    /// Sends the followers to their places around the goal, m, which the leader has reached.
    fn form_up(&mut self, leader: NpcId, followers: &[NpcId], goal: Vec3, facing: Option<f32>) {
        let Some(group) = self.groups.remove(&leader) else { return };
        let slots: Vec<NpcSlot> = followers.iter().map(|id| self.records[id].slot).collect();
        let heading = facing.map_or(group.formation.heading(), |yaw| Body::at(goal, yaw).facing());
        let places = group.formation.places_at(&self.world, &slots, goal, heading);
        for (id, place) in followers.iter().zip(places) {
            let Some(record) = self.records.get_mut(id) else { continue };
            let place = place.or(group.places.get(id).copied());
            if let Some(retry) = record.retry.as_mut() {
                retry.pursuit = Pursuit { target: None, keeps: false, ..retry.pursuit };
                retry.goal = place.unwrap_or(retry.goal);
                continue;
            }
            record.pursuit = Pursuit { target: None, keeps: false, ..record.pursuit };
            record.is_at_target = false;
            if let Some(place) = place {
                self.move_goal(*id, place);
            }
        }
    }

    /// Lets the first follower lead the others on to the goal, m, of a leader that is lost.
    fn replace_leader(&mut self, leader: NpcId, followers: &[NpcId], way: Option<(Vec3, Pursuit)>) {
        let group = self.groups.remove(&leader);
        let Some((&first, rest)) = followers.split_first() else { return };
        let Some((goal, pursuit)) = way else { return };
        self.log_replaced_attempt(first);
        self.begin_attempt(first, goal, pursuit);
        for id in rest {
            let Some(record) = self.records.get_mut(id) else { continue };
            record.pursuit.lead_by(first);
            if let Some(retry) = record.retry.as_mut() {
                retry.pursuit.lead_by(first);
            }
        }
        self.groups.extend(group.map(|group| (first, group)));
    }

    /// Lets the followers of an NPC that a client has stopped come to rest too.
    pub(super) fn disband(&mut self, leader: NpcId) -> Result<(), NpcError> {
        match self.groups.remove(&leader) {
            Some(_) => self.followers(leader).into_iter().try_for_each(|id| self.drop_goal(id)),
            None => Ok(()),
        }
    }

    /// Lets the followers of an NPC that is about to be removed go on without it.
    pub(super) fn lose_leader(&mut self, leader: NpcId) {
        if self.groups.contains_key(&leader)
            && let Some(record) = self.records.get(&leader)
        {
            let way = record.retry.map(|retry| (retry.goal, retry.pursuit));
            let way = record.goal.map(|goal| (goal, record.pursuit)).or(way);
            self.replace_leader(leader, &self.followers(leader), way);
        }
    }
}

/// The ids of followers, the first one first.
fn in_order(mut members: Vec<(NpcId, Rank)>) -> Vec<NpcId> {
    members.sort_unstable_by_key(|(id, rank)| (rank.number, *id));
    members.into_iter().map(|(id, _)| id).collect()
}
