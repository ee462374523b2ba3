//! Writes the constructed part of the fuzz targets' corpora: small valid inputs of every kind.
//!
//! ```sh
//! cargo run -p e2e --example corpus
//! ```
//!
//! Inputs that once caused a failure are kept beside them under other names. Those that meshoptimizer and Draco
//! compressed are written by `core/levels/tests/fixtures/make.mjs`.

#[path = "../../tools/fuzz/src/lib.rs"]
mod untrusted;

use prost::Message;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::path::Path;
use std::sync::Arc;
use surefoot_planner::BuildStats;
use surefoot_planner::edits::{Edit, Layer};
use surefoot_planner::evidence::{Evidence, TryEnd};
use surefoot_planner::export::{Format, export};
use surefoot_planner::live::{LiveEvidence, Reporter, Traversal};
use surefoot_planner::{BuildSettings, Built, EdgeKey, NavGraph, Query, Router, store as cache};
use surefoot_planner_service::layer_to_wire;
use surefoot_policy::{Manifest, Parameter, Weights};
use surefoot_proto::plans::{plan_to_wire, settings_to_wire};
use surefoot_proto::{convert, planner::v1 as plan, world::v1 as wire};
use surefoot_server::WorldId;
use surefoot_server::hosted::{Area, HostedWorld, Route, SavedMap, TimeMode};
use surefoot_server::quota::Quota;
use surefoot_server::registry::Registry;
use surefoot_world::map::{Jetpack, Liquid, MapSize, Outline, Pad, Placed, Pool, Teleporter, ZipLine};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::sense::OBSERVATION_VERSION;
use surefoot_world::{
    Action, CharacterProfile, Decisions, Map, MapSpec, OBSERVATION_LEN, Seed, TaskConfig, Vec3, World, WorldConfig,
};
use untrusted::{FIRST_NPC, FLOOR, NETWORK};

/// Size limit of an input, bytes.
const LIMIT: usize = 16 * 1024;

fn main() {
    let kept = [
        ("world_messages", world_messages()),
        ("planner_messages", planner_messages()),
        (
            "map_file",
            vec![("floor", surefoot_levels::encode(&FLOOR)), ("devices", surefoot_levels::encode(&devices()))],
        ),
        ("gltf", gltf()),
        ("obj", obj()),
        ("recording", vec![("walk", recording())]),
        ("checkpoint", networks()),
        ("cache_entry", cache_entries()),
        ("graph_json", vec![("row", graph_json())]),
        ("body", bodies()),
        ("saved_world", vec![("on_a_level", saved_world(Some(&FLOOR))), ("generated", saved_world(None))]),
    ];
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tools/fuzz/corpus");
    for (target, files) in kept {
        assert!(untrusted::TRIALS.iter().any(|(name, _)| *name == target), "{target} is not a target");
        std::fs::create_dir_all(folder.join(target)).expect("a folder in the checkout");
        for (name, bytes) in files {
            assert!(bytes.len() <= LIMIT, "{target}/{name} has {} bytes", bytes.len());
            std::fs::write(folder.join(target).join(name), bytes).expect("a file in the checkout");
        }
    }
}

fn at(x: f32, y: f32, z: f32) -> Option<wire::Vec3> {
    Some(wire::Vec3 { x, y, z })
}

fn spec() -> wire::MapSpec {
    convert::map_spec_to_wire(&MapSpec::with_side(7, 60).unwrap())
}

