//! Calls in the level's own coordinates, on a level in centimetres with z up that lies far from its origin.

use e2e::{
    LIMIT, Running, build_to_end, create_world, ground, planner_client, small_graph, start_planner, start_server,
    watch_until, world_client,
};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::convert::{to_wire, unpack_points};
use surefoot_proto::planner::v1 as plan;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_server::ServerConfig;
use surefoot_world::map::{LevelFrame, UpAxis};
use surefoot_world::{DVec3, Vec3};
use tokio_stream::StreamExt;
use tonic::Code;
use tonic::transport::Channel;

const LEVEL: i32 = wire::Coordinates::Level as i32;
/// Greatest difference between two places that are the same, in units of the level: 1 cm.
const NEAR: f32 = 1.0;

/// A level's file: a floor of 40 x 40 m, whose corner with the lowest coordinates is at (60000, -51000, 1200).
fn floor() -> wire::ImportMapRequest {
    let corners = [(0, 0), (4000, 0), (4000, 4000), (0, 4000)];
    let corners = corners.map(|(x, y)| format!("v {} {} 1200\n", 60_000 + x, -51_000 + y)).concat();
    wire::ImportMapRequest {
        name: "floor.obj".to_owned(),
        format: wire::MapFormat::Obj.into(),
        file: format!("o floor\n{corners}f 1 2 3 4\n").into_bytes(),
        scale: 0.01,
        up: wire::UpAxis::Z.into(),
        ..Default::default()
    }
}

/// Imports a level. Returns the hash of its map, and its frame.
async fn import(service: &Running, request: wire::ImportMapRequest) -> (String, LevelFrame) {
    let mut maps = MapServiceClient::connect(service.uri.clone()).await.expect("the service accepts");
    let (scale, up) = (request.scale, if request.up() == wire::UpAxis::Z { UpAxis::Z } else { UpAxis::Y });
    let imported = maps.import_map(request).await.expect("a level").into_inner();
    let wire::Vec3d { x, y, z } = imported.origin.expect("an origin");
    // Scales such as 0.01 are decimal numbers.
    let scale = format!("{scale}").parse().expect("a number");
    (imported.map.expect("a map").map_hash, LevelFrame { origin: DVec3::new(x, y, z), scale, up })
}

fn on_axes(place: wire::Vec3) -> Vec3 {
    Vec3::new(place.x, place.y, place.z)
}

/// A place of the map in the coordinates of a level.
fn in_level(frame: &LevelFrame, place: wire::Vec3) -> wire::Vec3 {
    to_wire(frame.to_level(on_axes(place)).as_vec3())
}

#[track_caller]
fn assert_near(found: Option<wire::Vec3>, expected: wire::Vec3) {
    let found = found.expect("a place");
    assert!(on_axes(found).distance(on_axes(expected)) < NEAR, "{found:?} is not near {expected:?}");
}

/// A world on that floor: its client, its id, its frame, and places on its ground, on the map and in the level.
struct Stage {
    client: WorldServiceClient<Channel>,
    world_id: u64,
    frame: LevelFrame,
    on_map: Vec<wire::Vec3>,
    in_level: Vec<wire::Vec3>,
}

