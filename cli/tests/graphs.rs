//! `surefoot graph` as users run it, in real processes with real files.

use std::path::Path;
use std::process::{Command, Output};

/// Settings of a graph that is quick to build.
const SMALL: [&str; 10] =
    ["--size", "80", "--vertices", "40", "--neighbours", "6", "--repeats", "1", "--threshold", "0.5"];

fn graph(cache: &Path, command: &[&str], more: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_surefoot"))
        .arg("graph")
        .args(command)
        .args(SMALL)
        .args(more)
        .arg("--cache")
        .arg(cache)
        .output()
        .expect("the command runs")
}

fn text(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn json(output: &Output) -> serde_json::Value {
    serde_json::from_str(&text(output)).expect("one JSON document on stdout")
}

#[test]
fn a_graph_is_built_once_drawn_and_exported() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let png = folder.path().join("graph.png");
    let built = json(&graph(&cache, &["build", "31"], &["--json", "--png", png.to_str().unwrap()]));
    assert!(built["cached"] == false && built["edges"].as_u64().unwrap() > 60, "{built}");
    assert!(std::fs::read(png).unwrap().starts_with(b"\x89PNG"));
    let again = json(&graph(&cache, &["show", "31"], &["--json"]));
    assert!(again["cached"] == true && again["graph_id"] == built["graph_id"]);
    let other = json(&graph(&cache, &["show", "31"], &["--json", "--placement", "flood"]));
    assert!(other["cached"] == false && other["graph_id"] != built["graph_id"]);

    let exported = json(&graph(&cache, &["export", "31"], &["--format", "json"]));
    assert_eq!(exported["edges"].as_array().unwrap().len() as u64, built["edges"].as_u64().unwrap());
    let out = folder.path().join("links.json");
    text(&graph(&cache, &["export", "31"], &["--format", "detour", "--out", out.to_str().unwrap()]));
    assert!(std::fs::read_to_string(out).unwrap().contains("offMeshConVerts"));
}

#[test]
fn edits_are_kept_listed_exported_and_undone() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let exported = json(&graph(&cache, &["export", "31"], &["--format", "json"]));
    let place = |idx: &serde_json::Value| {
        let node = &exported["nodes"][idx.as_u64().unwrap() as usize];
        format!("{},{},{}", node["x"], node["y"], node["z"])
    };
    let edge = &exported["edges"][0];
    let pair = format!("{}:{}", place(&edge["source"]), place(&edge["target"]));
    let count = exported["edges"].as_array().unwrap().len();
    let edited = text(&graph(&cache, &["edit", "31"], &["--layer", "night", "--forbid", &pair]));
    assert!(
        edited.contains("forbid_edge") && edited.contains(&format!("{} edges with all layers", count - 1)),
        "{edited}"
    );
    // The edit applies to graphs of other settings too; --without-edits ignores it.
    let listed = text(&graph(&cache, &["edit", "31"], &["--placement", "density"]));
    assert!(listed.contains("layer `night`: 1 edits"), "{listed}");
    let plain = json(&graph(&cache, &["show", "31"], &["--json", "--without-edits"]));
    assert_eq!(plain["edges"].as_u64().unwrap() as usize, count);

    let file = folder.path().join("night.json");
    text(&graph(&cache, &["edit", "31"], &["--layer", "night", "--export", file.to_str().unwrap()]));
    let undone = text(&graph(&cache, &["edit", "31"], &["--layer", "night", "--undo", "1"]));
    assert!(undone.contains(&format!("{count} edges with all layers")), "{undone}");
    let back = text(&graph(&cache, &["edit", "31"], &["--import", file.to_str().unwrap()]));
    assert!(back.contains(&format!("{} edges with all layers", count - 1)), "{back}");
}

#[test]
fn reachability_is_a_check() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let (png, xml) = (folder.path().join("reach.png"), folder.path().join("reach.xml"));
    let report = json(&graph(&cache, &["reach", "31"], &["--json", "--png", png.to_str().unwrap()]));
    assert!(report["reachable"].as_f64().unwrap() > 0.8);
    assert!(report["graph"]["islands"].as_array().unwrap().iter().any(|island| island["entered"] == true));
    assert!(std::fs::read(png).unwrap().starts_with(b"\x89PNG"));
    let xml_path = xml.to_str().unwrap();
    let checks = ["--body", "godot", "--min-reachable", "0.5", "--min-connected", "1", "--junit", xml_path];
    let failed = graph(&cache, &["reach", "31"], &checks);
    assert!(!failed.status.success());
    assert!(String::from_utf8_lossy(&failed.stderr).contains("at least 100.00 % must"));
    let percent = graph(&cache, &["reach", "31"], &["--min-reachable", "98"]);
    assert!(String::from_utf8_lossy(&percent.stderr).contains("a share from 0 to 1, such as 0.98 for 98 %"));
    let junit = std::fs::read_to_string(xml).unwrap();
    assert!(junit.contains("tests=\"2\" failures=\"1\"") && junit.contains("name=\"reachable\"/>"), "{junit}");
}

