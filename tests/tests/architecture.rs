//! Checks the invariants of ARCHITECTURE.md: dependencies between crates, knowledge of wire types, no circular imports.

use e2e::packages::{IMAGE, features};
use e2e::source::{Crate, root};
use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

/// The workspace crates that each crate may depend on.
const ALLOWED: [(&str, &str, &[&str]); 22] = [
    ("core/world", "surefoot-world", &[]),
    ("core/generate", "surefoot-generate", &["surefoot-world"]),
    ("core/levels", "surefoot-levels", &["surefoot-world"]),
    ("core/policy", "surefoot-policy", &["surefoot-world"]),
    ("core/planner", "surefoot-planner", &["surefoot-world"]),
    ("core/rollout", "surefoot-rollout", &["surefoot-world", "surefoot-policy", "surefoot-planner"]),
    ("proto", "surefoot-proto", &["surefoot-world", "surefoot-planner"]),
    ("net", "surefoot-net", &["surefoot-world", "surefoot-generate", "surefoot-levels", "surefoot-proto"]),
    (
        "server",
        "surefoot-server",
        &[
            "surefoot-world",
            "surefoot-generate",
            "surefoot-levels",
            "surefoot-planner",
            "surefoot-rollout",
            "surefoot-proto",
            "surefoot-net",
        ],
    ),
    (
        "planner-service",
        "surefoot-planner-service",
        &[
            "surefoot-world",
            "surefoot-policy",
            "surefoot-planner",
            "surefoot-rollout",
            "surefoot-proto",
            "surefoot-net",
        ],
    ),
    (
        "agent",
        "surefoot-agent",
        &[
            "surefoot-world",
            "surefoot-levels",
            "surefoot-policy",
            "surefoot-planner",
            "surefoot-rollout",
            "surefoot-proto",
            "surefoot-net",
        ],
    ),
    (
        "embed/game-client",
        "surefoot-game-client",
        &[
            "surefoot-world",
            "surefoot-levels",
            "surefoot-policy",
            "surefoot-planner",
            "surefoot-rollout",
            "surefoot-proto",
            "surefoot-net",
        ],
    ),
    ("learn/exchange", "surefoot-exchange", &["surefoot-world", "surefoot-policy"]),
    (
        "learn/train",
        "surefoot-train",
        &[
            "surefoot-world",
            "surefoot-generate",
            "surefoot-levels",
            "surefoot-policy",
            "surefoot-planner",
            "surefoot-rollout",
            "surefoot-proto",
            "surefoot-net",
            "surefoot-game-client",
        ],
    ),
    (
        "learn/eval",
        "surefoot-eval",
        &[
            "surefoot-world",
            "surefoot-generate",
            "surefoot-levels",
            "surefoot-policy",
            "surefoot-planner",
            "surefoot-rollout",
            "surefoot-proto",
            "surefoot-net",
            "surefoot-game-client",
        ],
    ),
    (
        "embed/capi",
        "surefoot-capi",
        &["surefoot-world", "surefoot-levels", "surefoot-policy", "surefoot-planner", "surefoot-rollout"],
    ),
    ("embed/game", "surefoot-game", &["surefoot-world", "surefoot-rollout", "surefoot-net", "surefoot-server"]),
    (
        "embed/python",
        "surefoot-python",
        &[
            "surefoot-world",
            "surefoot-generate",
            "surefoot-levels",
            "surefoot-policy",
            "surefoot-planner",
            "surefoot-rollout",
            "surefoot-net",
            "surefoot-game-client",
            "surefoot-report",
        ],
    ),
    ("operate/agones", "surefoot-agones", &["surefoot-net", "surefoot-server"]),
    (
        "operate/fleet",
        "surefoot-fleet",
        &[
            "surefoot-world",
            "surefoot-generate",
            "surefoot-levels",
            "surefoot-policy",
            "surefoot-planner",
            "surefoot-rollout",
            "surefoot-net",
            "surefoot-planner-service",
            "surefoot-server",
        ],
    ),
    ("tools/report", "surefoot-report", &["surefoot-world"]),
    ("studio", "surefoot-studio", &[]),
];

/// Crates that may depend on all others.
const OUTERMOST: [&str; 4] = ["surefoot-cli", "surefoot-lab", "surefoot-processes", "e2e"];

/// Crates that some of ours must not depend on.
const FOREIGN: [(&str, &[&str]); 8] = [
    ("surefoot-world", &["burn", "tonic", "tokio", "prost", "tracing", "surefoot-policy", "gltf", "noise"]),
    ("surefoot-generate", &["tonic", "tokio", "prost", "tracing", "gltf"]),
    ("surefoot-levels", &["tonic", "tokio", "prost", "tracing", "noise"]),
    ("surefoot-planner", &["burn", "tonic", "tokio", "prost", "tracing", "redb"]),
    ("surefoot-policy", &["burn", "tonic", "tokio", "prost"]),
    ("surefoot-rollout", &["tonic", "tokio", "prost"]),
    ("surefoot-server", &["burn"]),
    ("surefoot-capi", &["burn", "tonic", "tokio", "prost"]),
];

