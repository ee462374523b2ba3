//! Imported levels, from their files to NPCs that follow plans on them.

use e2e::{
    build_to_end, follow_until_planned, ground, planner_client, small_graph, small_map, spawn, start_planner,
    start_planner_at, start_server, start_server_at, start_worker, until_metrics_say, watch_until, world_client,
};
use surefoot_net::levels::MapPool;
use surefoot_net::serving::{EndpointConfig, Limits};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::convert::map_spec;
use surefoot_proto::planner::v1 as plan;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use surefoot_server::ServerConfig;
use tonic::Code;
use tonic::transport::Channel;

/// The file of a map without a spec.
fn level() -> Vec<u8> {
    surefoot_levels::export_glb(&surefoot_generate::generate(&map_spec(Some(&small_map(1000))).unwrap()))
}

async fn maps(uri: &str) -> MapServiceClient<Channel> {
    let client = MapServiceClient::connect(uri.to_owned()).await.expect("the service accepts");
    client.max_decoding_message_size(64 << 20).max_encoding_message_size(64 << 20)
}

fn import(format: wire::MapFormat, file: Vec<u8>) -> wire::ImportMapRequest {
    wire::ImportMapRequest { name: "arena.glb".to_owned(), format: format.into(), file, ..Default::default() }
}

