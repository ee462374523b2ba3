//! One trial for each decoder: decodes bytes to a checked value, encodes and decodes it again.
//!
//! The fuzz targets call these functions, and so do the tests in `tests/tests/untrusted.rs`, which include this file. A
//! trial accepts any bytes. The decoder must return a value or an error with a message. A panic is a bug, and so is a
//! value that changes when it is encoded and decoded again. Checksums are no obstacle: bytes after a checksum are also
//! tried with the correct one before them.

use prost::Message;
use serde_json::{Value, json};
use std::fmt::Display;
use std::sync::{Arc, LazyLock};
use surefoot_exchange::{from_safetensors, to_safetensors};
use surefoot_levels::{ImportError, ImportOptions, Imported, NoFiles};
use surefoot_planner::EdgeCosts;
use surefoot_planner::edits::Layer;
use surefoot_planner::export::{Format, export, import_json};
use surefoot_planner::search::many::SharedEnd;
use surefoot_planner::{Built, EdgeKey, NavGraph, Query, Router, Traffic, store as cache};
use surefoot_planner_service::{PlannerConfig, edits_from_wire, layer_from_wire, layer_to_wire, settings_from_wire};
use surefoot_policy::{ActorConfig, Batch, Manifest, Policy, Scratch};
use surefoot_proto::plans;
use surefoot_proto::{convert, planner::v1 as plan, world::v1 as wire};
use surefoot_server::hosted::{HostedWorld, NpcStatus, SavedMap, TimeMode, WorldSave};
use surefoot_server::ids::WorkerId;
use surefoot_server::messages::{Answer, Decision, Hello, ToWorker};
use surefoot_server::quota::Quota;
use surefoot_server::registry::Registry;
use surefoot_server::{NpcId, WorldId, worker};
use surefoot_world::character::MoveScratch;
use surefoot_world::map::{MapSize, Outline, Placed, Pool, Spot};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::replay::Recording;
use surefoot_world::{Action, Body, CharacterProfile, Decisions, Map, MapSpec, Seconds, TICKS_PER_DECISION, Vec3};
use tokio::sync::mpsc;

/// A trial of one decoder.
pub type Trial = fn(&[u8]);

/// All trials by name. The corpus of each is in `tools/fuzz/corpus/NAME`.
pub const TRIALS: [(&str, Trial); 13] = [
    ("world_messages", world_messages),
    ("planner_messages", planner_messages),
    ("map_file", map_file),
    ("gltf", gltf),
    ("meshopt", meshopt),
    ("draco", draco),
    ("obj", obj),
    ("recording", recording),
    ("checkpoint", checkpoint),
    ("cache_entry", cache_entry),
    ("graph_json", graph_json),
    ("saved_world", saved_world),
    ("body", body),
];

/// Largest volume of a map that is tried, m3: larger ones are allowed but only slow the trial down.
const MAX_VOLUME_M3: u64 = 200_000;
/// Longest recording that is replayed, in ticks.
const MAX_TICKS: u64 = 3000;
/// Id of the first NPC of the world in [`answer`].
pub const FIRST_NPC: u64 = 1 << 28 | 1;
/// Sizes of the network that weights are loaded into.
pub const NETWORK: ActorConfig =
    ActorConfig { ray_features: 1, hidden: 2, memory: Some(std::num::NonZeroUsize::MIN), sees_others: false };

/// The value, or `None` if the decoder rejected the bytes.
///
/// # Panics
/// If the error has no message.
fn accepted<T, E: Display>(result: Result<T, E>) -> Option<T> {
    result.map_err(|error| assert!(!error.to_string().is_empty(), "an error without a message")).ok()
}

/// Decodes a message and checks that it is unchanged after encoding and decoding.
fn message<M: Message + Default>(bytes: &[u8]) -> Option<M> {
    let message = accepted(M::decode(bytes))?;
    let again = M::decode(message.encode_to_vec().as_slice()).expect("just written");
    assert_eq!(again.encode_to_vec(), message.encode_to_vec());
    Some(message)
}

