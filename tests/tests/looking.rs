//! NPCs at rest that look at what clients say, over sockets.

use e2e::stage::{level, world_of};
use e2e::{spawn, start_server, watch_until};
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::look_target::Target;
use surefoot_server::ServerConfig;

fn look(npc_id: u64, target: Option<Target>) -> wire::NpcLook {
    let target = target.map(|target| wire::LookTarget { target: Some(target) });
    wire::NpcLook { npc_id, target, ..Default::default() }
}

/// The heading from one place to another, rad.
fn heading(from: wire::Vec3, to: wire::Vec3) -> f32 {
    (to.x - from.x).atan2(to.z - from.z)
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_look_at_places_npcs_and_players_until_these_are_gone() {
    let server = start_server(ServerConfig::default());
    let hall = level(&[("floor", [0.0, -1.0, 0.0], [30.0, 0.0, 30.0])]);
    let mut stage = world_of(&server, hall, wire::TimeMode::Realtime).await;
    let (world_id, places) =
        (stage.world_id, [[15.0, 0.0, 15.0], [25.0, 0.0, 15.0], [15.0, 0.0, 5.0]].map(|at| stage.at(at)));
    let npcs =
        [spawn(&mut stage.client, world_id, places[0]).await, spawn(&mut stage.client, world_id, places[1]).await];
    let player = wire::SpawnPlayerRequest {
        world_id,
        position: Some(places[2]),
        radius: 0.4,
        height: 1.8,
        ..Default::default()
    };
    let player_id = stage.client.spawn_player(player).await.unwrap().into_inner().player_id;

    // The player stands here, in the coordinates of the level.
    let level_place = Target::Position(wire::Vec3 { x: 15.0, y: 0.0, z: 5.0 });
    for (target, coordinates, at) in [
        (Target::NpcId(npcs[1]), wire::Coordinates::Unspecified, places[1]),
        (Target::PlayerId(player_id), wire::Coordinates::Unspecified, places[2]),
        (Target::Position(places[1]), wire::Coordinates::Map, places[1]),
        (level_place, wire::Coordinates::Level, places[2]),
    ] {
        let item = wire::NpcLook { coordinates: coordinates.into(), ..look(npcs[0], Some(target)) };
        let results =
            stage.client.look_at(wire::LookAtRequest { npcs: vec![item] }).await.unwrap().into_inner().results;
        assert_eq!(results, [wire::ItemResult { error: None }]);
        let is_aimed = |snapshot: &wire::WatchWorldResponse| {
            let npc = snapshot.npcs.iter().find(|npc| npc.npc_id == npcs[0]).unwrap();
            (npc.yaw - heading(npc.position.unwrap(), at)).cos() > 0.999
        };
        watch_until(&mut stage.client, world_id, is_aimed).await;
        let get = wire::GetNpcRequest { npc_id: npcs[0], coordinates: coordinates.into() };
        let known = stage.client.get_npc(get).await.unwrap().into_inner().look_at;
        assert_eq!(known.and_then(|it| it.target), Some(target), "as it was set");
    }

    let unset = wire::NpcLook { target: Some(wire::LookTarget { target: None }), ..look(npcs[0], None) };
    let items = [
        (look(npcs[0], None), None),
        (unset, Some(Reason::InvalidField)),
        (look(npcs[0], Some(Target::Position(wire::Vec3 { x: f32::NAN, y: 0.0, z: 0.0 }))), Some(Reason::InvalidField)),
        (look(npcs[0], Some(Target::NpcId(npcs[1] + 7))), Some(Reason::NpcNotFound)),
        (look(npcs[0], Some(Target::PlayerId(99))), Some(Reason::PlayerNotFound)),
        (look(npcs[1] + 7, None), Some(Reason::NpcNotFound)),
    ];
    let (npcs_to_set, expected): (Vec<_>, Vec<_>) = items.into_iter().unzip();
    let results = stage.client.look_at(wire::LookAtRequest { npcs: npcs_to_set }).await.unwrap().into_inner().results;
    let reasons = results.into_iter().map(|result| result.error.map(|error| error.reason)).collect::<Vec<_>>();
    assert_eq!(reasons, expected.into_iter().map(|it| it.map(|it| it.name().to_owned())).collect::<Vec<_>>());
    let get = wire::GetNpcRequest { npc_id: npcs[0], ..Default::default() };
    assert_eq!(stage.client.get_npc(get).await.unwrap().into_inner().look_at, None);

    let too_many = wire::LookAtRequest { npcs: vec![look(npcs[0], None); 4097] };
    assert_eq!(stage.client.look_at(too_many).await.unwrap_err().code(), tonic::Code::OutOfRange);
    server.stop().await;
}