fn world_messages() -> Vec<(&'static str, Vec<u8>)> {
    let npc_ids = vec![FIRST_NPC, FIRST_NPC + 1];
    let work = |message| wire::WorkRequest { message: Some(message) }.encode_to_vec();
    let answer = |actions: [f32; 8]| wire::ActionBatch {
        world_id: 1,
        tick: 0,
        npc_ids: npc_ids.clone(),
        actions: convert::pack(actions),
        waypoints: vec![wire::Waypoint { npc_id: npc_ids[0], position: at(12.0, 1.0, 3.0), attempt: 1, stands: true }],
        gave_up: vec![wire::GivenUp { npc_id: npc_ids[1], attempt: 1, unreachable: true }],
        attempts: vec![1, 1],
        ..Default::default()
    };
    let observations = wire::ObservationBatch {
        world_id: 1,
        tick: 10,
        npc_ids: npc_ids[..1].to_vec(),
        observations: convert::pack([0.25; OBSERVATION_LEN]),
        positions: convert::pack([1.0, 2.0, 3.0]),
        goals: convert::pack([4.0, 5.0, 6.0]),
        attempts: vec![1],
        waypoint_reached: vec![true],
        grounded: vec![true],
        states: vec![vec![0; 64]],
        state_version: 1,
        body_idx: 0,
        movers: Vec::new(),
        touches: vec![false],
        gaits: Vec::new(),
    };
    let hello = wire::Hello {
        name: "worker".to_owned(),
        capacity: 8,
        observation_len: OBSERVATION_LEN as u32,
        observation_version: OBSERVATION_VERSION,
        ..Default::default()
    };
    let actions = wire::work_request::Message::Actions;
    vec![
        ("create_world", wire::CreateWorldRequest { map: Some(spec()), mode: 2, ..Default::default() }.encode_to_vec()),
        (
            "spawn_npc",
            wire::SpawnNpcRequest { world_id: 1, position: at(1.0, 2.0, 3.0), yaw: 0.5, ..Default::default() }
                .encode_to_vec(),
        ),
        (
            "set_goal",
            wire::SetGoalRequest { npc_id: npc_ids[0], goal: at(9.0, 2.0, 9.0), ..Default::default() }.encode_to_vec(),
        ),
        ("watch_world", wire::WatchWorldRequest { world_id: 1, rate_hz: 10.0, ..Default::default() }.encode_to_vec()),
        ("hello", work(wire::work_request::Message::Hello(hello))),
        ("answer", work(actions(answer([0.5, -0.5, 1.0, 0.0, 1.0, 2.0, 0.0, -1.0])))),
        ("answer_not_finite", work(actions(answer([f32::NAN, f32::INFINITY, 1.0, 0.0, 1.0, 2.0, 0.0, -1.0])))),
        (
            "observations",
            wire::WorkResponse { message: Some(wire::work_response::Message::Observations(observations)) }
                .encode_to_vec(),
        ),
    ]
}

fn graph_json() -> Vec<u8> {
    let graph = graph();
    export(&graph, Format::Json).into_bytes()
}

fn layer() -> Layer {
    let (from, to) = (Vec3::new(3.0, 1.0, 9.0), Vec3::new(9.0, 1.0, 9.0));
    let edits = vec![
        Edit::ForbidEdge { from, to },
        Edit::ForceEdge { from: to, to: from, seconds: Some(2.5) },
        Edit::ForceEdge { from, to, seconds: None },
        Edit::PriceEdge { from, to, factor: 4.0 },
        Edit::AddVertex { at: Vec3::new(12.0, 1.0, 12.0) },
        Edit::MoveVertex { from, to: Vec3::new(4.0, 1.0, 9.0) },
        Edit::RemoveVertex { at: to },
    ];
    Layer { name: "by hand".to_owned(), edits }
}

fn planner_messages() -> Vec<(&'static str, Vec<u8>)> {
    let graph_id = "0123456789abcdef".repeat(4);
    let router = Router::new(graph(), 64, 1);
    let found = router.find_path(&Query::new(Vec3::ONE, Vec3::new(36.0, 1.0, 9.0)));
    let stop = |vertex| Some(plan::Stop { stop: Some(plan::stop::Stop::Vertex(vertex)) });
    let leg = plan::LegEnds { from: stop(0), to: stop(1) };
    let query =
        plan::PathQuery { start: at(1.0, 1.0, 1.0), goal: at(19.0, 1.0, 9.0), avoid: vec![leg], ..Default::default() };
    let on_wire = layer_to_wire(&layer());
    let traversals = vec![plan::Traversal { from: 0, to: 1, reached: true, decisions: 9, died: false }];
    let settings = Some(settings_to_wire(&BuildSettings::default()));
    vec![
        ("start_build", plan::StartBuildRequest { map: Some(spec()), settings, ..Default::default() }.encode_to_vec()),
        (
            "find_paths",
            plan::FindPathsRequest {
                graph_id: graph_id.clone(),
                queries: vec![query],
                traffic: None,
                ..Default::default()
            }
            .encode_to_vec(),
        ),
        ("plan", plan::FindPathResponse { plan: Some(plan_to_wire(&found)), interim: false }.encode_to_vec()),
        (
            "traversals",
            plan::ReportTraversalsRequest { graph_id: graph_id.clone(), traversals, ..Default::default() }
                .encode_to_vec(),
        ),
        (
            "put_layer",
            plan::PutLayerRequest {
                graph_id: graph_id.clone(),
                layer: Some(on_wire.clone()),
                if_revision: 7,
                ..Default::default()
            }
            .encode_to_vec(),
        ),
        (
            "append_edits",
            plan::AppendEditsRequest { graph_id, layer: on_wire.name, edits: on_wire.edits, ..Default::default() }
                .encode_to_vec(),
        ),
    ]
}