/// A floor of 20 m x 20 m with a pool, for worlds and replays.
pub static FLOOR: LazyLock<Arc<Map>> = LazyLock::new(|| {
    let [a, b, c, d] = [[0.0, 0.0], [0.0, 20.0], [20.0, 20.0], [20.0, 0.0]].map(|[x, z]| Vec3::new(x, 1.0, z));
    let triangles = [[a, b, c], [a, c, d]].into_iter().filter_map(|t| Triangle::new(t, Surface::Ground)).collect();
    let pool = Pool {
        centre: Vec3::new(4.0, 1.0, 4.0),
        outline: Outline::Round { radius: 2.0 },
        depth: 0.5,
        liquid: surefoot_world::map::Liquid::Water,
    };
    let placed = Placed { pools: vec![pool], ..Placed::default() };
    Arc::new(Map::from_parts(MapSize { width: 20, height: 10, depth: 20 }, triangles, placed))
});

/// Requests to a world server, and messages to a worker.
pub fn world_messages(bytes: &[u8]) {
    if let Some(request) = message::<wire::CreateWorldRequest>(bytes)
        && let Some(spec) = accepted(convert::map_spec(request.map.as_ref()))
    {
        assert_eq!(convert::map_spec(Some(&convert::map_spec_to_wire(&spec))), Ok(spec));
    }
    if let Some(request) = message::<wire::SpawnNpcRequest>(bytes) {
        let _ = accepted(convert::point(request.position.as_ref(), "position"));
    }
    if let Some(request) = message::<wire::SetGoalRequest>(bytes) {
        let _ = accepted(convert::point(request.goal.as_ref(), "goal"));
    }
    if let Some(request) = message::<wire::WatchWorldRequest>(bytes) {
        let _ = accepted(convert::in_range(f64::from(request.rate_hz), 0.0, 60.0, "rate_hz"));
    }
    if let Some(request) = message::<wire::WorkRequest>(bytes) {
        let _ = accepted(worker::hello(Some(request.clone())));
        if let Some(wire::work_request::Message::Actions(batch)) = request.message {
            answer(&batch);
        }
    }
    if let Some(wire::WorkResponse { message: Some(wire::work_response::Message::Observations(batch)) }) =
        message(bytes)
    {
        let count = batch.npc_ids.len();
        let _ = accepted(convert::unpack(&batch.observations, count * surefoot_world::OBSERVATION_LEN, "observations"));
        let _ = accepted(convert::unpack(&batch.positions, count * 3, "positions"));
    }
}

/// A lockstep world with three NPCs that seek goals: one worker has the first two, another the third. Messages to the
/// workers wait in the queues.
fn lockstep_world() -> (HostedWorld, Vec<mpsc::Receiver<ToWorker>>) {
    let (registry, quota) = (Arc::new(Registry::default()), Quota::new(3, "NPCs"));
    let mut world = HostedWorld::new(WorldId(1), FLOOR.clone(), TimeMode::Lockstep, registry.clone());
    let mut queues = Vec::new();
    for capacity in [2, 1] {
        let (queue, reader) = mpsc::channel(64);
        queues.push(reader);
        registry.join(Hello::new("", "", capacity), queue);
        for _ in 0..capacity {
            let id = world.spawn(Vec3::new(10.0, 1.0, 10.0), 0.0, 3, quota.grant("fuzz")).expect("a place on the map");
            world.set_goal(id, Vec3::new(18.0, 1.0, 18.0)).expect("a place on the map");
        }
    }
    assert!(!world.is_ready() && world.counters().asked == 3, "decisions of all three are requested");
    (world, queues)
}

/// Checks an answer of the first worker and applies it if it is valid; returns whether it is. In either case the second
/// worker's NPC must continue. NPCs are numbered from [`FIRST_NPC`], and the third is the second worker's.
pub fn answer(batch: &wire::ActionBatch) -> bool {
    let Some(checked) = accepted(worker::answer(batch.clone())) else { return false };
    assert_eq!(checked.decisions.len(), batch.npc_ids.len());
    let (mut world, _queues) = lockstep_world();
    world.answer(WorkerId(1), checked);
    let other = NpcId(FIRST_NPC + 2);
    let action = Some(surefoot_world::Action { forward: 1.0, ..Default::default() });
    let own = Decision { npc: other, attempt: 1, action, standing: None };
    world.answer(WorkerId(2), Answer { decisions: vec![own], ..Default::default() });
    let before = world.npc(other).expect("it was spawned");
    for _ in 0..10 {
        world.step();
    }
    let after = world.npc(other).expect("it is still there");
    assert_eq!(after.status, NpcStatus::Seeking);
    assert_ne!(before.position, after.position, "it walks by its own worker's action");
    for npc in world.snapshot().npcs {
        assert!(npc.position.is_finite() && npc.velocity.is_finite());
    }
    true
}

