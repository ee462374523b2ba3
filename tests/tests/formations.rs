//! Groups of NPCs that go to one goal in formation, over real sockets.

use e2e::stage::{Services, Stage, level, world_of};
use e2e::{distance, spawn, watch_until};
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::set_goal_result::Result as Kind;
use tonic::Code;

/// Two rooms of 20 x 20 m, joined by a corridor 2.5 m wide and 8 m long.
fn rooms() -> Vec<u8> {
    level(&[
        ("floor", [0.0, -1.0, 0.0], [48.0, 0.0, 20.0]),
        ("block_a", [20.0, 0.0, -14.0], [28.0, 9.0, 8.75]),
        ("block_b", [20.0, 0.0, 11.25], [28.0, 9.0, 34.0]),
    ])
}

/// Starts the services, with a world of the rooms and so many NPCs in the first room.
async fn begin(npcs: usize) -> (Stage, Vec<u64>, Services) {
    let services = Services::start();
    let mut stage = world_of(&services.server, rooms(), wire::TimeMode::Realtime).await;
    let mut ids = Vec::new();
    for idx in 0..npcs {
        let place = stage.at([14.0 - 2.0 * (idx / 2) as f32, 0.0, 8.0 + 3.0 * (idx % 2) as f32]);
        ids.push(spawn(&mut stage.client, stage.world_id, place).await);
    }
    let is_ready = |snapshot: &wire::WatchWorldResponse| snapshot.npcs.iter().all(|npc| npc.worker_id != 0);
    watch_until(&mut stage.client, stage.world_id, is_ready).await;
    (stage, ids, services)
}

/// A group that goes to a place of the second room and faces along +x there.
fn group(stage: &Stage, ids: &[u64], formation: wire::Formation) -> wire::SetGroupGoalRequest {
    let goal = Some(stage.at([40.0, 0.0, 10.0]));
    let facing = Some(std::f32::consts::FRAC_PI_2);
    wire::SetGroupGoalRequest {
        leader: Some(wire::SetGoalRequest { npc_id: ids[0], goal, facing, ..Default::default() }),
        follower_ids: ids[1..].to_vec(),
        formation: formation.into(),
        spacing: 0.0,
    }
}

async fn send(stage: &mut Stage, request: wire::SetGroupGoalRequest) {
    let response = stage.client.set_group_goal(request).await.unwrap().into_inner();
    let is_set = |result: &wire::SetGoalResult| matches!(result.result, Some(Kind::Attempt(_)));
    assert!(response.followers.iter().all(is_set), "{response:?}");
}

/// Waits until so many attempts have ended with an outcome, and returns the NPCs.
async fn ended(stage: &mut Stage, attempts: u32) -> Vec<wire::Npc> {
    let has_ended = |snapshot: &wire::WatchWorldResponse| {
        snapshot.npcs.iter().map(|npc| npc.attempts_ended).sum::<u32>() >= attempts
    };
    watch_until(&mut stage.client, stage.world_id, has_ended).await.npcs
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wedge_goes_through_a_corridor_and_forms_up_at_its_goal() {
    let (mut stage, ids, services) = begin(5).await;
    let request = group(&stage, &ids, wire::Formation::Wedge);
    send(&mut stage, request).await;
    let npcs = ended(&mut stage, 5).await;
    assert!(npcs.iter().all(|npc| npc.last_outcome() == wire::Outcome::Reached), "{npcs:?}");
    // With 2 m between neighbours; right of +x is +z.
    let places = [[40.0, 10.0], [38.0, 12.0], [38.0, 8.0], [36.0, 14.0], [36.0, 6.0]];
    for (npc_id, [x, z]) in ids.iter().zip(places) {
        let npc = npcs.iter().find(|npc| npc.npc_id == *npc_id).unwrap();
        let place = stage.at([x, 0.0, z]);
        assert!(distance(npc.position.unwrap(), place) < 1.1, "npc {npc_id} is at {:?}, not {place:?}", npc.position);
    }
    services.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_group_goes_on_without_its_leader_and_stops_with_it() {
    let (mut stage, ids, services) = begin(3).await;
    let request = group(&stage, &ids, wire::Formation::Column);
    send(&mut stage, request.clone()).await;
    let stopped = stage.client.clear_goals(wire::ClearGoalsRequest { npc_ids: vec![ids[0]] }).await.unwrap();
    assert!(stopped.into_inner().results.iter().all(|result| result.error.is_none()));
    let is_idle =
        |snapshot: &wire::WatchWorldResponse| snapshot.npcs.iter().all(|npc| npc.status() == wire::NpcStatus::Idle);
    watch_until(&mut stage.client, stage.world_id, is_idle).await;

    send(&mut stage, request).await;
    stage.client.despawn_npc(wire::DespawnNpcRequest { npc_id: ids[0] }).await.unwrap();
    let npcs = ended(&mut stage, 2).await;
    assert!(npcs.iter().all(|npc| npc.last_outcome() == wire::Outcome::Reached), "{npcs:?}");
    let first = npcs.iter().find(|npc| npc.npc_id == ids[1]).unwrap();
    let goal = stage.at([40.0, 0.0, 10.0]);
    assert!(distance(first.position.unwrap(), goal) < 1.1, "the first follower leads: {first:?}");
    services.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn groups_that_cannot_be_are_refused() {
    let (mut stage, ids, services) = begin(3).await;
    let good = group(&stage, &ids, wire::Formation::Loose);
    let mistakes = [
        wire::SetGroupGoalRequest { formation: 0, ..good.clone() },
        wire::SetGroupGoalRequest { follower_ids: vec![], ..good.clone() },
        wire::SetGroupGoalRequest { follower_ids: vec![ids[1], ids[1]], ..good.clone() },
        wire::SetGroupGoalRequest { follower_ids: (0..256).collect(), ..good.clone() },
        wire::SetGroupGoalRequest { spacing: 21.0, ..good.clone() },
        wire::SetGroupGoalRequest { leader: None, ..good.clone() },
    ];
    for mistake in mistakes {
        let refused = stage.client.set_group_goal(mistake.clone()).await.unwrap_err();
        assert_eq!(refused.code(), Code::InvalidArgument, "{mistake:?}: {refused}");
    }
    let dense = wire::SetGroupGoalRequest { spacing: 0.4, follower_ids: vec![ids[1], ids[0], 77], ..good };
    let response = stage.client.set_group_goal(dense).await.unwrap().into_inner();
    let codes = response.followers.iter().map(|result| match &result.result {
        Some(Kind::Error(error)) => Code::from(error.code),
        _ => Code::Ok,
    });
    let expected = [Code::InvalidArgument, Code::InvalidArgument, Code::NotFound];
    assert_eq!(codes.collect::<Vec<_>>(), expected, "too dense, its own leader, and no NPC");
    services.stop().await;
}