/// A floor of 30 m x 30 m with one of every feature.
fn devices() -> Map {
    let [a, b, c, d] = [[0.0, 0.0], [0.0, 30.0], [30.0, 30.0], [30.0, 0.0]].map(|[x, z]| Vec3::new(x, 1.0, z));
    let triangles = [[a, b, c], [a, c, d]].into_iter().filter_map(|t| Triangle::new(t, Surface::Ground)).collect();
    let at = |x: f32, z: f32| Vec3::new(x, 1.0, z);
    let outline = Outline::Rectangle { half_x: 2.0, half_z: 1.5 };
    let placed = Placed {
        pools: vec![Pool { centre: at(5.0, 5.0), outline, depth: 0.5, liquid: Liquid::Lava }],
        pads: vec![Pad { centre: at(20.0, 5.0), speed: 23.75 }],
        zip_lines: vec![ZipLine { from: at(3.0, 20.0), to: at(9.0, 20.0) }],
        teleporters: vec![Teleporter { from: at(5.0, 10.0), to: at(5.0, 14.0), two_way: true }],
        jetpacks: vec![Jetpack { centre: at(20.0, 20.0), fuel: 2.5 }],
        ..Placed::default()
    };
    Map::from_parts(MapSize { width: 30, height: 25, depth: 30 }, triangles, placed)
}

fn gltf() -> Vec<(&'static str, Vec<u8>)> {
    // One triangle of 8 m in an embedded buffer, instanced twice, with a pad as child of the second instance.
    let embedded = concat!(
        r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1]}],
"nodes":[{"mesh":0},{"mesh":0,"translation":[0,0,8],"rotation":[0,1,0,0],"scale":[1,1,2],"children":[2]},
{"name":"pad","translation":[-2,0,2],"extras":{"height":3}}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"mode":4}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
{"bufferView":1,"componentType":5121,"count":3,"type":"SCALAR"}],
"bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":3}],
"buffers":[{"byteLength":39,"uri":"data:application/octet-stream;base64,"#,
        r#"AAAAAAAAAAAAAAAAAAAAAAAAAAAAAABBAAAAQQAAAAAAAAAAAAEC"}]}"#
    );
    let sidecar = r#"{"pools":[{"liquid":"lava","min":[1,0,1],"max":[3,1,3]}],"pads":[{"at":[9,1,9],"height":3}],
"zip_lines":[{"from":[1,1,15],"to":[15,1,15]}],"teleporters":[{"from":[5,1,12],"to":[12,1,5],"two_way":true}],
"jetpacks":[{"at":[17,1,17],"fuel":2}]}"#;
    vec![
        ("floor", surefoot_levels::export_glb(&FLOOR)),
        ("devices", surefoot_levels::export_glb(&devices())),
        ("embedded", embedded.as_bytes().to_vec()),
        ("sidecar", sidecar.as_bytes().to_vec()),
    ]
}

fn obj() -> Vec<(&'static str, Vec<u8>)> {
    let floor = "o floor\nv 0 0 0\nv 0 0 20 1 1 1\nv 20 0 20\nv 20 0 0\nf 1 2 3 4\n";
    let features = "g ground\nv 0 0 0\nv 0 0 20\nv 20 0 20\nv 20 0 0\nf 1/1/1 2/2/1 3//1 \\\n-1\n\
        g lava_pool\nv 5 0 5\nv 5 0 8\nv 8 0 8\nv 5 -1 5\nf 5 6 7\nl 5 8\n\
        o zip_line_1:from\nv 2 0 2\nv 2 0 3\nv 3 0 3\nf -3 -2 -1\n\
        o zip_line_1:to\nv 15 0 15\nv 15 0 16\nv 16 0 16\nf -3 -2 -1\n";
    vec![("floor", floor.as_bytes().to_vec()), ("features", features.as_bytes().to_vec())]
}

fn recording() -> Vec<u8> {
    let profiles = vec![CharacterProfile::default(), CharacterProfile::default().with(|it| it.height = 1.2).unwrap()];
    let config = WorldConfig { profiles, task: TaskConfig::default(), npc_collision: true };
    let mut world = World::with_config(FLOOR.clone(), config);
    let standing = world.spawn(Vec3::new(5.0, 1.0, 15.0), 0.0);
    world.tick_decision();
    world.start_recording();
    let walker = world.spawn_as(surefoot_world::ProfileIdx(1), Vec3::new(10.0, 1.0, 10.0), 1.0);
    world.set_waypoint(walker, Vec3::new(15.0, 1.0, 15.0));
    for turn in [0.5, -0.25, 0.0] {
        world.decide(walker, Action { forward: 1.0, turn, jump: turn, ..Action::default() });
        world.tick_decision();
        world.close_decision(walker);
    }
    world.clear_waypoint(walker);
    world.teleport(standing, Vec3::new(4.0, 1.0, 4.0), 0.0);
    world.tick_decision();
    world.despawn(standing);
    world.finish_recording().expect("it was begun").encode()
}