/// Requests to a planner, and its responses.
pub fn planner_messages(bytes: &[u8]) {
    if let Some(request) = message::<plan::StartBuildRequest>(bytes) {
        let _ = accepted(convert::map_spec(request.map.as_ref()));
        if let Some(settings) = accepted(settings_from_wire(request.settings.as_ref(), &PlannerConfig::default())) {
            let back = plans::settings_to_wire(&settings);
            let again = settings_from_wire(Some(&back), &PlannerConfig::default());
            assert_eq!(plans::settings_to_wire(&again.expect("just written")), back);
        }
    }
    if let Some(request) = message::<plan::FindPathsRequest>(bytes) {
        for query in &request.queries {
            let Some(query) = accepted(plans::query(query)) else { continue };
            assert_eq!(plans::query(&plans::query_to_wire(&query)), Ok(query));
        }
    }
    if let Some(plan) = message::<plan::FindPathResponse>(bytes).and_then(|response| response.plan)
        && let Some(plan) = accepted(plans::plan(&plan))
    {
        assert_eq!(plan.waypoints.len(), plan.legs.len());
        let again = plans::plan(&plans::plan_to_wire(&plan)).expect("just written");
        assert_eq!(format!("{again:?}"), format!("{plan:?}"));
    }
    if let Some(request) = message::<plan::ReportTraversalsRequest>(bytes) {
        for traversal in &request.traversals {
            let _ = accepted(plans::traversal(traversal));
        }
    }
    if let Some(request) = message::<plan::PutLayerRequest>(bytes)
        && let Some(layer) = accepted(layer_from_wire(request.layer.as_ref()))
    {
        layer_round_trips(&layer);
    }
    if let Some(request) = message::<plan::AppendEditsRequest>(bytes)
        && let Some(edits) = accepted(edits_from_wire(&request.edits))
    {
        layer_round_trips(&Layer { name: request.layer, edits });
    }
}

fn layer_round_trips(layer: &Layer) {
    if accepted(layer.validate()).is_some() {
        assert_eq!(layer_from_wire(Some(&layer_to_wire(layer))).expect("just written"), *layer);
        assert_eq!(cache::decode_layer(&cache::encode_layer(layer)).expect("just written"), *layer);
    }
}

/// Saved maps.
pub fn map_file(bytes: &[u8]) {
    const CHECKSUM_AT: usize = 8 + 4 + 8;
    const HEADER_LEN: usize = CHECKSUM_AT + 32;
    let decode = |bytes: &[u8]| {
        if let Some(map) = accepted(surefoot_levels::decode(bytes)) {
            map_round_trips(&map);
        }
    };
    decode(bytes);
    let Some((header, payload)) = bytes.split_at_checked(HEADER_LEN) else { return };
    let description = payload.get(36..).unwrap_or_default();
    let size = postcard::take_from_bytes::<(Option<MapSpec>, MapSize)>(description);
    if size.is_ok_and(|((_, size), _)| volume(size) > MAX_VOLUME_M3) {
        return;
    }
    let mut sealed = header.to_vec();
    sealed[12..CHECKSUM_AT].copy_from_slice(&(payload.len() as u64).to_le_bytes());
    sealed[CHECKSUM_AT..].copy_from_slice(blake3::hash(payload).as_bytes());
    sealed.extend(payload);
    decode(&sealed);
}

fn volume(MapSize { width, height, depth }: MapSize) -> u64 {
    [width, height, depth].into_iter().map(u64::from).fold(1, u64::saturating_mul)
}

fn map_round_trips(map: &Map) {
    let again = surefoot_levels::decode(&surefoot_levels::encode(map)).expect("just written");
    assert_eq!(again.hash(), map.hash());
    assert_eq!((again.spec(), again.size(), again.placed()), (map.spec(), map.size(), map.placed()));
}

/// Levels as glTF, and sidecars.
pub fn gltf(bytes: &[u8]) {
    import_gltf(bytes, None);
    if let Ok(sidecar) = std::str::from_utf8(bytes) {
        static LEVEL: LazyLock<Vec<u8>> = LazyLock::new(|| surefoot_levels::export_glb(&FLOOR));
        import_gltf(&LEVEL, Some(sidecar));
    }
}

fn import_gltf(bytes: &[u8], sidecar: Option<&str>) {
    import_round_trips(surefoot_levels::import_gltf(bytes, sidecar, &ImportOptions::default(), &NoFiles));
}

