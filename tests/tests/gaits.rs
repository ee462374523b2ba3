//! NPCs that walk, jog and run, or are careful, as clients say.

use e2e::stage::{Services, level, world_of};
use e2e::{LIMIT, spawn, watch};
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use tokio::time::timeout;
use tokio_stream::StreamExt;

/// Top speed of the default body, m/s.
const TOP_SPEED: f32 = 11.0;

fn gait(npc_id: u64, speed: f32) -> wire::NpcGait {
    wire::NpcGait { npc_id, gait: Some(wire::Gait { speed, ..Default::default() }) }
}

/// The greatest speed of an NPC until its attempt ends, m/s, and how that ends.
async fn fastest(snapshots: &mut tonic::Streaming<wire::WatchWorldResponse>, attempt: u32) -> (f32, wire::Outcome) {
    let mut most = 0.0f32;
    let under_way = async {
        loop {
            let npc = snapshots.next().await.expect("an endless stream").unwrap().npcs[0];
            if npc.attempts_begun < attempt {
                continue;
            }
            let wire::Vec3 { x, z, .. } = npc.velocity.unwrap();
            most = most.max(x.hypot(z));
            if npc.attempts_ended == attempt {
                return npc.last_outcome();
            }
        }
    };
    let outcome = timeout(LIMIT, under_way).await.expect("the attempt ends");
    (most, outcome)
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_walk_as_fast_as_clients_say_also_on_the_way() {
    let services = Services::start();
    let hall = level(&[("floor", [0.0, -1.0, 0.0], [100.0, 0.0, 12.0])]);
    let mut stage = world_of(&services.server, hall, wire::TimeMode::Realtime).await;
    let ends = [[4.0, 0.0, 6.0], [34.0, 0.0, 6.0]].map(|place| stage.at(place));
    let npc_id = spawn(&mut stage.client, stage.world_id, ends[0]).await;
    let mut snapshots = watch(&mut stage.client, stage.world_id, 60.0).await;

    for (idx, share) in [0.2, 0.5, 1.0].into_iter().enumerate() {
        let set = wire::SetGaitsRequest { npcs: vec![gait(npc_id, share)] };
        let results = stage.client.set_gaits(set).await.unwrap().into_inner().results;
        assert_eq!(results, [wire::ItemResult { error: None }]);
        let goal = Some(ends[(idx + 1) % 2]);
        let request = wire::SetGoalRequest { npc_id, goal, ..Default::default() };
        let attempt = stage.client.set_goal(request).await.unwrap().into_inner().attempt;
        let (most, outcome) = fastest(&mut snapshots, attempt).await;
        assert_eq!(outcome, wire::Outcome::Reached);
        let top = share * TOP_SPEED;
        assert!(most > 0.8 * top && most < 1.05 * top, "{most} m/s, not {top}");
    }

    // A change on the way counts from the next decision on.
    let set = |share| wire::SetGaitsRequest { npcs: vec![gait(npc_id, share)] };
    stage.client.set_gaits(set(0.2)).await.unwrap();
    let request = wire::SetGoalRequest { npc_id, goal: Some(ends[0]), ..Default::default() };
    stage.client.set_goal(request).await.unwrap();
    let speed_in = |snapshot: &wire::WatchWorldResponse| snapshot.npcs[0].velocity.unwrap().x.abs();
    let mut until = async |is_met: fn(f32) -> bool| {
        let change = async { while !is_met(speed_in(&snapshots.next().await.unwrap().unwrap())) {} };
        timeout(LIMIT, change).await.expect("its speed changes");
    };
    until(|speed| speed > 1.5).await;
    stage.client.set_gaits(set(1.0)).await.unwrap();
    until(|speed| speed > 6.0).await;

    let get = wire::GetNpcRequest { npc_id, ..Default::default() };
    let known = stage.client.get_npc(get).await.unwrap().into_inner().gait.unwrap();
    assert_eq!((known.speed, known.acceleration), (1.0, 0.3));
    for (speed, npc_id, reason) in [
        (2.0, npc_id, Reason::InvalidField),
        (-0.5, npc_id, Reason::InvalidField),
        (0.5, npc_id + 7, Reason::NpcNotFound),
    ] {
        let set = wire::SetGaitsRequest { npcs: vec![gait(npc_id, speed)] };
        let results = stage.client.set_gaits(set).await.unwrap().into_inner().results;
        assert_eq!(results[0].error.as_ref().map(|error| error.reason.as_str()), Some(reason.name()), "{speed}");
    }
    services.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn gaits_have_names_which_fields_override() {
    let services = Services::start();
    let hall = level(&[("floor", [0.0, -1.0, 0.0], [100.0, 0.0, 12.0])]);
    let mut stage = world_of(&services.server, hall, wire::TimeMode::Realtime).await;
    let ends = [[4.0, 0.0, 6.0], [34.0, 0.0, 6.0]].map(|place| stage.at(place));
    let named = |name: &str| wire::Gait { name: name.to_owned(), ..Default::default() };
    let request = wire::SpawnNpcRequest {
        world_id: stage.world_id,
        position: Some(ends[0]),
        gait: Some(named("careful")),
        ..Default::default()
    };
    let npc_id = stage.client.spawn_npc(request.clone()).await.unwrap().into_inner().npc_id;
    let get = wire::GetNpcRequest { npc_id, ..Default::default() };
    let careful = stage.client.get_npc(get).await.unwrap().into_inner().gait.unwrap();
    assert!(careful.avoids_jumps && careful.wall_distance > 0.0 && careful.speed < 0.2 && careful.turn_rate < 1.0);
    assert_eq!(careful.name, "", "the values stand for it");

    let unknown = wire::SpawnNpcRequest { gait: Some(named("sprint")), ..request };
    let refused = stage.client.spawn_npc(unknown).await.unwrap_err();
    assert_eq!(refused.code(), tonic::Code::InvalidArgument);
    let names = "there are walk, jog, run, careful, hurried";
    assert!(refused.message().contains("sprint") && refused.message().contains(names), "{refused}");
    let set = |gait| wire::SetGaitsRequest { npcs: vec![wire::NpcGait { npc_id, gait: Some(gait) }] };
    let error = stage.client.set_gaits(set(named("sprint"))).await.unwrap().into_inner().results.remove(0).error;
    let error = error.expect("an unknown name");
    assert!(error.reason == Reason::InvalidField.name() && error.message.contains(names), "{error:?}");
    for wrong in [wire::Gait { turn_rate: 1.5, ..named("walk") }, wire::Gait { wall_distance: 3.0, ..named("") }] {
        let error = stage.client.set_gaits(set(wrong)).await.unwrap().into_inner().results.remove(0).error;
        assert_eq!(error.map(|error| error.reason).as_deref(), Some(Reason::InvalidField.name()));
    }

    // The NPC walks, and hurries on the way.
    stage.client.set_gaits(set(named("walk"))).await.unwrap();
    let request = wire::SetGoalRequest { npc_id, goal: Some(ends[1]), ..Default::default() };
    let attempt = stage.client.set_goal(request).await.unwrap().into_inner().attempt;
    let mut snapshots = watch(&mut stage.client, stage.world_id, 60.0).await;
    let walking = async {
        let mut slow = 0;
        while slow < 60 {
            let npc = snapshots.next().await.expect("an endless stream").unwrap().npcs[0];
            let speed = npc.velocity.unwrap().x.abs();
            assert!(speed < 0.15 * TOP_SPEED, "{speed} m/s");
            slow += u32::from(speed > 1.0);
        }
    };
    timeout(LIMIT, walking).await.expect("it walks");
    let hurried = wire::Gait { speed: 0.9, ..named("hurried") };
    stage.client.set_gaits(set(hurried)).await.unwrap();
    let (most, outcome) = fastest(&mut snapshots, attempt).await;
    assert_eq!(outcome, wire::Outcome::Reached);
    assert!(most > 0.7 * TOP_SPEED && most < 0.95 * TOP_SPEED, "{most} m/s");
    let known = stage.client.get_npc(get).await.unwrap().into_inner().gait.unwrap();
    assert_eq!((known.speed, known.turn_rate, known.avoids_jumps), (0.9, 1.0, false));
    services.stop().await;
}
