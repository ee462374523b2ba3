//! The challenge as a stranger meets it: a set of their own levels, a run written by hand, a score, and a server that
//! hosts.

use std::path::Path;
use std::process::Output;

fn challenge(folder: &Path, args: &[&str]) -> Output {
    let mut command = crate::surefoot();
    command.arg("challenge").args(args).current_dir(folder).output().expect("the command runs")
}

fn json(bytes: &[u8]) -> serde_json::Value {
    serde_json::from_slice(bytes).expect("one JSON document")
}

fn says(output: &Output, words: &str) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains(words) && said.trim().lines().count() == 1, "{said}");
}

/// A square of 24 m, twice on top of each other, 9 m apart: no jump leads from one to the other.
const TWO_STOREYS: &str =
    "v 0 1 0\nv 24 1 0\nv 24 1 24\nv 0 1 24\nv 0 10 0\nv 24 10 0\nv 24 10 24\nv 0 10 24\nf 4 3 2 1\nf 8 7 6 5\n";

#[test]
fn a_stranger_draws_a_set_answers_it_and_is_scored() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    std::fs::write(home.join("storeys.obj"), TWO_STOREYS).unwrap();
    let drawn = challenge(home, &["set", "custom", "--maps", "storeys.obj", "--goals", "20", "--out", "set"]);
    assert!(drawn.status.success(), "{}", String::from_utf8_lossy(&drawn.stderr));
    for file in ["set.json", "storeys.sfmap", "storeys.glb"] {
        assert!(home.join("set").join(file).exists(), "{file}");
    }
    let set = json(&std::fs::read(home.join("set/set.json")).unwrap());
    let goals = set["maps"][0]["goals"].as_array().unwrap();
    // Straight on where the goal is on the same storey; beyond their edges there is nothing.
    let answer = |goal: &serde_json::Value| {
        let rise = goal["goal"][1].as_f64().unwrap() - goal["start"][1].as_f64().unwrap();
        let points = serde_json::json!([{ "at": goal["start"] }, { "at": goal["goal"], "by": "walk" }]);
        if rise.abs() > 1.0 { serde_json::json!("unreachable") } else { serde_json::json!({ "path": points }) }
    };
    let attempts: Vec<serde_json::Value> = goals.iter().map(answer).collect();
    let elsewhere = attempts.iter().filter(|it| it.is_string()).count();
    assert!((1..20).contains(&elsewhere), "the seed gives both");
    let run = serde_json::json!({
        "challenge": 2, "set": "custom", "entrant": "by hand",
        "maps": [{ "name": "storeys", "build_s": 0.5, "attempts": attempts }],
    });
    std::fs::write(home.join("run.json"), run.to_string()).unwrap();
    let scored = challenge(home, &["score", "run.json", "--set", "set", "--json"]);
    assert!(scored.status.success(), "{}", String::from_utf8_lossy(&scored.stderr));
    let score = json(&scored.stdout);
    assert_eq!(
        (&score["ends"]["unreachable"], &score["ends"]["reached"]),
        (&elsewhere.into(), &(20 - elsewhere).into())
    );
    assert_eq!(score["told"], 1.0, "nobody gets from one to the other");
    assert_eq!((&score["build_s"], &score["success"]["all"]["n"]), (&0.5.into(), &20.into()));
    let table = challenge(home, &["score", "run.json", "--set", "set"]);
    assert!(String::from_utf8_lossy(&table.stdout).contains("| by hand | custom ("));

    let recorded = challenge(home, &["record", "set", "--vertices", "40", "--name", "ours", "--out", "ours.json.gz"]);
    assert!(recorded.status.success(), "{}", String::from_utf8_lossy(&recorded.stderr));
    let both = challenge(home, &["score", "run.json", "ours.json.gz", "--set", "set", "--json"]);
    let both = json(&both.stdout);
    assert_eq!((&both[0], &both[1]["entrant"]), (&score, &"ours".into()));
    assert!(both[1]["ends"]["reached"].as_u64() >= both[0]["ends"]["reached"].as_u64(), "{both}");

    let runs = ["motion", "run.json", "ours.json.gz", "--shortest", "run.json", "--set", "set"];
    let moved = json(&challenge(home, &[&runs[..], &["--json"]].concat()).stdout);
    assert_eq!(
        (&moved["rows"][0]["measured"], &moved["rows"][1]["entrant"]),
        (&(20 - elsewhere).into(), &"ours".into())
    );
    assert!(moved["rows"][1]["path_over_shortest"].as_f64() > Some(0.9), "{moved}");
    let table = challenge(home, &runs);
    assert!(String::from_utf8_lossy(&table.stdout).contains("| storeys | by hand | "));

    says(&challenge(home, &["score", "run.json"]), "the sets of the challenge are paper-like, kinds, benchmark");
    says(&challenge(home, &["set", "custom", "--out", "other"]), "needs --maps");
    says(&challenge(home, &["set", "elsewhere", "--out", "other"]), "there is no set `elsewhere`");
    std::fs::write(home.join("run.json"), "{\"challenge\": 1}").unwrap();
    says(&challenge(home, &["score", "run.json", "--set", "set"]), "run.json is not a run");
    says(&challenge(home, &["host", "set", "--limit", "5"]), "map storeys is a level");
}

#[test]
fn a_server_hosts_a_part_of_a_set() {
    let home = tempfile::tempdir().unwrap();
    let hosted = challenge(home.path(), &["host", "paper-like:1x6", "--warm-up", "2", "--lockstep", "--json"]);
    assert!(hosted.status.success(), "{}", String::from_utf8_lossy(&hosted.stderr));
    let score = json(&hosted.stdout);
    assert_eq!((&score["mode"], &score["success"]["all"]["n"]), (&"lockstep".into(), &6.into()));
    assert!(score["success"]["all"]["rate"].as_f64().unwrap() > 0.8, "{}", score["ends"]);
    assert!(score["decisions_on_time_share"].as_f64().unwrap() > 0.99);
    assert!(score.get("metres_to_goal").is_none(), "the server does not tell");
}