/// Files that may use generated wire types, besides `proto`, the command line and the tests.
const KNOW_THE_WIRE: [&str; 42] = [
    "net/src/levels/grpc.rs",
    "net/src/levels/report.rs",
    "server/src/wire.rs",
    "server/src/wire/env.rs",
    "server/src/wire/living.rs",
    "server/src/wire/map.rs",
    "server/src/wire/worker.rs",
    "server/src/serve.rs",
    "server/src/grpc/mod.rs",
    "server/src/grpc/groups.rs",
    "server/src/grpc/npcs.rs",
    "server/src/grpc/worlds.rs",
    "server/src/grpc/directory.rs",
    "server/src/grpc/redirect.rs",
    "server/src/grpc/routes.rs",
    "server/src/grpc/settings.rs",
    "server/src/grpc/env.rs",
    "server/src/grpc/living.rs",
    "server/src/grpc/errors.rs",
    "server/src/grpc/readers.rs",
    "server/src/grpc/work.rs",
    "server/src/grpc/zones.rs",
    "planner-service/src/wire.rs",
    "planner-service/src/wire/tactics.rs",
    "planner-service/src/serve.rs",
    "planner-service/src/grpc/mod.rs",
    "planner-service/src/grpc/errors.rs",
    "planner-service/src/grpc/streams.rs",
    // Clients of services in other processes.
    "agent/src/directory.rs",
    "agent/src/session.rs",
    "agent/src/world.rs",
    "agent/src/world/batch.rs",
    "agent/src/graph.rs",
    "learn/eval/src/challenge/host.rs",
    "embed/game-client/src/link.rs",
    "learn/train/src/actors/wire.rs",
    "learn/train/src/actors/actor.rs",
    // The service of a learner.
    "learn/train/src/actors/service.rs",
    "agent/src/crowd.rs",
    "cli/src/commands/up.rs",
    "cli/src/commands/top.rs",
    "cli/src/commands/health.rs",
];

/// Files that may use `tonic::Status`, besides those that may use wire types.
const KNOW_STATUSES: [&str; 17] = [
    "net/src/status.rs",
    "net/src/client.rs",
    "net/src/idempotency.rs",
    "net/src/paging.rs",
    "net/src/reader.rs",
    "net/src/serving/access.rs",
    "net/src/serving/connect.rs",
    "net/src/serving/deadline.rs",
    "net/src/serving/metered.rs",
    "net/src/serving/methods.rs",
    "net/src/serving/protocol.rs",
    "net/src/serving/gate.rs",
    "net/src/serving/origin.rs",
    "net/src/serving/revocation.rs",
    "net/src/serving/shutdown.rs",
    "agent/src/lib.rs",
    // A client of Agones.
    "operate/agones/src/sidecar.rs",
];

fn dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline", "--manifest-path"])
        .arg(root().join("Cargo.toml"))
        .output()
        .expect("cargo runs");
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).expect("metadata is JSON");
    let text = |value: &serde_json::Value| value.as_str().expect("a name").to_owned();
    let packages = metadata["packages"].as_array().expect("packages").iter();
    packages
        .map(|package| {
            let all = package["dependencies"].as_array().expect("dependencies").iter();
            let normal = all.filter(|dependency| dependency["kind"].is_null());
            (text(&package["name"]), normal.map(|dependency| text(&dependency["name"])).collect())
        })
        .collect()
}

#[test]
fn crates_depend_only_in_the_agreed_directions() {
    let found = dependencies();
    assert_eq!(found.len(), ALLOWED.len() + OUTERMOST.len(), "{:?}", found.keys());
    for (_, name, allowed) in ALLOWED {
        let inside = found[name].iter().filter(|dependency| dependency.starts_with("surefoot-"));
        for dependency in inside {
            assert!(allowed.contains(&dependency.as_str()), "{name} must not depend on {dependency}");
        }
    }
    for (name, foreign) in FOREIGN {
        for dependency in foreign {
            assert!(!found[name].contains(*dependency), "{name} must not know {dependency}");
        }
    }
}

#[test]
fn no_files_of_a_crate_import_each_other_in_a_circle() {
    let mut found: Vec<String> = Vec::new();
    for folder in ALLOWED.map(|(folder, ..)| folder).into_iter().chain(["cli", "tools/lab"]) {
        let source = Crate::read(folder);
        found.extend(source.circles().into_iter().map(|circle| circle.join(" <-> ")));
    }
    assert!(found.is_empty(), "{found:#?}");
}

