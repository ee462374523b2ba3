//! Published tables: what `eval --out` writes, and that `eval --check` finds what was changed since.

use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use std::io::{Read, Write};
use std::path::Path;
use std::process::Output;

fn eval(args: &[&str]) -> Output {
    let mut command = crate::surefoot();
    command.arg("eval").args(args).current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).output().unwrap()
}

fn check(folder: &Path, share: &str) -> Output {
    eval(&["--check", folder.to_str().unwrap(), "--share", share, "--json"])
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn json(bytes: &[u8]) -> serde_json::Value {
    serde_json::from_slice(bytes).unwrap()
}

fn hash(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

#[test]
fn a_table_says_what_it_was_made_with_and_holds_up_to_a_check() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path();
    let made = eval(&[
        "--suite",
        "dial",
        "--maps",
        "1000,1001",
        "--size",
        "60",
        "--goals",
        "3",
        "--vertices",
        "30",
        "--neighbours",
        "5",
        "--out",
        out.to_str().unwrap(),
    ]);
    assert!(made.status.success(), "{}", errors(&made));
    let provenance = json(&std::fs::read(out.join("provenance.json")).unwrap());
    assert_eq!(provenance["command"][1], "--suite");
    assert_eq!(provenance["models"][0]["name"], "general-reactive");
    // Nine rows, two maps, by policy and by plan.
    assert_eq!(provenance["attempts"]["units"], 36);
    assert!(std::fs::read_to_string(out.join("table.md")).unwrap().contains("| devices x 0.5, repaired |"));
    assert!(std::fs::read_to_string(out.join("success.svg")).unwrap().contains("the policy by plan"));

    let checked = check(out, "1");
    assert!(checked.status.success(), "{}", errors(&checked));
    let found = json(&checked.stdout);
    assert_eq!((&found["derived"], &found["agrees"]), (&true.into(), &true.into()));
    assert_eq!((&found["attempts"], &found["identical"]), (&108.into(), &108.into()));

    // A figure that was changed.
    let results = std::fs::read(out.join("results.json")).unwrap();
    let mut better = json(&results);
    better["rows"][0]["plan"]["success"]["mean"] = 2.0.into();
    std::fs::write(out.join("results.json"), better.to_string()).unwrap();
    assert!(errors(&check(out, "0")).contains("results.json does not match provenance.json"));
    let mut with_hash = provenance.clone();
    with_hash["results"] = hash(better.to_string().as_bytes()).into();
    std::fs::write(out.join("provenance.json"), with_hash.to_string()).unwrap();
    let found = check(out, "0");
    assert!(
        !found.status.success() && errors(&found).contains("do not follow from its attempts"),
        "{}",
        errors(&found)
    );
    std::fs::write(out.join("results.json"), &results).unwrap();

    // Attempts that were changed: all of them reached their goals.
    let mut text = String::new();
    let packed = std::fs::read(out.join("attempts.jsonl.gz")).unwrap();
    GzDecoder::new(packed.as_slice()).read_to_string(&mut text).unwrap();
    let mut better = text;
    for end in ["fell", "burnt", "drowned", "no_progress"] {
        better = better.replace(&format!("\"{end}\""), "\"reached\"");
    }
    let mut writer = GzEncoder::new(Vec::new(), Compression::fast());
    writer.write_all(better.as_bytes()).unwrap();
    let packed = writer.finish().unwrap();
    std::fs::write(out.join("attempts.jsonl.gz"), &packed).unwrap();
    let mut with_hash = provenance;
    std::fs::write(out.join("provenance.json"), with_hash.to_string()).unwrap();
    assert!(errors(&check(out, "0")).contains("attempts.jsonl.gz does not match provenance.json"));
    with_hash["attempts"]["hash"] = hash(&packed).into();
    std::fs::write(out.join("provenance.json"), with_hash.to_string()).unwrap();
    let found = check(out, "1");
    assert!(!found.status.success());
    assert!(json(&found.stdout)["lost"].as_u64().unwrap() > 0, "{}", errors(&found));
}

#[test]
fn the_figures_of_some_maps_follow_from_the_attempts_of_all() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let on = |maps: &str, more: &[&str]| {
        let small = ["--size", "60", "--goals", "4", "--method", "policy"];
        eval(&[&["--maps", maps][..], &small, more].concat())
    };
    let made = on("1000,1001,1002", &["--out", out]);
    assert!(made.status.success(), "{}", errors(&made));
    let alone = json(&on("1001,1002", &["--json"]).stdout);
    let part = eval(&["--check", out, "--maps", "1001,1002", "--json"]);
    assert!(part.status.success(), "{}", errors(&part));
    let part = json(&part.stdout);
    for figure in ["maps", "success", "by_map", "ends", "per_map"] {
        assert!(!part[figure].is_null());
        assert_eq!(part[figure], alone[figure], "{figure}");
    }
    let other = eval(&["--check", out, "--maps", "1003"]);
    assert!(errors(&other).contains("the record has no unit"), "{}", errors(&other));
}

#[test]
fn what_cannot_be_checked_says_why() {
    let folder = tempfile::tempdir().unwrap();
    assert!(errors(&check(folder.path(), "0")).contains("provenance.json"));
    std::fs::write(folder.path().join("provenance.json"), "{").unwrap();
    assert!(errors(&check(folder.path(), "0")).contains("is damaged"));
    let share = eval(&["--check", folder.path().to_str().unwrap(), "--share", "2"]);
    assert!(errors(&share).contains("--share is 2, allowed are 0 to 1"), "{}", errors(&share));
    let model = eval(&["--suite", "paper", "--model", "general-lstm"]);
    assert!(errors(&model).contains("from --models"), "{}", errors(&model));
}

#[test]
fn every_published_table_follows_from_its_attempts() {
    let results = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/results"));
    let folders = std::fs::read_dir(results).unwrap().map(|entry| entry.unwrap().path());
    let kept: Vec<_> = folders.filter(|folder| folder.join("attempts.jsonl.gz").exists()).collect();
    assert!(!kept.is_empty());
    for folder in kept {
        let checked = check(&folder, "0");
        assert!(checked.status.success(), "{}: {}", folder.display(), errors(&checked));
        assert_eq!(json(&checked.stdout)["derived"], true, "{}", folder.display());
    }
}