async fn stage(server: &Running) -> Stage {
    let mut client = world_client(server).await;
    let (map_hash, frame) = import(server, floor()).await;
    let request = wire::CreateWorldRequest { map_hash, ..Default::default() };
    let world_id = client.create_world(request).await.unwrap().into_inner().world.unwrap().world_id;
    let on_map = ground(&mut client, world_id, 8).await;
    let request = wire::SampleGroundRequest { world_id, count: 8, seed: 1, coordinates: LEVEL, ..Default::default() };
    let places = client.sample_ground(request).await.unwrap().into_inner().points;
    Stage { client, world_id, frame, on_map, in_level: places }
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_are_where_the_levels_file_says() {
    let server = start_server(ServerConfig::default());
    let Stage { mut client, world_id, frame, on_map, in_level: places } = stage(&server).await;
    for (place, &on_map) in places.iter().zip(&on_map) {
        assert!((60_000.0..=64_000.0).contains(&place.x) && (-51_000.0..=-47_000.0).contains(&place.y), "{place:?}");
        assert!((place.z - 1200.0).abs() < 20.0, "{place:?}");
        assert_near(Some(*place), in_level(&frame, on_map));
    }
    let request =
        wire::SpawnNpcRequest { world_id, position: Some(places[0]), coordinates: LEVEL, ..Default::default() };
    let npc_id = client.spawn_npc(request).await.unwrap().into_inner().npc_id;
    let state = async |client: &mut WorldServiceClient<Channel>, coordinates| {
        client.get_npc(wire::GetNpcRequest { npc_id, coordinates }).await.unwrap().into_inner().npc.unwrap()
    };
    assert_near(state(&mut client, 0).await.position, on_map[0]);
    assert_near(state(&mut client, LEVEL).await.position, places[0]);

    let request = wire::SetGoalRequest { npc_id, goal: Some(places[1]), coordinates: LEVEL, ..Default::default() };
    client.set_goal(request).await.unwrap();
    assert_near(state(&mut client, 0).await.goal, on_map[1]);
    assert_near(state(&mut client, LEVEL).await.goal, places[1]);
    let teleport = |position, coordinates| wire::TeleportNpcRequest {
        npc_id,
        position: Some(position),
        coordinates,
        ..Default::default()
    };
    client.teleport_npc(teleport(places[2], LEVEL)).await.unwrap();
    assert_near(state(&mut client, 0).await.position, on_map[2]);
    // Each item of a batch has coordinates of its own.
    let teleports = vec![teleport(on_map[0], 0), teleport(places[3], LEVEL)];
    client.batch_teleport_npcs(wire::BatchTeleportNpcsRequest { teleports }).await.unwrap();
    let request = wire::BatchGetNpcsRequest { npc_ids: vec![npc_id, 77], coordinates: LEVEL };
    let results = client.batch_get_npcs(request).await.unwrap().into_inner().results;
    let [wire::GetNpcResult { result: Some(wire::get_npc_result::Result::Npc(npc)) }, missing] = &results[..] else {
        panic!("{results:?}")
    };
    assert_near(npc.position, places[3]);
    assert!(matches!(missing.result, Some(wire::get_npc_result::Result::Error(_))));
    let spawns = vec![wire::Spawn { position: Some(places[4]), goal: Some(places[5]), ..Default::default() }];
    let request = wire::BatchSpawnNpcsRequest { world_id, spawns, coordinates: LEVEL, ..Default::default() };
    client.batch_spawn_npcs(request).await.unwrap();
    let listed = client.list_npcs(wire::ListNpcsRequest { world_id, ..Default::default() }).await.unwrap();
    assert_near(listed.into_inner().npcs[1].goal, on_map[5]);

    let hold = wire::Hold { position: Some(places[6]), ..Default::default() };
    let route = Some(wire::Route { kind: Some(wire::route::Kind::Hold(hold)) });
    let routes = vec![wire::NpcRoute { npc_id, route, coordinates: LEVEL }];
    client.set_routes(wire::SetRoutesRequest { routes }).await.unwrap();
    let has_goal = |snapshot: &wire::WatchWorldResponse| snapshot.npcs[0].goal.is_some();
    assert_near(watch_until(&mut client, world_id, has_goal).await.npcs[0].goal, on_map[6]);

    let mistaken = wire::SetGoalRequest { npc_id, goal: Some(places[1]), coordinates: 0, ..Default::default() };
    let refusal = client.set_goal(mistaken).await.unwrap_err();
    assert!(refusal.message().contains("outside the map") && refusal.message().contains("in the level ("), "{refusal}");
    let unknown = wire::SetGoalRequest { npc_id, goal: Some(places[1]), coordinates: 7, ..Default::default() };
    let refusal = client.set_goal(unknown).await.unwrap_err();
    assert!(refusal.code() == Code::InvalidArgument && refusal.message().contains("coordinates"), "{refusal}");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn segments_follow_the_axes_and_units_of_the_level() {
    let server = start_server(ServerConfig::default());
    let Stage { mut client, world_id, in_level: places, .. } = stage(&server).await;
    let request =
        wire::SpawnPlayerRequest { world_id, position: Some(places[0]), coordinates: LEVEL, ..Default::default() };
    let player_id = client.spawn_player(request).await.unwrap().into_inner().player_id;
    let request = wire::WatchSegmentsRequest { world_id, coordinates: LEVEL, ..Default::default() };
    let mut messages = client.watch_segments(request).await.unwrap().into_inner();
    let first = tokio::time::timeout(LIMIT, messages.next()).await.unwrap().unwrap().unwrap();
    assert_near(first.starts[0].position, places[0]);
    assert!((first.step - 1.0).abs() < 1e-9, "a step of {} of the level's units, which are centimetres", first.step);

    let position = Some(wire::Vec3 { x: places[0].x + 50.0, y: places[0].y - 30.0, z: places[0].z + 20.0 });
    let moves = vec![wire::PlayerMove { player_id, position, ..Default::default() }];
    client.move_players(wire::MovePlayersRequest { world_id, moves, coordinates: LEVEL }).await.unwrap();
    let moved = loop {
        let message = tokio::time::timeout(LIMIT, messages.next()).await.unwrap().unwrap().unwrap();
        if !message.bodies.is_empty() {
            break message;
        }
    };
    assert_eq!(moved.ticks, [1]);
    let off = moved.moves.iter().zip([50, -30, 20]).map(|(found, expected)| (found - expected).abs()).max();
    assert!(off <= Some(1), "{moved:?}");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn readers_see_a_world_as_in_the_levels_file() {
    let server = start_server(ServerConfig::default());
    let Stage { mut client, world_id, in_level: places, .. } = stage(&server).await;
    let request =
        wire::SpawnNpcRequest { world_id, position: Some(places[0]), coordinates: LEVEL, ..Default::default() };
    let npc_id = client.spawn_npc(request).await.unwrap().into_inner().npc_id;
    let around = |place: wire::Vec3, side: f32| {
        let corner = |by: f32| Some(wire::Vec3 { x: place.x + by, y: place.y + by, z: place.z + by });
        Some(wire::Region { low: corner(-side), high: corner(side) })
    };
    let away = wire::Vec3 { y: places[0].y + 3000.0, ..places[0] };
    for (region, is_there) in [(around(places[0], 100.0), true), (around(away, 100.0), false)] {
        let request =
            wire::WatchWorldRequest { world_id, region, delta: true, coordinates: LEVEL, ..Default::default() };
        let mut snapshots = client.watch_world(request).await.unwrap().into_inner();
        let first = tokio::time::timeout(LIMIT, snapshots.next()).await.unwrap().unwrap().unwrap();
        assert_eq!(first.npcs.len(), usize::from(is_there));
        first.npcs.iter().for_each(|npc| assert_near(npc.position, places[0]));
        let request = wire::ListNpcsRequest { world_id, region, coordinates: LEVEL, ..Default::default() };
        assert_eq!(client.list_npcs(request).await.unwrap().into_inner().npcs.len(), usize::from(is_there));
    }
    let upside_down = Some(wire::Region { low: Some(places[0]), high: Some(wire::Vec3 { z: 0.0, ..places[0] }) });
    let request = wire::ListNpcsRequest { world_id, region: upside_down, coordinates: LEVEL, ..Default::default() };
    assert_eq!(client.list_npcs(request).await.unwrap_err().code(), Code::InvalidArgument);

    let request = wire::FollowNpcRequest { npc_id, rays: true, coordinates: LEVEL, ..Default::default() };
    let mut steps = client.follow_npc(request).await.unwrap().into_inner();
    // An NPC without a goal stays where it is, once it stands.
    let (first, stands) = loop {
        let step = tokio::time::timeout(LIMIT, steps.next()).await.unwrap().unwrap().unwrap();
        if let Some(prediction) = step.npc.as_ref().unwrap().movement.unwrap().prediction {
            break (step, prediction);
        }
    };
    assert_near(first.npc.unwrap().position, places[0]);
    assert_near(stands.in_60_ticks.unwrap().position, places[0]);
    let (eyes, below) =
        (first.eyes.unwrap(), first.rays.iter().filter(|ray| ray.surface() != wire::Surface::Unspecified));
    assert!((100.0..200.0).contains(&(eyes.z - places[0].z)), "eyes are above the feet along z: {eyes:?}");
    assert!(below.clone().count() > 4);
    below.for_each(|ray| assert!((ray.end.unwrap().z - 1200.0).abs() < 20.0, "{ray:?}"));

    let after = Some(wire::EventCursor::default());
    let request = wire::WatchEventsRequest { world_id, after, coordinates: LEVEL, ..Default::default() };
    let mut messages = client.watch_events(request).await.unwrap().into_inner();
    let spawned = loop {
        let message = tokio::time::timeout(LIMIT, messages.next()).await.unwrap().unwrap().unwrap();
        let first = message.events.into_iter().next().and_then(|event| event.event);
        if let Some(wire::npc_event::Event::Spawned(spawned)) = first {
            break spawned;
        }
    };
    assert_near(spawned.position, places[0]);

    let request = wire::GetMeshRequest { world_id, coordinates: LEVEL, ..Default::default() };
    let tile = client.get_mesh(request).await.unwrap().into_inner().next().await.unwrap().unwrap();
    let corners = unpack_points(&tile.positions, tile.positions.len() / 12, "positions").unwrap();
    let (low, high) = (Vec3::new(59_900.0, -51_100.0, 1100.0), Vec3::new(64_100.0, -46_900.0, 1300.0));
    assert!(corners.iter().all(|corner| low.cmple(*corner).all() && corner.cmple(high).all()), "{corners:?}");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn pieces_and_players_are_where_the_levels_file_says() {
    let server = start_server(ServerConfig::default());
    let Stage { mut client, world_id, on_map, in_level: places, .. } = stage(&server).await;
    let block = wire::BlockPiece { foot: Some(places[0]), width: 1.0, depth: 1.5, height: 2.0, yaw: 0.0 };
    let shape = Some(wire::piece::Shape::Block(block));
    let put = vec![wire::Piece { name: "crate".to_owned(), shape }];
    let request = wire::EditMapRequest { world_id, put, coordinates: LEVEL, ..Default::default() };
    client.edit_map(request).await.unwrap();
    for (coordinates, foot) in [(0, on_map[0]), (LEVEL, places[0])] {
        let listed = client.list_pieces(wire::ListPiecesRequest { world_id, coordinates }).await.unwrap().into_inner();
        let Some(wire::piece::Shape::Block(listed)) = listed.pieces[0].shape else { panic!("{listed:?}") };
        assert_near(listed.foot, foot);
        assert_eq!((listed.width, listed.depth, listed.height), (1.0, 1.5, 2.0), "lengths are in metres");
    }
    let request =
        wire::SpawnPlayerRequest { world_id, position: Some(places[1]), coordinates: LEVEL, ..Default::default() };
    let player_id = client.spawn_player(request).await.unwrap().into_inner().player_id;
    let (position, velocity) = (Some(places[2]), Some(wire::Vec3 { x: 0.0, y: 100.0, z: 0.0 }));
    let moves = vec![wire::PlayerMove { player_id, position, velocity }];
    client.move_players(wire::MovePlayersRequest { world_id, moves, coordinates: LEVEL }).await.unwrap();
    for (coordinates, position, velocity) in [
        (0, on_map[2], wire::Vec3 { x: 0.0, y: 0.0, z: -1.0 }),
        (LEVEL, places[2], wire::Vec3 { x: 0.0, y: 100.0, z: 0.0 }),
    ] {
        let request = wire::WatchWorldRequest { world_id, coordinates, ..Default::default() };
        let mut snapshots = client.watch_world(request).await.unwrap().into_inner();
        let player = tokio::time::timeout(LIMIT, snapshots.next()).await.unwrap().unwrap().unwrap().players[0];
        assert_near(player.position, position);
        assert!(on_axes(player.velocity.unwrap()).distance(on_axes(velocity)) < 1.0e-3, "{player:?}");
    }
    server.stop().await;
}

/// A graph of that floor: a client of its planner, its id, its frame, and itself on the map and in the level.
struct Graphs {
    client: PlannerServiceClient<Channel>,
    graph_id: String,
    frame: LevelFrame,
    on_map: plan::GetGraphResponse,
    in_level: plan::GetGraphResponse,
}

async fn graphs(planner: &Running) -> Graphs {
    let mut client = planner_client(planner).await;
    let (map_hash, frame) = import(planner, floor()).await;
    let request = plan::StartBuildRequest { map_hash, settings: Some(small_graph()), ..Default::default() };
    let graph_id = build_to_end(&mut client, request).await.graph_id;
    let request = |coordinates| plan::GetGraphRequest { graph_id: graph_id.clone(), coordinates };
    let on_map = client.get_graph(request(0)).await.unwrap().into_inner();
    let in_level = client.get_graph(request(LEVEL)).await.unwrap().into_inner();
    Graphs { client, graph_id, frame, on_map, in_level }
}

#[tokio::test(flavor = "multi_thread")]
async fn zones_are_where_the_levels_file_says() {
    use wire::zone::{Rule, Shape};
    let server = start_server(ServerConfig::default());
    let Stage { mut client, world_id, frame, in_level: places, .. } = stage(&server).await;
    let (low, high) = (places[0], wire::Vec3 { x: places[0].x + 500.0, y: places[0].y + 300.0, z: 1700.0 });
    let zone = |name: &str, shape| wire::Zone {
        name: name.to_owned(),
        shape: Some(shape),
        rule: Some(Rule::Never(true)),
        for_tags: Vec::new(),
    };
    let put = vec![
        zone("box", Shape::Box(wire::ZoneBox { low: Some(low), high: Some(high) })),
        zone("cylinder", Shape::Cylinder(wire::ZoneCylinder { bottom: Some(places[1]), radius: 2.0, height: 3.0 })),
    ];
    let request = wire::SetZonesRequest { world_id, put, coordinates: LEVEL, ..Default::default() };
    client.set_zones(request).await.unwrap();
    let mut list = async |coordinates| {
        let zones =
            client.list_zones(wire::ListZonesRequest { world_id, coordinates }).await.unwrap().into_inner().zones;
        match (&zones[0].shape, &zones[1].shape) {
            (Some(Shape::Box(corners)), Some(Shape::Cylinder(cylinder))) => (*corners, *cylinder),
            other => panic!("{other:?}"),
        }
    };
    let (corners, cylinder) = list(LEVEL).await;
    assert_near(corners.low, low);
    assert_near(corners.high, high);
    assert_near(cylinder.bottom, places[1]);
    // On the map, one axis is opposite.
    let (corners, cylinder) = list(0).await;
    let (near, far) = (corners.low.unwrap(), corners.high.unwrap());
    assert!(near.x < far.x && near.y < far.y && near.z < far.z, "{corners:?}");
    assert_near(Some(in_level(&frame, wire::Vec3 { z: far.z, ..near })), low);
    assert_near(Some(in_level(&frame, wire::Vec3 { z: near.z, ..far })), high);
    assert_near(Some(in_level(&frame, cylinder.bottom.unwrap())), places[1]);
    assert_eq!((cylinder.radius, cylinder.height), (2.0, 3.0), "lengths are in metres");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn graphs_and_plans_have_places_of_the_levels_file() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let Graphs { mut client, graph_id, frame, on_map, in_level: places } = graphs(&planner).await;
    let (on_map, places) = (&on_map.vertices, &places.vertices);
    let id = || graph_id.clone();
    on_map.iter().zip(places).for_each(|(on_map, place)| assert_near(Some(*place), in_level(&frame, *on_map)));

    let query = |places: &[wire::Vec3]| plan::PathQuery {
        start: Some(places[0]),
        goal: Some(places[20]),
        ..Default::default()
    };
    let find = |query, coordinates| plan::FindPathRequest { graph_id: id(), query: Some(query), coordinates };
    let found = client.find_path(find(query(on_map), 0)).await.unwrap().into_inner().plan.unwrap();
    let same = client.find_path(find(query(places), LEVEL)).await.unwrap().into_inner().plan.unwrap();
    assert!(found.found && same.found && (found.seconds - same.seconds).abs() < 0.01, "{found:?} {same:?}");
    let many = plan::FindPathsRequest {
        graph_id: id(),
        queries: vec![query(places)],
        coordinates: LEVEL,
        ..Default::default()
    };
    let many = client.find_paths(many).await.unwrap().into_inner().plans;
    for plan in [&same, &many[0]] {
        assert_eq!(plan.waypoints.len(), found.waypoints.len());
        let waypoints = plan.waypoints.iter().zip(&found.waypoints);
        waypoints.for_each(|(place, on_map)| assert_near(Some(*place), in_level(&frame, *on_map)));
    }
    let refusal = client.find_path(find(query(places), 0)).await.unwrap_err();
    assert!(refusal.message().contains("outside the map") && refusal.message().contains("in the level ("), "{refusal}");

    let probe = |coordinates| plan::ProbeEdgeRequest { graph_id: id(), from: 0, to: 1, seed: 3, coordinates };
    let track = client.probe_edge(probe(0)).await.unwrap().into_inner().track;
    let same = client.probe_edge(probe(LEVEL)).await.unwrap().into_inner().track;
    let track = unpack_points(&track, track.len() / 12, "track").unwrap();
    let same = unpack_points(&same, track.len(), "track").unwrap();
    track.iter().zip(same).for_each(|(at, same)| assert_near(Some(to_wire(same)), in_level(&frame, to_wire(*at))));

    let request = plan::CompareGraphsRequest { before: id(), after: id(), coordinates: LEVEL };
    assert_eq!(client.compare_graphs(request).await.unwrap().into_inner().lost, []);
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn layers_have_places_of_the_levels_file() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let Graphs { mut client, graph_id, on_map, in_level: graph, .. } = graphs(&planner).await;
    let (on_map, places) = (&on_map.vertices, &graph.vertices);
    let (id, edge) = (|| graph_id.clone(), &graph.edges[0]);
    let (from, to) = (edge.from as usize, edge.to as usize);
    let forced = plan::ForceEdge { from: Some(places[from]), to: Some(places[to]), seconds: Some(9.0) };
    let edits = vec![plan::Edit { edit: Some(plan::edit::Edit::ForceEdge(forced)) }];
    let layer = Some(plan::Layer { name: "night".to_owned(), edits });
    let request = plan::PutLayerRequest { graph_id: id(), layer, coordinates: LEVEL, ..Default::default() };
    assert_eq!(client.put_layer(request).await.unwrap().into_inner().unapplied, []);
    let nowhere = plan::VertexEdit { at: Some(wire::Vec3 { x: places[0].x + 90_000.0, ..places[0] }) };
    let edits = vec![plan::Edit { edit: Some(plan::edit::Edit::RemoveVertex(nowhere)) }];
    let request = plan::AppendEditsRequest {
        graph_id: id(),
        layer: "night".to_owned(),
        edits,
        coordinates: LEVEL,
        ..Default::default()
    };
    let unapplied = client.append_edits(request).await.unwrap().into_inner().unapplied;
    assert!(
        unapplied[0].reason.contains("no vertex") && unapplied[0].reason.contains("in the level ("),
        "{unapplied:?}"
    );
    for (coordinates, places) in [(0, on_map), (LEVEL, places)] {
        let request = plan::GetLayersRequest { graph_id: id(), coordinates };
        let layers = client.get_layers(request).await.unwrap().into_inner().layers;
        let Some(plan::edit::Edit::ForceEdge(edit)) = layers[0].edits[0].edit else { panic!("{layers:?}") };
        assert_near(edit.from, places[from]);
        assert_near(edit.to, places[to]);
    }
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_level_that_was_moved_in_its_file_is_found_at_its_new_place() {
    let (cache, server) = (tempfile::tempdir().unwrap(), start_server(ServerConfig::default()));
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let mut worlds = world_client(&server).await;
    let moved = |by: i32| {
        let corners = [(0, 0), (0, 40), (40, 40), (40, 0)].map(|(x, z)| format!("v {} 0 {z}\n", x + by)).concat();
        let file = format!("o floor\n{corners}f 1 2 3 4\n").into_bytes();
        wire::ImportMapRequest { file, scale: 1.0, up: wire::UpAxis::Y.into(), ..floor() }
    };
    let (map_hash, _) = import(&planner, moved(0)).await;
    let settings = Some(small_graph());
    let request = plan::StartBuildRequest { map_hash: map_hash.clone(), settings, ..Default::default() };
    let graph_id = build_to_end(&mut client, request).await.graph_id;
    for by in [0, 100] {
        assert_eq!(import(&server, moved(by)).await.0, map_hash, "the same map");
        assert_eq!(import(&planner, moved(by)).await.0, map_hash);
        let at = |x: f32, z: f32| Some(wire::Vec3 { x: x + by as f32, y: 0.0, z });
        let query = Some(plan::PathQuery { start: at(5.0, 5.0), goal: at(35.0, 35.0), ..Default::default() });
        let request = plan::FindPathRequest { graph_id: graph_id.clone(), query, coordinates: LEVEL };
        let plan = client.find_path(request).await.unwrap().into_inner().plan.unwrap();
        assert_near(plan.waypoints.last().copied(), at(35.0, 35.0).unwrap());
        let request = wire::CreateWorldRequest { map_hash: map_hash.clone(), ..Default::default() };
        let world_id = worlds.create_world(request).await.unwrap().into_inner().world.unwrap().world_id;
        let request =
            wire::SpawnNpcRequest { world_id, position: at(20.0, 20.0), coordinates: LEVEL, ..Default::default() };
        worlds.spawn_npc(request).await.unwrap();
    }
    planner.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_generated_map_is_its_own_level() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 1, wire::TimeMode::Realtime).await.world_id;
    let points = ground(&mut client, world_id, 5).await;
    let request = wire::SampleGroundRequest { world_id, count: 5, seed: 1, coordinates: LEVEL, ..Default::default() };
    assert_eq!(client.sample_ground(request).await.unwrap().into_inner().points, points);
    let mut features = Vec::new();
    for coordinates in [wire::Coordinates::Map as i32, LEVEL] {
        let request = wire::GetFeaturesRequest { world_id, coordinates };
        features.push(client.get_features(request).await.unwrap().into_inner());
    }
    assert_eq!(features[0], features[1]);
    server.stop().await;
}