#[test]
fn wire_types_and_statuses_are_known_at_the_rim_only() {
    for (folder, ..) in ALLOWED {
        if folder == "proto" {
            continue;
        }
        let source = Crate::read(folder);
        for (path, code) in source.files() {
            let knows_wire = ["surefoot_proto::world::v1", "surefoot_proto::planner::v1", "surefoot_proto::learn::v1"]
                .iter()
                .any(|it| code.contains(it));
            assert!(!knows_wire || KNOW_THE_WIRE.contains(&path), "{path} must not know wire types");
            let knows_status =
                code.contains("tonic::Status") || code.contains("Status,") && code.contains("use tonic::");
            let may = KNOW_THE_WIRE.contains(&path) || KNOW_STATUSES.contains(&path);
            assert!(!knows_status || may, "{path} must not know tonic's statuses");
        }
    }
}

#[test]
fn simulation_and_search_never_await() {
    for folder in [
        "core/world",
        "core/generate",
        "core/levels",
        "core/policy",
        "core/planner",
        "core/rollout",
        "tools/report",
        "embed/capi",
        "embed/python",
    ] {
        for (path, code) in Crate::read(folder).files() {
            assert!(!code.contains("async ") && !awaits(code), "{path} awaits");
        }
    }
    for (path, code) in Crate::read("server").files() {
        let is_hosted = path.starts_with("server/src/hosted/");
        assert!(!is_hosted || !awaits(code), "{path} awaits");
    }
}

/// Whether the code contains `.await`; fields such as `awaiting` do not count.
fn awaits(code: &str) -> bool {
    code.split(".await").skip(1).any(|rest| !rest.starts_with(|next: char| next.is_alphanumeric() || next == '_'))
}

#[test]
fn every_file_says_at_its_top_what_it_owns() {
    for folder in ALLOWED.map(|(folder, ..)| folder).into_iter().chain(["cli", "tools/lab", "tests"]) {
        for (path, _) in Crate::read(folder).files() {
            let text = std::fs::read_to_string(root().join(path)).expect("a source file");
            assert!(text.starts_with("//! "), "{path} does not say what it owns");
        }
    }
}

/// The crate that consists of pointers, and its modules that may contain unsafe code: docs/adr/0034-c-library.md.
const UNSAFE: (&str, [&str; 2]) = ("embed/capi", ["exports", "memory"]);

#[test]
fn unsafe_code_is_forbidden_everywhere_but_at_the_border_to_c() {
    let manifest = std::fs::read_to_string(root().join("Cargo.toml")).expect("the manifest");
    assert!(manifest.contains("unsafe_code = \"forbid\""));
    let (border, modules) = UNSAFE;
    for folder in ALLOWED.map(|(folder, ..)| folder).into_iter().chain(["cli", "tools/lab", "tests"]) {
        let own = std::fs::read_to_string(root().join(folder).join("Cargo.toml")).expect("a manifest");
        if folder != border {
            assert!(own.contains("[lints]\nworkspace = true"), "{folder} does not use the workspace's lints");
            continue;
        }
        assert!(own.contains("unsafe_code = \"deny\""), "{folder} denies unsafe code but where a module expects it");
        for (path, code) in Crate::read(folder).files() {
            let inside = path.trim_start_matches("embed/capi/src/");
            let may = modules.iter().any(|module| inside.starts_with(module));
            assert!(may || !code.contains("unsafe {") && !code.contains("unsafe fn"), "{path} has unsafe code");
            assert!(path == "embed/capi/src/lib.rs" || !code.contains("(unsafe_code"), "{path} allows unsafe code");
        }
    }
}

#[test]
fn no_build_compiles_again_what_the_first_command_has_built() {
    let first = features(&["--package", "surefoot-cli", "--package", "surefoot-lab", "--edges", LINKED]);
    let with_dev = format!("{LINKED},dev");
    let tests = features(&["--workspace", "--edges", &with_dev]);
    let packages = ["--package", "surefoot-cli", "--package", "surefoot-fleet", "--package", "surefoot-lab"];
    let with_failpoints = format!("{IMAGE},surefoot-cli/failpoints");
    let fleet = features(&[&packages[..], &["--features", &with_failpoints, "--edges", &with_dev]].concat());
    let wheel = features(&["--package", "surefoot-python", "--edges", LINKED]);
    for (name, build) in [("the tests", tests), ("the fleet's tests", fleet), ("the wheel", wheel)] {
        let shared = first.iter().filter(|(package, _)| !package.starts_with("surefoot-"));
        let again: Vec<_> = shared
            .filter_map(|(package, sets)| Some((package, sets, build.get(package)?)))
            .filter(|(_, sets, found)| sets != found)
            .collect();
        assert!(again.is_empty(), "built again for {name}, with other features: {again:#?}");
    }
}

/// Edges of `cargo tree` that a program links. What procedural macros and build scripts use is compiled apart.
const LINKED: &str = "normal,no-proc-macro";