/// A world with one seeking NPC and one that wanders, on a level or on a generated map.
fn saved_world(level: Option<&Arc<Map>>) -> Vec<u8> {
    let small = MapSpec::new(7).with(|it| it.size = MapSize { width: 50, height: 40, depth: 50 }).unwrap();
    let generated = || Arc::new(surefoot_generate::generate(&small));
    let map = level.cloned().unwrap_or_else(generated);
    let quota = Quota::new(2, "NPCs");
    let mut world = HostedWorld::new(WorldId(1), map.clone(), TimeMode::Lockstep, Arc::new(Registry::default()));
    let mut spawn =
        |x: f32| world.spawn(Vec3::new(x, 9.0, 10.0), 0.0, 2, quota.grant("corpus")).expect("a place on the map");
    let [walker, wanderer] = [spawn(8.0), spawn(12.0)];
    let ground = HostedWorld::sample_ground(&map, &CharacterProfile::default(), 1, Seed(1)).expect("ground");
    world.set_goal(walker, ground[0]).expect("a place on the map");
    let area = Area::Circle { centre: Vec3::new(12.0, 1.0, 10.0), radius: 5.0 };
    world.set_route(wanderer, Some(Route::Wander { area, dwell: 60 })).expect("a place on the map");
    world.step();
    world.save("corpus", SavedMap::of(&map, "level".to_owned())).encode()
}

fn networks() -> Vec<(&'static str, Vec<u8>)> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let parameters = NETWORK.parameter_shapes().into_iter().map(|(name, shape)| {
        let values = (0..shape.iter().product()).map(|_| rng.random_range(-0.5..0.5)).collect();
        (name, Parameter { shape, values })
    });
    let network = Weights::new(&NETWORK, parameters.collect()).expect("the network's shapes");
    let burnpack = network.to_burnpack();
    let manifest = Manifest::new("small", NETWORK, &burnpack, serde_json::json!({ "seed": 1 }));
    vec![
        ("safetensors", surefoot_exchange::to_safetensors(&network, &manifest).expect("a module")),
        ("burnpack", burnpack),
        ("manifest", serde_json::to_vec(&manifest).expect("plain data")),
    ]
}

fn graph() -> NavGraph {
    let vertices = [3.0, 9.0, 15.0, 60.0].map(|x| Vec3::new(x, 1.0, 9.0)).to_vec();
    NavGraph::prove(
        vertices,
        &[(0, 1), (1, 0), (1, 2)].map(|(from, to)| EdgeKey::new(from, to)),
        &[8.0, 9.0, 6.5].map(|decisions| Evidence::forced(Decisions(decisions))),
        0.5,
    )
}

/// Cache entries without their checksums, which the trial prepends, and one with its checksum.
fn cache_entries() -> Vec<(&'static str, Vec<u8>)> {
    let graph = graph();
    let mut live = LiveEvidence::default();
    let worker = Reporter { name: "worker".to_owned(), is_trusted: true };
    live.note(&graph, &worker, &Traversal { edge: EdgeKey::new(0, 1), end: TryEnd::Arrived, decisions: 7 });
    live.note(&graph, &worker, &Traversal { edge: EdgeKey::new(1, 2), end: TryEnd::Died, decisions: 30 });
    let whole = cache::encode_entry(&Built { graph, stats: BuildStats::default() });
    vec![
        ("graph", whole[32..].to_vec()),
        ("live", cache::encode_live(&live)[32..].to_vec()),
        ("layer", cache::encode_layer(&layer())[32..].to_vec()),
        ("sealed", whole),
    ]
}

/// Bodies with moves of their own.
fn bodies() -> Vec<(&'static str, Vec<u8>)> {
    let rope = "[[moves]]\nid = \"rope\"\nmotion = \"curve\"\nspeed = 3.0\nrise = 1.5\nanimation = \"Climb\"\n";
    let hook = "extra_jumps = 0\n[[moves]]\nid = \"hook\"\nmotion = \"tether\"\nspot = \"anchor\"\nrange = 12.5\n";
    let all = "climb_speed = 2.0\nmantle_height = 1.5\nswim_speed = 2.0\ncrouch_height = 0.9\ndash_speed = 12.0\n\
               wall_run_seconds = 1.5\nslide_seconds = 1.0\ndive_seconds = 9.0\n";
    vec![("rope", rope.into()), ("hook", hook.into()), ("moves", format!("{all}{rope}").into())]
}