#[test]
fn versions_of_a_level_are_compared() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let before = folder.path().join("before.json");
    text(&graph(&cache, &["export", "31"], &["--format", "json", "--out", before.to_str().unwrap()]));
    let same = json(&graph(&cache, &["diff", before.to_str().unwrap(), "31"], &["--json", "--fail-on-loss"]));
    assert!(same["lost"].as_array().unwrap().is_empty() && same["gained"].as_array().unwrap().is_empty());
    // Without the edges of half of the vertices, places are lost.
    let mut graph_file: serde_json::Value = serde_json::from_slice(&std::fs::read(&before).unwrap()).unwrap();
    let edges = graph_file["edges"].as_array_mut().unwrap();
    edges.retain(|edge| edge["target"].as_u64().unwrap() < 20 && edge["source"].as_u64().unwrap() < 20);
    let after = folder.path().join("after.json");
    std::fs::write(&after, graph_file.to_string()).unwrap();
    let args = ["diff", before.to_str().unwrap(), after.to_str().unwrap()];
    let lost = graph(&cache, &args, &["--fail-on-loss"]);
    assert!(!lost.status.success());
    assert!(String::from_utf8_lossy(&lost.stderr).contains("can no longer be reached"));
}

#[test]
fn a_changed_map_starts_from_the_graph_of_the_old_one() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let map = folder.path().join("level.sfmap");
    let generate = Command::new(env!("CARGO_BIN_EXE_surefoot"))
        .args(["map", "generate", "31", "--size", "80", "--out", map.to_str().unwrap()])
        .output()
        .unwrap();
    assert!(generate.status.success());
    let map = map.to_str().unwrap();
    let first = json(&graph(&cache, &["build", map], &["--json"]));
    // The same map without its pads: only candidates near them are probed again.
    let changed = ["--json", "--changed-from", map, "--features", "paper,pads=0"];
    let second = json(&graph(&cache, &["build", "31"], &changed));
    assert_eq!(second["cached"], false);
    let (few, all) = (second["retried"].as_u64().unwrap(), first["candidates"].as_u64().unwrap());
    assert!(few < all, "{few} of {all} candidates");
}

#[test]
fn a_process_killed_at_any_moment_leaves_a_usable_cache() {
    let folder = tempfile::tempdir().unwrap();
    let clean = folder.path().join("clean");
    let cache = folder.path().join("cache");
    let file = cache.join("graphs.redb");
    let run = |cache: &Path, vertices: u32| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_surefoot"));
        let count = vertices.to_string();
        command.args(["graph", "build", "31", "--size", "80", "--vertices", &count, "--neighbours", "4", "--json"]);
        command.arg("--cache").arg(cache).stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::null());
        command.spawn().expect("the command runs")
    };
    // Each process is killed after a different number of changes to the file: while it opens, probes and writes.
    for (round, vertices) in (0..12u32).zip(10..) {
        let mut child = run(&cache, vertices);
        let mut changes = 0;
        let mut last = None;
        while changes < round && child.try_wait().unwrap().is_none() {
            let state = std::fs::metadata(&file).ok().and_then(|data| Some((data.len(), data.modified().ok()?)));
            changes += u32::from(state != last);
            last = state;
            std::thread::yield_now();
        }
        child.kill().unwrap();
        child.wait().unwrap();
    }
    for vertices in 10..22 {
        let fields = |cache: &Path| {
            let output = run(cache, vertices).wait_with_output().unwrap();
            let report = json(&output);
            (report["graph_id"].clone(), report["edges"].clone(), report["connected"].clone())
        };
        assert_eq!(fields(&cache), fields(&clean), "{vertices} vertices");
    }
}

#[test]
fn bad_input_ends_with_one_clear_line() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let file = folder.path().join("not-a-layer.json");
    std::fs::write(&file, "{\"name\": 3}").unwrap();
    let cases: [(&[&str], &[&str], &str); 6] = [
        (&["build", "31"], &["--placement", "everywhere"], "known are random, spaced"),
        (&["export", "31"], &["--format", "xls"], "known are graphml, json, detour"),
        (&["edit", "31"], &["--layer", "a", "--forbid", "1,2:3,4,5"], "`1,2` is not a place"),
        (&["edit", "31"], &["--layer", "a", "--price", "1,2,3:3,4,5"], "expected FROM:TO=FACTOR"),
        (&["edit", "31"], &["--import", file.to_str().unwrap()], "is not a layer of edits"),
        (&["diff", "nowhere.json", "31"], &[], "cannot read nowhere.json"),
    ];
    for (command, more, words) in cases {
        let output = graph(&cache, command, more);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && message.contains(words), "{command:?} {more:?}: {message}");
    }
}