/// Positions or indices that meshoptimizer compressed. Five bytes before them give the mode, the filter, half the
/// length of an element and, in two bytes, the number of elements.
pub fn meshopt(bytes: &[u8]) {
    let Some((&[mode, filter, half_stride, low, high], stream)) = bytes.split_first_chunk() else { return };
    let mode = ["ATTRIBUTES", "TRIANGLES", "INDICES"][usize::from(mode % 3)];
    let filter = ["NONE", "EXPONENTIAL", "QUATERNION"][usize::from(filter % 3)];
    let (stride, count) = (2 * usize::from(half_stride), u16::from_le_bytes([low, high]));
    let (primitive, component, shape, step) = match (mode, filter) {
        // Rotations are 16-bit numbers, four of them.
        ("ATTRIBUTES", "QUATERNION") => (json!({ "attributes": { "POSITION": 0 } }), 5122, "VEC3", Some(stride)),
        ("ATTRIBUTES", _) => (json!({ "attributes": { "POSITION": 0 } }), 5126, "VEC3", Some(stride)),
        _ => {
            let component = if stride == 2 { 5123 } else { 5125 };
            (json!({ "attributes": { "POSITION": 1 }, "indices": 0 }), component, "SCALAR", None)
        }
    };
    let how = json!({
        "buffer": 0, "byteLength": stream.len(), "byteStride": stride, "count": count, "mode": mode, "filter": filter
    });
    let grid = (0..36).flat_map(|at| [2.0 * (at % 6) as f32, 0.0, 2.0 * (at / 6) as f32]);
    let binary: Vec<u8> = stream.iter().copied().chain(grid.flat_map(f32::to_le_bytes)).collect();
    let document = json!({
        "meshes": [{ "primitives": [primitive] }],
        "accessors": [
            { "bufferView": 0, "componentType": component, "count": count, "type": shape },
            { "bufferView": 1, "componentType": 5126, "count": 36, "type": "VEC3" },
        ],
        "bufferViews": [
            {
                "buffer": 1,
                "byteLength": stride * usize::from(count),
                "byteStride": step,
                "extensions": { "KHR_meshopt_compression": how },
            },
            { "buffer": 0, "byteOffset": stream.len(), "byteLength": binary.len() - stream.len() },
        ],
        "buffers": [{ "byteLength": binary.len() }, { "byteLength": 0 }],
    });
    import_gltf(&glb(document, &binary), None);
}

/// Meshes that Draco compressed, with positions as their first attribute.
pub fn draco(bytes: &[u8]) {
    let extensions = json!({ "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": { "POSITION": 0 } } });
    let document = json!({
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "extensions": extensions }] }],
        "accessors": [{ "componentType": 5126, "count": 36, "type": "VEC3" }],
        "bufferViews": [{ "buffer": 0, "byteLength": bytes.len() }],
        "buffers": [{ "byteLength": bytes.len() }]
    });
    import_gltf(&glb(document, bytes), None);
}

/// A container of a document with one node, and of its binary buffer.
fn glb(mut document: Value, binary: &[u8]) -> Vec<u8> {
    document["asset"] = json!({ "version": "2.0" });
    document["nodes"] = json!([{ "mesh": 0 }]);
    let chunk = |kind: &[u8; 4], content: &[u8]| [&(content.len() as u32).to_le_bytes()[..], kind, content].concat();
    let content = [chunk(b"JSON", document.to_string().as_bytes()), chunk(b"BIN\0", binary)].concat();
    [&b"glTF"[..], &2_u32.to_le_bytes(), &(12 + content.len() as u32).to_le_bytes(), content.as_slice()].concat()
}

/// Levels as OBJ, with y up in metres and with other options.
pub fn obj(bytes: &[u8]) {
    import_round_trips(surefoot_levels::import_obj(bytes, None, &ImportOptions::default()));
    let options = ImportOptions { scale: 0.01, up: surefoot_levels::UpAxis::Z, ..ImportOptions::default() };
    import_round_trips(surefoot_levels::import_obj(bytes, None, &options));
}

fn import_round_trips(result: Result<Imported, ImportError>) {
    let Some(Imported { map, warnings, .. }) = accepted(result) else { return };
    assert!(warnings.iter().all(|warning| !warning.to_string().is_empty()));
    if volume(map.size()) <= MAX_VOLUME_M3 {
        map_round_trips(&map);
    }
}

