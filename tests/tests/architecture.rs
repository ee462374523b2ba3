//! The dependency directions of the workspace stay as ARCHITECTURE.md draws them.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

/// What each crate may depend on inside the workspace.
const ALLOWED: [(&str, &[&str]); 9] = [
    ("surefoot-world", &[]),
    ("surefoot-proto", &["surefoot-world"]),
    ("surefoot-policy", &["surefoot-world"]),
    ("surefoot-server", &["surefoot-world", "surefoot-proto"]),
    ("surefoot-planner", &["surefoot-world", "surefoot-policy", "surefoot-proto"]),
    ("surefoot-agent", &["surefoot-world", "surefoot-policy", "surefoot-proto", "surefoot-planner"]),
    ("surefoot-studio", &[]),
    (
        "surefoot-cli",
        &[
            "surefoot-studio",
            "surefoot-world",
            "surefoot-policy",
            "surefoot-proto",
            "surefoot-planner",
            "surefoot-agent",
            "surefoot-server",
        ],
    ),
    (
        "e2e",
        &[
            "surefoot-studio",
            "surefoot-world",
            "surefoot-policy",
            "surefoot-proto",
            "surefoot-planner",
            "surefoot-agent",
            "surefoot-server",
        ],
    ),
];

/// Crates that the simulation must not know.
const FOREIGN_TO_WORLD: [&str; 5] = ["burn", "tonic", "tokio", "prost", "tracing"];

fn dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let output = Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--format-version",
            "1",
            "--no-deps",
            "--offline",
            "--manifest-path",
            concat!(env!("CARGO_MANIFEST_DIR"), "/../Cargo.toml"),
        ])
        .output()
        .expect("cargo runs");
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).expect("metadata is JSON");
    let text = |value: &serde_json::Value| value.as_str().expect("a name").to_owned();
    metadata["packages"]
        .as_array()
        .expect("packages")
        .iter()
        .map(|package| {
            let normal = package["dependencies"]
                .as_array()
                .expect("dependencies")
                .iter()
                .filter(|dependency| dependency["kind"].is_null());
            (text(&package["name"]), normal.map(|dependency| text(&dependency["name"])).collect())
        })
        .collect()
}

#[test]
fn crates_depend_only_in_the_agreed_directions() {
    let found = dependencies();
    assert_eq!(found.len(), ALLOWED.len(), "{:?}", found.keys());
    for (name, allowed) in ALLOWED {
        let inside = found[name].iter().filter(|dependency| ALLOWED.iter().any(|(other, _)| other == dependency));
        for dependency in inside {
            assert!(allowed.contains(&dependency.as_str()), "{name} must not depend on {dependency}");
        }
    }
    for foreign in FOREIGN_TO_WORLD {
        assert!(!found["surefoot-world"].contains(foreign), "the simulation must not know {foreign}");
    }
}
