//! The call about groups of NPCs that go to one goal.

use super::npcs::{WireGoal, goal_of, goal_response, goal_result, set_goal_on, warning_about};
use super::{Call, Reply, WorldApi};
use crate::hosted::{GoalSet, HostedWorld, NpcError, Rank};
use crate::ids::NpcId;
use crate::wire::each_once;
use crate::worlds::NpcAccess;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use surefoot_proto::convert::{self, FieldError, WireEnum};
use surefoot_proto::coordinates::CallFrame;
use surefoot_proto::world::v1 as wire;
use surefoot_world::formation::Shape;

/// Most followers of a group.
const MAX_FOLLOWERS: usize = 255;
/// Distance between neighbours unless the client says otherwise, and the greatest one, m.
const SPACING_M: f32 = 2.0;
const MAX_SPACING_M: f64 = 20.0;

/// What an NPC of a group does.
#[derive(Debug, Clone, Copy)]
enum Part {
    Leads,
    /// Follows, with this number.
    Follows(u32),
}

pub async fn set_group_goal(
    api: &WorldApi,
    call: Call<wire::SetGroupGoalRequest>,
) -> Reply<wire::SetGroupGoalResponse> {
    let (caller, wire::SetGroupGoalRequest { leader, follower_ids, formation, spacing }) = call;
    let (leader, goal) = goal_of(leader.as_ref().ok_or(FieldError::Missing("leader"))?)?;
    convert::in_range(follower_ids.len() as f64, 1.0, MAX_FOLLOWERS as f64, "follower_ids")?;
    each_once(follower_ids.clone(), "follower_ids")?;
    let shape = Shape::from_wire(formation).ok_or(FieldError::Missing("formation"))?;
    let spacing = if spacing == 0.0 { SPACING_M } else { spacing };
    convert::in_range(f64::from(spacing), 0.0, MAX_SPACING_M, "spacing")?;

    let parts = std::iter::once((leader, Part::Leads));
    let followers: Vec<NpcId> = follower_ids.into_iter().map(NpcId).collect();
    let parts = parts.chain(followers.iter().zip(0..).map(|(npc, number)| (*npc, Part::Follows(number))));
    // Without a leader, followers keep what they do.
    let leads = Arc::new(AtomicBool::new(false));
    let set = move |world: &mut HostedWorld, npc, part| match part {
        Part::Leads => {
            let set = set_goal_on(world, npc, goal)?;
            leads.store(true, Ordering::Relaxed);
            Ok(set)
        }
        Part::Follows(number) if leads.load(Ordering::Relaxed) => {
            follow(world, npc, Rank { leader, number, shape, spacing }, goal)
        }
        Part::Follows(_) => Err(NpcError::OtherWorld(npc, leader)),
    };
    let mut results = api.worlds.with_npcs(&caller, NpcAccess::Change, parts.map(Ok).collect(), set).await.into_iter();
    let set = results.next().expect("a result for the leader")?;
    let npcs = std::iter::once(leader).chain(followers);
    let leader = goal_response(set, warning_about(api, &caller, npcs).await);
    Ok(wire::SetGroupGoalResponse { leader: Some(leader), followers: results.map(goal_result).collect() })
}

fn follow(
    world: &mut HostedWorld,
    npc: NpcId,
    rank: Rank,
    WireGoal { coordinates, pursuit, .. }: WireGoal,
) -> Result<(GoalSet, CallFrame), NpcError> {
    let frame = coordinates.on(world.map().frame());
    Ok((world.follow_leader(npc, rank, pursuit.facing)?, frame))
}
