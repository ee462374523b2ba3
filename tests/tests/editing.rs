//! Maps that are edited while NPCs are on them, as a game client does it: plans, NPCs and restarts follow.

use e2e::stage::{Stage, level, start_planning_worker, world_of};
use e2e::{create_world, set_goal, spawn, start_planner, start_server, watch_until, world_client};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::planner::v1 as planner;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::piece::Shape;
use surefoot_server::ServerConfig;
use tonic::{Code, Status};

/// Two floors of 16 x 16 m over a void, 32 m apart: too far to leap.
fn banks() -> Vec<u8> {
    level(&[("near", [0.0, -1.0, 0.0], [16.0, 0.0, 16.0]), ("far", [48.0, -1.0, 0.0], [64.0, 0.0, 16.0])])
}

fn piece(name: &str, shape: Shape) -> wire::Piece {
    wire::Piece { name: name.to_owned(), shape: Some(shape) }
}

fn bridge(stage: &Stage) -> wire::Piece {
    let (from, to) = (Some(stage.at([15.5, 0.1, 8.0])), Some(stage.at([48.5, 0.1, 8.0])));
    piece("bridge", Shape::Plank(wire::PlankPiece { from, to, width: 4.0, thickness: 0.0 }))
}

/// From one border of the map to the other.
fn wall(stage: &Stage) -> wire::Piece {
    let foot = Some(stage.at([8.0, 0.0, 8.0]));
    piece("wall", Shape::Block(wire::BlockPiece { foot, width: 0.6, depth: 21.6, height: 11.0, yaw: 0.0 }))
}

async fn edit(stage: &mut Stage, put: Vec<wire::Piece>, remove: &[&str]) -> Result<wire::EditMapResponse, Status> {
    let remove = remove.iter().map(|&name| name.to_owned()).collect();
    let request = wire::EditMapRequest { world_id: stage.world_id, put, remove, clear: false, ..Default::default() };
    stage.client.edit_map(request).await.map(|response| response.into_inner())
}