/// A kept map as a file.
async fn download(client: &mut MapServiceClient<Channel>, map_hash: &str) -> Vec<u8> {
    let request = wire::GetMapRequest { map_hash: map_hash.to_owned() };
    let mut messages = client.get_map(request).await.unwrap().into_inner();
    let first = messages.message().await.unwrap().unwrap();
    let (map, file_bytes, mut file) = (first.map.unwrap(), first.file_bytes, first.chunk);
    assert_eq!(map.map_hash, map_hash);
    while let Some(wire::GetMapResponse { chunk, .. }) = messages.message().await.unwrap() {
        assert!(chunk.len() <= 1 << 20);
        file.extend(chunk);
    }
    assert_eq!(file.len() as u64, file_bytes);
    file
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_follow_plans_on_an_imported_level_also_after_a_restart() {
    let (cache, state) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let config = ServerConfig { state: Some(state.path().to_owned()), ..ServerConfig::default() };
    let server = start_server(config.clone());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let kept = maps(&server.uri).await.import_map(import(wire::MapFormat::Gltf, level())).await.unwrap();
    let map_hash = kept.into_inner().map.unwrap().map_hash;
    let mut client = world_client(&server).await;
    let request = wire::CreateWorldRequest { map_hash: map_hash.clone(), ..Default::default() };
    let world = client.create_world(request).await.unwrap().into_inner().world.unwrap();
    assert_eq!((&world.map, &world.map_hash), (&None, &map_hash));
    let points = ground(&mut client, world.world_id, 2).await;
    let npc_id = spawn(&mut client, world.world_id, points[0]).await;
    server.stop().await;

    // The level was not imported into the planner: the worker forwards it.
    let server = start_server(config);
    let worker = start_worker(&server, Some(&planner), 8);
    let mut client = world_client(&server).await;
    let mut steps = client
        .follow_npc(wire::FollowNpcRequest { npc_id, rate_hz: 60.0, rays: false, ..Default::default() })
        .await
        .unwrap()
        .into_inner();
    follow_until_planned(&mut client, &mut steps, npc_id, [points[0], points[1]]).await;
    watch_until(&mut client, world.world_id, |snapshot| snapshot.npcs.iter().all(|npc| npc.last_outcome != 0)).await;
    let handed_on =
        maps(&planner.uri).await.list_maps(wire::ListMapsRequest::default()).await.unwrap().into_inner().maps;
    assert_eq!(handed_on.len(), 1);
    assert_eq!((&handed_on[0].map_hash, handed_on[0].name.as_str()), (&map_hash, "arena.glb"));
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_place_of_the_map_that_is_marked_in_the_sidecar_is_there_in_the_next_import() {
    let server = start_server(ServerConfig::default());
    let mut maps = maps(&server.uri).await;
    // In centimetres, z up, and off its origin.
    let corners = [(500, 700), (4500, 700), (4500, 3700), (500, 3700)];
    let corners: String = corners.iter().map(|(x, y)| format!("v {x} {y} 900\n")).collect();
    let file = format!("o floor\n{corners}f 1 2 3 4\n").into_bytes();
    let request = |sidecar: String| wire::ImportMapRequest {
        name: "court.obj".to_owned(),
        format: wire::MapFormat::Obj.into(),
        file: file.clone(),
        sidecar,
        scale: 0.01,
        up: wire::UpAxis::Z.into(),
        ..Default::default()
    };
    let first = maps.import_map(request(String::new())).await.unwrap().into_inner();
    let origin = first.origin.unwrap();
    let marked = wire::Vec3d { x: 20.0, y: 1.0, z: 12.0 };
    // As ImportMapResponse.origin says, and back to the level's axes and unit.
    let at = [marked.x - origin.x, -(marked.z - origin.z), marked.y - origin.y].map(|metres| metres / 0.01);
    let second = maps.import_map(request(format!("{{\"pads\": [{{\"at\": {at:?}}}]}}"))).await.unwrap().into_inner();
    let mut client = world_client(&server).await;
    let map_hash = second.map.unwrap().map_hash;
    let request = wire::CreateWorldRequest { map_hash: map_hash.clone(), ..Default::default() };
    let world_id = client.create_world(request).await.unwrap().into_inner().world.unwrap().world_id;
    let features =
        client.get_features(wire::GetFeaturesRequest { world_id, ..Default::default() }).await.unwrap().into_inner();
    let pad = features.pads[0].centre.unwrap();
    let misses = [f64::from(pad.x) - marked.x, f64::from(pad.y) - marked.y, f64::from(pad.z) - marked.z];
    assert!(misses.iter().all(|miss| miss.abs() < 0.01), "{pad:?}");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_survey_tells_bodies_apart_and_knows_what_they_cannot_get_to() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    // A floor, and a deck beside it, 3 m higher: too high for a body of the heavy kind, within two jumps of the usual
    // one.
    let quad = |x: i32, z: i32, y: i32, side: i32| {
        let corners = [(x, z), (x, z + side), (x + side, z + side), (x + side, z)];
        corners.iter().map(|(x, z)| format!("v {x} {y} {z}\n")).collect::<String>()
    };
    let file = format!("{}{}f 1 2 3 4\nf 5 6 7 8\n", quad(0, 0, 0, 40), quad(41, 10, 3, 10)).into_bytes();
    let request = wire::ImportMapRequest {
        name: "deck.obj".to_owned(),
        format: wire::MapFormat::Obj.into(),
        file,
        ..Default::default()
    };
    let map_hash = maps(&server.uri).await.import_map(request).await.unwrap().into_inner().map.unwrap().map_hash;
    let body = |preset: &str| wire::Body { preset: preset.to_owned(), ..Default::default() };
    let request = wire::SurveyMapRequest {
        map_hash,
        bodies: vec![body("surefoot"), body("heavy")],
        max_cut_off: 10,
        ..Default::default()
    };
    let surveys = client.survey_map(request.clone()).await.unwrap().into_inner().surveys;
    let [usual, heavy] = &surveys[..] else { panic!("{surveys:?}") };
    assert!(usual.islands == 2 && usual.connected > 0.99 && usual.cut_off.is_empty(), "{usual:?}");
    assert!(heavy.connected < 0.95 && heavy.cut_off_places > 20 && heavy.cut_off.len() == 10, "{heavy:?}");
    assert!(heavy.cut_off.iter().all(|place| place.y > 3.0), "{:?}", heavy.cut_off);
    let nine = wire::SurveyMapRequest { bodies: vec![body("small"); 9], ..request.clone() };
    let giraffe = wire::SurveyMapRequest { bodies: vec![body("giraffe")], ..request.clone() };
    let nowhere = wire::SurveyMapRequest { map_hash: "0".repeat(64), ..request };
    let refusals = [(nine, "number of bodies"), (giraffe, "body.preset"), (nowhere, "ImportMap")];
    for (request, words) in refusals {
        let status = client.survey_map(request).await.unwrap_err();
        assert!(status.message().contains(words), "{status:?}");
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn edits_of_a_level_outlive_its_changes() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let mut graphs = Vec::new();
    for seed in [7, 8] {
        // Two versions of a level are two maps of one name.
        let map = surefoot_generate::generate(&map_spec(Some(&small_map(seed))).unwrap());
        let request = import(wire::MapFormat::Saved, surefoot_levels::encode(&map));
        let kept = maps(&planner.uri).await.import_map(request).await;
        let map_hash = kept.unwrap().into_inner().map.unwrap().map_hash;
        let request = plan::StartBuildRequest { map_hash, settings: Some(small_graph()), ..Default::default() };
        let build = build_to_end(&mut client, request).await;
        let last = (build.graph_id, build.summary.unwrap());
        if graphs.is_empty() {
            let at = Some(wire::Vec3 { x: 50.0, y: 0.0, z: 50.0 });
            let edit = plan::edit::Edit::RemoveVertex(plan::VertexEdit { at });
            let layer = plan::Layer { name: "night".to_owned(), edits: vec![plan::Edit { edit: Some(edit) }] };
            let request = plan::PutLayerRequest { graph_id: last.0.clone(), layer: Some(layer), ..Default::default() };
            client.put_layer(request).await.unwrap();
        }
        graphs.push(last);
    }
    assert_ne!(graphs[0].0, graphs[1].0);
    assert_eq!((graphs[0].1.edits, graphs[1].1.edits), (0, 1), "the second version has the first one's edit");

    // What is lost from one version to the other is gained in the other direction.
    let listed = client.list_graphs(plan::ListGraphsRequest::default()).await.unwrap().into_inner().graphs;
    assert!(listed.iter().map(|graph| &graph.graph_id).eq([&graphs[1].0, &graphs[0].0]));
    assert!(listed.iter().all(|graph| graph.map.is_none() && !graph.level.is_empty()));
    let mut compared = Vec::new();
    for (before, after) in [(&graphs[0], &graphs[1]), (&graphs[1], &graphs[0])] {
        let request =
            plan::CompareGraphsRequest { before: before.0.clone(), after: after.0.clone(), ..Default::default() };
        compared.push(client.compare_graphs(request).await.unwrap().into_inner());
    }
    let [there, back] = compared.try_into().unwrap();
    assert!(!there.lost.is_empty() || !there.gained.is_empty(), "the two versions are different maps");
    assert_eq!((&there.lost, &there.gained), (&back.gained, &back.lost));
    assert_eq!((there.islands_before, there.islands_after), (back.islands_after, back.islands_before));
    assert_eq!(there.connected_after, back.connected_before);
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn levels_that_cannot_be_used_are_refused_and_kept_ones_stay() {
    let cache = tempfile::tempdir().unwrap();
    let limits = Limits { max_import_bytes: 4 << 20, ..Limits::default() };
    let endpoint = EndpointConfig { limits, ..EndpointConfig::default() };
    let config = PlannerConfig { max_maps: 1, ..PlannerConfig::default() };
    let planner = start_planner_at(endpoint, cache.path(), config);
    let mut client = maps(&planner.uri).await;
    let file = level();
    let kept = client.import_map(import(wire::MapFormat::Gltf, file.clone())).await.unwrap().into_inner().map.unwrap();
    let again = client.import_map(import(wire::MapFormat::Gltf, file.clone())).await.unwrap().into_inner().map.unwrap();
    assert_eq!(kept, again, "the same level is kept once");
    let cut_off = file[..file.len() / 2].to_vec();
    let nameless = wire::ImportMapRequest { name: String::new(), ..import(wire::MapFormat::Gltf, file.clone()) };
    for (request, code, words) in [
        (import(wire::MapFormat::Gltf, cut_off), Code::InvalidArgument, ""),
        (import(wire::MapFormat::Saved, file.clone()), Code::InvalidArgument, "saved map"),
        (import(wire::MapFormat::Obj, b"not a level".to_vec()), Code::InvalidArgument, ""),
        (import(wire::MapFormat::Unspecified, file.clone()), Code::InvalidArgument, "format is not set"),
        (nameless, Code::InvalidArgument, "name"),
        (import(wire::MapFormat::Saved, vec![0; 5 << 20]), Code::OutOfRange, "4194304"),
    ] {
        let refusal = client.import_map(request).await.unwrap_err();
        assert!(refusal.code() == code && refusal.message().contains(words), "{refusal}");
    }
    let back = download(&mut client, &kept.map_hash).await;
    assert_eq!(surefoot_levels::decode(&back).unwrap().hash().to_hex(), kept.map_hash);
    let unknown = client.get_map(wire::GetMapRequest { map_hash: "0".repeat(64) }).await.unwrap_err();
    assert!(unknown.code() == Code::NotFound && unknown.message().contains("ImportMap"), "{unknown}");

    let mut graphs = planner_client(&planner).await;
    let both =
        plan::StartBuildRequest { map: Some(small_map(1)), map_hash: kept.map_hash.clone(), ..Default::default() };
    assert!(graphs.start_build(both).await.unwrap_err().message().contains("both set"));
    let neither = plan::StartBuildRequest::default();
    assert!(graphs.start_build(neither).await.unwrap_err().message().contains("map is missing"));

    // There is room for one map. No world uses the first, so it is evicted.
    let other = surefoot_levels::encode(&surefoot_generate::generate(&map_spec(Some(&small_map(3))).unwrap()));
    client.import_map(import(wire::MapFormat::Saved, other)).await.unwrap();
    assert_eq!(client.list_maps(wire::ListMapsRequest::default()).await.unwrap().into_inner().maps.len(), 1);
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn levels_are_imported_in_their_unit_with_their_axis_and_with_their_sides() {
    let server = start_server(ServerConfig::default());
    let mut client = maps(&server.uri).await;
    // A floor of 2000 x 1000 x 50 units with z up, all of its faces turned in.
    let corner = |idx: u32| {
        let at = |bit: u32, far: u32| if idx >> bit & 1 == 0 { 0 } else { far };
        format!("v {} {} {}\n", at(0, 2000), at(1, 1000), at(2, 50))
    };
    let corners: String = (0..8).map(corner).collect();
    let faces = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n";
    let mut take = async |scale: f32, up: wire::UpAxis, keep_sides: bool| {
        let file = format!("o floor\n{corners}{faces}").into_bytes();
        let request = wire::ImportMapRequest {
            name: format!("floor {scale} {up:?} {keep_sides}"),
            scale,
            up: up.into(),
            keep_sides,
            ..import(wire::MapFormat::Obj, file)
        };
        client.import_map(request).await.map(|response| response.into_inner())
    };
    let turned = take(0.02, wire::UpAxis::Z, false).await.unwrap();
    let size = turned.map.unwrap().size.unwrap();
    assert_eq!((size.width, size.height, size.depth), (44, 22, 24));
    assert_eq!(turned.geometry.unwrap().turned_shells, 1);
    let [node] = &turned.nodes[..] else { panic!("one node, not {:?}", turned.nodes) };
    assert_eq!((node.name.as_str(), node.role(), node.triangles), ("floor", wire::NodeRole::Solid, 12));
    assert_eq!(node.high, Some(wire::Vec3d { x: 2000.0, y: 1000.0, z: 50.0 }), "in the level's own coordinates");
    let kept = take(0.02, wire::UpAxis::Z, true).await.unwrap();
    assert_eq!((kept.warnings, kept.geometry.unwrap().turned_shells), (Vec::new(), 0));
    let lying = take(0.02, wire::UpAxis::Y, false).await.unwrap().map.unwrap().size.unwrap();
    assert_eq!((lying.height, lying.depth), (41, 5));
    let small = take(0.001, wire::UpAxis::Z, false).await.unwrap().warnings;
    assert!(small.iter().any(|warning| warning.contains("did you mean a scale of 0.01")), "{small:?}");
    for scale in [-1.0, f32::NAN] {
        let refusal = take(scale, wire::UpAxis::Z, false).await.unwrap_err();
        assert!(refusal.message().contains("scale"), "{refusal}");
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_level_larger_than_a_message_arrives_in_chunks_and_leaves_in_chunks() {
    let limits = Limits { max_import_bytes: 64 << 10, ..Limits::default() };
    let server = start_server_at(EndpointConfig { limits, ..EndpointConfig::default() }, ServerConfig::default());
    let mut client = maps(&server.uri).await;
    let map = surefoot_generate::generate(&map_spec(Some(&small_map(1000))).unwrap());
    let file = surefoot_levels::encode(&map);
    assert!(file.len() > 4 * limits.max_import_bytes, "{} bytes", file.len());
    let too_large = client.import_map(import(wire::MapFormat::Saved, file.clone())).await.unwrap_err();
    assert_eq!(too_large.code(), Code::OutOfRange);
    let part = |offset: usize, data: &[u8]| wire::UploadChunkRequest {
        upload_id: "level".to_owned(),
        offset: offset as u64,
        data: data.to_vec(),
    };
    let mut sent = 0;
    for chunk in file.chunks(limits.max_import_bytes / 2) {
        // A client that got no answer sends the part again.
        for _ in 0..2 {
            let received = client.upload_chunk(part(sent, chunk)).await.unwrap().into_inner().received;
            assert_eq!(received as usize, sent + chunk.len());
        }
        sent += chunk.len();
    }
    let gap = client.upload_chunk(part(sent + 1, b"x")).await.unwrap_err();
    assert!(gap.code() == Code::OutOfRange && gap.message().contains(&sent.to_string()), "{gap}");
    let whole = wire::ImportMapRequest { upload_id: "level".to_owned(), ..import(wire::MapFormat::Saved, Vec::new()) };
    let kept = client.import_map(whole.clone()).await.unwrap().into_inner().map.unwrap();
    assert_eq!(kept.map_hash, map.hash().to_hex());
    assert_eq!(download(&mut client, &kept.map_hash).await, file);
    let again = client.import_map(whole).await.unwrap_err();
    assert!(again.code() == Code::NotFound && again.message().contains("level"), "an upload is imported once: {again}");
    let begin = |number: u32| wire::UploadChunkRequest { upload_id: format!("{number}"), ..part(0, b"x") };
    for number in 0..4 {
        client.upload_chunk(begin(number)).await.unwrap();
    }
    let fifth = client.upload_chunk(begin(4)).await.unwrap_err();
    assert_eq!((fifth.code(), Reason::of(&fifth)), (Code::ResourceExhausted, Some(Reason::TooManyUploads)));
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn imported_and_generated_maps_of_a_planner_share_one_budget() {
    let cache = tempfile::tempdir().unwrap();
    let pool = MapPool::within(2_000_000_000);
    let planner = start_planner(cache.path(), PlannerConfig { maps: pool.clone(), ..PlannerConfig::default() });
    let mut client = maps(&planner.uri).await;
    let held = pool.memory().reserve("worlds", 1_999_000_000).unwrap();
    let refused = client.import_map(import(wire::MapFormat::Gltf, level())).await.unwrap_err();
    assert_eq!(Reason::of(&refused), Some(Reason::OutOfMemory));
    assert!(refused.message().contains("worlds: 1999 MB"), "{refused}");
    drop(held);
    client.import_map(import(wire::MapFormat::Gltf, level())).await.unwrap();
    assert!(pool.memory().used_bytes() > 0);
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_survives_a_refusal_for_lack_of_memory() {
    let server = start_server(ServerConfig { maps: MapPool::within(40_000_000), ..ServerConfig::default() });
    let (mut client, mut worlds) = (maps(&server.uri).await, world_client(&server).await);
    // Reading a file takes eight times its length.
    let mut file = b"o floor\nv 0 0 0\nv 0 0 40\nv 40 0 40\nv 40 0 0\nf 1 2 3 4\n".to_vec();
    file.resize(2_000_000, b'\n');
    let upload_id = "level".to_owned();
    let part = wire::UploadChunkRequest { upload_id: upload_id.clone(), offset: 0, data: file };
    client.upload_chunk(part).await.unwrap();
    let whole = wire::ImportMapRequest { upload_id, ..import(wire::MapFormat::Obj, Vec::new()) };
    let mut ids = Vec::new();
    for seed in 0.. {
        let request = wire::CreateWorldRequest { map: Some(small_map(seed)), ..Default::default() };
        match worlds.create_world(request).await {
            Ok(world) => ids.push(world.into_inner().world.unwrap().world_id),
            Err(_) => break,
        }
    }
    for _ in 0..2 {
        let refused = client.import_map(whole.clone()).await.unwrap_err();
        assert_eq!(Reason::of(&refused), Some(Reason::OutOfMemory), "{refused}");
    }
    for world_id in ids {
        worlds.drop_world(wire::DropWorldRequest { world_id }).await.unwrap();
    }
    until_metrics_say(&server, "surefoot_memory_budget_bytes 2500000").await;
    client.import_map(whole).await.expect("the upload is still there");
    server.stop().await;
}