/// Recordings, decoded and replayed.
pub fn recording(bytes: &[u8]) {
    const HEADER_LEN: usize = 8 + 4 + 32;
    let decode = |bytes: &[u8]| {
        let Some(recording) = accepted(Recording::decode(bytes)) else { return };
        let again = Recording::decode(&recording.encode()).expect("just written");
        assert_eq!(again.encode(), recording.encode());
        if recording.tick_count() <= MAX_TICKS {
            let _ = accepted(recording.replay(FLOOR.clone(), None));
        }
    };
    decode(bytes);
    let Some((header, content)) = bytes.split_at_checked(HEADER_LEN) else { return };
    let mut content = content.to_vec();
    // The content begins with the hash of the map.
    if let Some(hash) = content.first_chunk_mut::<32>() {
        *hash = FLOOR.hash().0;
    }
    decode(&[&header[..12], blake3::hash(&content).as_bytes(), &content].concat());
}

/// Weights as safetensors and as burnpack, and manifests.
pub fn checkpoint(bytes: &[u8]) {
    if let Some((weights, config, _)) = accepted(from_safetensors(bytes)) {
        let burnpack = weights.to_burnpack();
        let manifest = Manifest::new("trial", config, &burnpack, serde_json::Value::Null);
        let again = to_safetensors(&weights, &manifest).expect("just read");
        from_safetensors(&again).expect("just written");
        decides(&Policy::from_bytes(manifest, &burnpack).expect("just written"));
    }
    let manifest = Manifest::new("trial", NETWORK, bytes, serde_json::Value::Null);
    if let Some(policy) = accepted(Policy::from_bytes(manifest, bytes)) {
        decides(&policy);
    }
    if let Some(manifest) = accepted(serde_json::from_slice::<Manifest>(bytes)) {
        let _ = accepted(Policy::from_bytes(
            Manifest { weights_hash: blake3::hash(bytes).to_hex().to_string(), ..manifest },
            bytes,
        ));
    }
}

fn decides(policy: &Policy) {
    let mut actions = Vec::new();
    let mut memory = vec![0.0; policy.memory_len()];
    let observations = vec![0.5; policy.observation_len()];
    let batch = Batch { observations: &observations, memory: &mut memory, noise: &[] };
    policy.act(batch, &mut Scratch::default(), &mut actions);
    assert!(actions[0].to_array().iter().all(|value| (-1.0..=1.0).contains(value)), "{actions:?}");
}

/// Graphs, reported traversals and layers in the formats of the cache.
pub fn cache_entry(bytes: &[u8]) {
    let decode = |bytes: &[u8]| {
        if let Some(built) = accepted(cache::decode_entry(bytes)) {
            let Built { graph, stats } = cache::decode_entry(&cache::encode_entry(&built)).expect("just written");
            // Compares text, in which NaN equals itself.
            assert_eq!(
                format!("{stats:?} {:?}", graph.to_data()),
                format!("{:?} {:?}", built.stats, built.graph.to_data())
            );
            graph_answers(graph);
        }
        if let Some(live) = accepted(cache::decode_live(bytes)) {
            assert_eq!(cache::decode_live(&cache::encode_live(&live)).expect("just written"), live);
            live.apply_to(&SOME_GRAPH);
        }
        if let Some(layer) = accepted(cache::decode_layer(bytes)) {
            layer_round_trips(&layer);
        }
    };
    decode(bytes);
    decode(&[blake3::hash(bytes).as_bytes().as_slice(), bytes].concat());
}

/// Graphs as JSON.
pub fn graph_json(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Some(graph) = accepted(import_json(text)) else { return };
    for &format in Format::ALL {
        assert!(!export(&graph, format).is_empty());
    }
    let again = import_json(&export(&graph, Format::Json)).expect("just written");
    assert_eq!(again.to_data(), graph.to_data());
    graph_answers(graph);
}

/// Saved worlds; one on an imported level is restored and stepped.
pub fn saved_world(bytes: &[u8]) {
    const HEADER_LEN: usize = 8 + 4 + 32;
    let decode = |bytes: &[u8]| {
        let place = std::path::Path::new("input");
        let Ok(saved) = WorldSave::decode(bytes, place) else { return };
        assert_eq!(WorldSave::decode(&saved.encode(), place).expect("just written").encode(), saved.encode());
        // Generating a map would only slow the trial down.
        if let SavedMap::Spec(_) = saved.source() {
            return;
        }
        let Some(maps) = accepted(saved.maps()) else { return };
        let (registry, quota) = (Arc::new(Registry::default()), Quota::new(usize::MAX, "NPCs"));
        let mut world = HostedWorld::restore(&saved, maps.map, registry, &quota);
        let again = world.save(saved.owner(), saved.source().clone());
        assert_eq!(again.id(), saved.id());
        for _ in 0..20 {
            world.step();
        }
        for npc in world.snapshot().npcs {
            assert!(npc.position.is_finite());
        }
    };
    decode(bytes);
    let Some((header, content)) = bytes.split_at_checked(HEADER_LEN) else { return };
    decode(&[&header[..12], blake3::hash(content).as_bytes(), content].concat());
}