async fn way_over_a_bridge(mode: wire::TimeMode) {
    let cache = tempfile::tempdir().unwrap();
    let server = start_server(ServerConfig::default());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let worker = start_planning_worker(&server, &planner);
    let mut stage = world_of(&server, banks(), mode).await;
    let (here, there) = (stage.at([3.0, 0.0, 3.0]), stage.at([61.0, 0.0, 13.0]));
    let npc = spawn(&mut stage.client, stage.world_id, here).await;
    set_goal(&mut stage.client, npc, there).await;
    assert_eq!(stage.end_of(1).await.0, wire::Outcome::Unreachable, "there is no way yet");

    let put = vec![bridge(&stage)];
    let edited = edit(&mut stage, put, &[]).await.unwrap();
    assert_eq!((edited.map_revision, edited.piece_count, edited.moved_npc_ids), (1, 1, Vec::new()));
    set_goal(&mut stage.client, npc, there).await;
    assert_eq!(stage.end_of(2).await.0, wire::Outcome::Reached, "over the bridge");
    set_goal(&mut stage.client, npc, here).await;
    assert_eq!(stage.end_of(3).await.0, wire::Outcome::Reached, "and back");

    // The bridge goes while the NPC is on its way to it: it says so, alive.
    set_goal(&mut stage.client, npc, there).await;
    edit(&mut stage, Vec::new(), &["bridge"]).await.unwrap();
    let (outcome, place) = stage.end_of(4).await;
    assert_eq!(outcome, wire::Outcome::Unreachable, "at {place:?}");

    // It comes back, and a wall bars the way to it.
    let put = vec![bridge(&stage), wall(&stage)];
    edit(&mut stage, put, &[]).await.unwrap();
    let corner = stage.at([3.0, 0.0, 13.0]);
    let request = wire::TeleportNpcRequest { npc_id: npc, position: Some(corner), yaw: 0.0, ..Default::default() };
    stage.client.teleport_npc(request).await.unwrap();
    set_goal(&mut stage.client, npc, there).await;
    let (outcome, place) = stage.end_of(5).await;
    assert_eq!(outcome, wire::Outcome::Unreachable, "at {place:?}");
    assert!(place.x < stage.at([7.9, 0.0, 0.0]).x, "{place:?}");

    edit(&mut stage, Vec::new(), &["wall"]).await.unwrap();
    set_goal(&mut stage.client, npc, there).await;
    assert_eq!(stage.end_of(6).await.0, wire::Outcome::Reached);
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_in_lockstep_follow_edits() {
    way_over_a_bridge(wire::TimeMode::Lockstep).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_in_realtime_follow_edits() {
    way_over_a_bridge(wire::TimeMode::Realtime).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_graph_of_an_edited_map_comes_from_that_of_the_map() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = PlannerServiceClient::connect(planner.uri.clone()).await.unwrap();
    let map = Some(wire::MapSpec {
        seed: 1000,
        size: Some(wire::MapSize { width: 100, height: 80, depth: 100 }),
        ..Default::default()
    });
    let settings = Some(planner::BuildSettings { vertices: 100, neighbours: 12, repeats: 2, ..Default::default() });
    let request = planner::StartBuildRequest { map, settings, ..Default::default() };
    let mut build = async |request: planner::StartBuildRequest| {
        let started = client.start_build(request).await?.into_inner().build.unwrap();
        let watch = planner::WatchBuildRequest { build_id: started.build_id };
        let mut stages = client.watch_build(watch).await?.into_inner();
        let mut last = planner::Build::default();
        while let Some(stage) = stages.message().await? {
            last = stage.build.unwrap();
        }
        assert_eq!(last.stage(), planner::BuildStage::Done, "{:?}", last.failure);
        Ok::<_, Status>(last)
    };
    // The graph of the plain map is built first if it has to be.
    let centre = wire::Vec3 { x: 50.0, y: 30.0, z: 50.0 };
    let block = wire::BlockPiece { foot: Some(centre), width: 10.0, depth: 10.0, height: 8.0, yaw: 0.4 };
    let pieces = vec![piece("block", Shape::Block(block))];
    let edited = build(planner::StartBuildRequest { pieces: pieces.clone(), ..request.clone() }).await.unwrap();
    let plain = build(request.clone()).await.unwrap();
    let again = build(planner::StartBuildRequest { pieces, ..request.clone() }).await.unwrap();
    assert_eq!(edited.piece_count, 1);
    assert_eq!(again.graph_id, edited.graph_id);
    assert_ne!(plain.graph_id, edited.graph_id);
    let (plain, edited) = (plain.summary.unwrap(), edited.summary.unwrap());
    assert!(edited.probes * 4 < plain.probes, "{} probes after {}", edited.probes, plain.probes);
    assert!(edited.vertices >= plain.vertices && edited.edges != plain.edges);

    let far = wire::BlockPiece { foot: Some(wire::Vec3 { x: 900.0, ..centre }), ..block };
    let pieces = vec![piece("far", Shape::Block(far))];
    let status = build(planner::StartBuildRequest { pieces, ..request }).await.unwrap_err();
    assert_eq!((status.code(), Reason::of(&status)), (Code::InvalidArgument, Some(Reason::InvalidField)));
    assert!(status.message().contains("`far` reaches out of the map"), "{}", status.message());
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_edited_world_is_told_saved_and_restored() {
    let state = tempfile::tempdir().unwrap();
    let config = || ServerConfig { state: Some(state.path().to_owned()), ..ServerConfig::default() };
    let server = start_server(config());
    let mut stage = world_of(&server, banks(), wire::TimeMode::Realtime).await;
    let here = stage.at([8.0, 0.0, 8.0]);
    let npc = spawn(&mut stage.client, stage.world_id, here).await;
    let put = vec![bridge(&stage), wall(&stage)];
    let edited = edit(&mut stage, put, &[]).await.unwrap();
    // It stood where the wall is.
    assert_eq!(edited.moved_npc_ids, [npc]);
    let told = |snapshot: &wire::WatchWorldResponse| snapshot.map_revision == edited.map_revision;
    let snapshot = watch_until(&mut stage.client, stage.world_id, told).await;
    let x = snapshot.npcs[0].position.unwrap().x;
    assert!((x - here.x).abs() > 0.5, "{x} m is in the wall");
    let world_id = stage.world_id;
    let pieces = |listed: wire::ListPiecesResponse| listed.pieces.into_iter().map(|it| it.name).collect::<Vec<_>>();
    let listed = stage
        .client
        .list_pieces(wire::ListPiecesRequest { world_id, ..Default::default() })
        .await
        .unwrap()
        .into_inner();
    assert_eq!(pieces(listed), ["bridge", "wall"]);
    let of = stage.client.get_world(wire::GetWorldRequest { world_id }).await.unwrap().into_inner().world.unwrap();
    server.stop().await;

    let server = start_server(config());
    let mut client = world_client(&server).await;
    let restored = client.get_world(wire::GetWorldRequest { world_id }).await.unwrap().into_inner().world.unwrap();
    assert_eq!((restored.piece_count, restored.map_hash), (2, of.map_hash));
    let listed =
        client.list_pieces(wire::ListPiecesRequest { world_id, ..Default::default() }).await.unwrap().into_inner();
    assert_eq!(pieces(listed), ["bridge", "wall"]);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn edits_that_cannot_be_are_refused_and_change_nothing() {
    let server = start_server(ServerConfig::default());
    let mut stage = world_of(&server, banks(), wire::TimeMode::Realtime).await;
    let inside = stage.at([8.0, 0.0, 8.0]);
    let npc = spawn(&mut stage.client, stage.world_id, inside).await;
    let block = |name: &str, foot, width, height| {
        piece(name, Shape::Block(wire::BlockPiece { foot, width, depth: width, height, yaw: 0.0 }))
    };
    // As high as the map: there is no place on top of it.
    let fill = block("fill", Some(inside), 15.9, stage.height - stage.origin.y + 0.5);
    let cases = [
        (vec![block("nameless", None, 1.0, 1.0)], vec![], Code::InvalidArgument, "piece.block.foot is missing"),
        (vec![wire::Piece::default()], vec![], Code::InvalidArgument, "piece.shape is missing"),
        (vec![block("", Some(inside), 1.0, 1.0)], vec![], Code::InvalidArgument, "1 to 64 bytes"),
        (vec![block("nan", Some(inside), f32::NAN, 1.0)], vec![], Code::InvalidArgument, "width of the piece `nan`"),
        (vec![block("two", Some(inside), 1.0, 1.0); 2], vec![], Code::InvalidArgument, "two pieces `two`"),
        (vec![fill], vec![], Code::FailedPrecondition, "finds no place"),
        (vec![], vec!["ghost"], Code::NotFound, "no piece `ghost`"),
        (vec![block("many", Some(inside), 1.0, 1.0); 1025], vec![], Code::InvalidArgument, "at most 1024"),
    ];
    for (put, remove, code, expected) in cases {
        let status = edit(&mut stage, put, &remove).await.expect_err(expected);
        assert_eq!(status.code(), code, "{}", status.message());
        assert!(status.message().contains(expected), "{expected}: {}", status.message());
    }
    let world_id = stage.world_id;
    let listed = stage
        .client
        .list_pieces(wire::ListPiecesRequest { world_id, ..Default::default() })
        .await
        .unwrap()
        .into_inner();
    assert_eq!((listed.pieces.len(), listed.map_revision), (0, 0));
    let unknown = wire::EditMapRequest { world_id: 99, ..Default::default() };
    let status = stage.client.edit_map(unknown).await.unwrap_err();
    assert_eq!(Reason::of(&status), Some(Reason::WorldNotFound));

    // Many edits at once: all of them are there in the end.
    let mut clients = Vec::new();
    for idx in 0..24 {
        let mut client = stage.client.clone();
        let foot = Some(stage.at([2.0 + (idx % 6) as f32, 0.0, 2.0]));
        let put = vec![block(&format!("block {idx}"), foot, 0.4, 0.4)];
        clients.push(tokio::spawn(async move {
            let request = wire::EditMapRequest { world_id, put, ..Default::default() };
            while let Err(status) = client.edit_map(request.clone()).await {
                assert_eq!(Reason::of(&status), Some(Reason::Busy), "{}", status.message());
            }
        }));
    }
    for client in clients {
        client.await.unwrap();
    }
    let listed = stage
        .client
        .list_pieces(wire::ListPiecesRequest { world_id, ..Default::default() })
        .await
        .unwrap()
        .into_inner();
    assert_eq!((listed.pieces.len(), listed.map_revision), (24, 24));
    let state =
        stage.client.get_npc(wire::GetNpcRequest { npc_id: npc, ..Default::default() }).await.unwrap().into_inner();
    assert_eq!(state.npc.unwrap().npc_id, npc);
    create_world(&mut stage.client, 1, wire::TimeMode::Realtime).await;
    server.stop().await;
}
