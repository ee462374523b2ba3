//! The command as users run it: real processes.

use std::process::{Command, Output, Stdio};

fn surefoot(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_surefoot")).args(args).output().expect("the command runs")
}

fn json(output: &Output) -> serde_json::Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("one JSON document on stdout")
}

#[test]
fn eval_prints_the_agreed_document() {
    let report = json(&surefoot(&[
        "eval",
        "--maps",
        "1000",
        "--size",
        "100",
        "--goals",
        "12",
        "--vertices",
        "30",
        "--neighbours",
        "6",
        "--repeats",
        "1",
        "--json",
    ]));
    assert_eq!(report["method"], "spaced");
    assert_eq!(report["maps"], serde_json::json!([1000]));
    for difficulty in ["all", "easy", "medium", "hard"] {
        let rate = &report["success"][difficulty];
        assert!(rate["low"].as_f64() <= rate["rate"].as_f64() && rate["rate"].as_f64() <= rate["high"].as_f64());
    }
    assert_eq!(report["success"]["all"]["n"], 12);
    let ends = report["ends"].as_object().unwrap();
    assert_eq!(ends.values().map(|count| count.as_u64().unwrap()).sum::<u64>(), 12);
    for figure in ["vertices", "edges", "islands", "build_s", "probes", "search_us_median"] {
        assert!(report["graph"][figure].is_number(), "no {figure}");
    }
}

#[test]
fn bad_input_ends_with_one_clear_line() {
    let cases: [(&[&str], &str); 7] = [
        (&["eval", "--maps", "nowhere"], "--maps takes training, validation, test"),
        (&["eval", "--distance", "9..3"], "expected MIN..MAX"),
        (&["eval", "--goals", "0"], "--goals is 0"),
        (&["eval", "--model", "/does/not/exist"], "/does/not/exist/manifest.json"),
        (&["eval", "--vertices", "1"], "settings.vertices is 1"),
        (&["map", "show", "1", "--size", "20"], "size.width is 20"),
        (&["health", "http://127.0.0.1:1"], "cannot connect"),
    ];
    for (args, words) in cases {
        let output = surefoot(args);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "{args:?} was accepted");
        assert!(message.contains(words), "{args:?} says `{message}`");
        assert_eq!(message.lines().count(), 1, "{args:?} says `{message}`");
    }
}

#[test]
fn a_map_is_described_and_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("map.png");
    let map = json(&surefoot(&["map", "show", "5", "--size", "60", "--json", "--png", picture.to_str().unwrap()]));
    assert_eq!(map["size"]["width"], 60);
    assert!(map["triangles"].as_u64().unwrap() > 1000);
    assert!(std::fs::read(&picture).unwrap().starts_with(b"\x89PNG"));
}

#[test]
fn a_scene_ends_with_arrivals_and_leaves_its_graphs_in_the_cache() {
    let cache = tempfile::tempdir().unwrap();
    let folder = cache.path().to_str().unwrap();
    let size = ["--maps", "1", "--npcs", "48", "--vertices", "60", "--neighbours", "6", "--repeats", "1"];
    let addresses = ["--listen", "127.0.0.1:0", "--planner-listen", "127.0.0.1:0", "--cache", folder];
    let summary = json(&surefoot(&[&["up", "--for", "25", "--json"], &size[..], &addresses[..]].concat()));
    assert!(summary["arrivals"].as_u64().unwrap() > 0, "{summary}");
    assert!(cache.path().join("graphs.redb").exists());
}

#[cfg(unix)]
#[test]
fn a_server_ends_cleanly_on_sigterm() {
    let mut server = Command::new(env!("CARGO_BIN_EXE_surefoot"))
        .args(["serve", "--listen", "127.0.0.1:0"])
        .stderr(Stdio::piped())
        .spawn()
        .expect("the server starts");
    let mut log = std::io::BufReader::new(server.stderr.take().expect("piped"));
    let mut line = String::new();
    std::io::BufRead::read_line(&mut log, &mut line).expect("a log line");
    assert!(line.contains("world server ready"), "{line}");
    let killed = Command::new("kill").args(["-TERM", &server.id().to_string()]).status().expect("kill runs");
    assert!(killed.success());
    // Reads until the process closes its end, so that it never blocks on a full pipe.
    std::io::Read::read_to_string(&mut log, &mut line).expect("the rest of the log");
    assert!(server.wait().expect("the server ends").success(), "{line}");
}