/// Most vertices of a graph that gets a table.
const LABEL_LIMIT: usize = 64;

/// A graph of three vertices in a row.
static SOME_GRAPH: LazyLock<NavGraph> = LazyLock::new(|| {
    let vertices = [3.0, 9.0, 15.0].map(|x| Vec3::new(x, 1.0, 9.0)).to_vec();
    let proved = surefoot_planner::evidence::Evidence::forced(Decisions(8.0));
    NavGraph::prove(vertices, &[(0, 1), (1, 2), (2, 1)].map(|(from, to)| EdgeKey::new(from, to)), &[proved; 3], 0.5)
});

/// Checks that plans on a graph have a leg for each waypoint and end at the goal, or as near to it as paths lead.
fn graph_answers(graph: NavGraph) {
    let router = Router::new(graph, LABEL_LIMIT, 1);
    for (start, goal) in [([0.0; 3], [9.0, 1.0, 30.0]), ([1.0e9; 3], [-1.0e9; 3])] {
        for avoid in [vec![], vec![EdgeKey::new(0, 1).into()]] {
            let query = Query { avoid, ..Query::new(start.into(), goal.into()) };
            let plan = router.find_path(&query);
            assert_eq!(plan.waypoints.len(), plan.legs.len());
            assert_eq!(plan.waypoints.last(), Some(&plan.nearest.unwrap_or(query.goal)));
            let many = router.arrivals(&query, SharedEnd::Start, &[query.goal], &EdgeCosts::new());
            assert_eq!(many[0].err(), plan.no_path);
            let limit = Seconds(600.0);
            let reached = router.reachable(&query, limit, &EdgeCosts::new());
            assert!(reached.iter().all(|reached| reached.seconds.0 <= limit.0));
            let mut traffic = Traffic::default();
            traffic.add_crowd(query.start, 1000);
            let around = router.find_path_in(&mut traffic, &query, &EdgeCosts::new());
            assert_eq!(around.no_path, plan.no_path);
            assert!(around.seconds().0.is_finite() && (0.0..=1.0).contains(&around.death_chance()), "{around:?}");
        }
    }
}

/// Longest run of a body, in ticks.
const BODY_TICKS: u32 = 240;

/// Files of bodies with their own moves. A body that is accepted runs and jumps on a floor with spots for its moves. It
/// stays within bounds.
pub fn body(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Some(profile) = accepted(toml::from_str::<CharacterProfile>(text)) else { return };
    let json = serde_json::to_string(&profile).expect("plain data");
    assert_eq!(serde_json::from_str::<CharacterProfile>(&json).expect("just written"), profile);
    assert_eq!(convert::body(Some(&convert::body_to_wire(&profile))).expect("just written"), profile);
    let (triangles, placed) = FLOOR.without_pieces();
    let place = |x: f32, y: f32| Vec3::new(x, y, 10.0);
    let spots = profile.moves.iter().flat_map(|own| {
        let spot = |from, to| Spot { tag: own.tag().to_owned(), from, to, two_way: true };
        [spot(place(9.0, 1.0), Some(place(15.0, 4.0))), spot(place(16.0, 8.0), None)]
    });
    let placed = Placed { spots: spots.collect(), ..placed };
    let map =
        Map::from_parts(FLOOR.size(), triangles.iter().filter(|it| it.surface().is_solid()).copied().collect(), placed);
    let mut scratch = MoveScratch::default();
    let mut body = Body::at(place(6.0, 1.0), std::f32::consts::FRAC_PI_2);
    for tick in 0..BODY_TICKS {
        let jump = if tick / 60 % 2 == 1 { 1.0 } else { -1.0 };
        let action = Action { forward: 1.0, jump, ..Action::default() };
        if tick % TICKS_PER_DECISION == 0 {
            body.begin_decision(&action);
        }
        body.tick(&map, &profile, &action, &mut scratch);
        assert!(body.feet.is_finite() && body.feet.abs().max_element() < 1.0e4, "{body:?}");
    }
}
