//! The manifests of the shipped models: they hold every stage of training, and the pages state what they hold.

use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use surefoot_policy::Policy;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Folders below `models/` with a manifest.
fn models() -> Vec<PathBuf> {
    let folders = |folder: &Path| -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        entries.filter(|path| path.is_dir()).collect()
    };
    let all = folders(&root().join("models")).into_iter().flat_map(|folder| {
        let inside = folders(&folder);
        std::iter::once(folder).chain(inside)
    });
    all.filter(|folder| folder.join("manifest.json").exists()).collect()
}

fn training(folder: &Path) -> Value {
    let manifest: Value = serde_json::from_slice(&std::fs::read(folder.join("manifest.json")).unwrap()).unwrap();
    manifest["training"].clone()
}

/// A stage and those before it, the newest first.
fn stages(training: &Value) -> Vec<&Value> {
    std::iter::successors(Some(training), |stage| stage.get("started_from")).collect()
}

fn is_hash(value: &Value, digits: usize) -> bool {
    value.as_str().is_some_and(|it| it.len() == digits && it.bytes().all(|byte| byte.is_ascii_hexdigit()))
}

/// What a stage lacks.
fn gaps(stage: &Value) -> Vec<String> {
    let has_reason = |field: &str| {
        let reason = stage[format!("{field}_unknown")].as_str();
        stage.get(field).is_some_and(Value::is_null) && reason.is_some_and(|it| it.len() > 20)
    };
    let is_positive = |figure: &Value| figure.as_f64().is_some_and(|it| it > 0.0);
    let has_seed = stage["config"]["seed"].is_u64() || stage["seed"].is_u64();
    let has_maps = !stage["config"]["collector"]["map_seeds"].is_null() || is_positive(&stage["maps"]);
    let checks = [
        ("updates", is_positive(&stage["updates"])),
        ("decisions", is_positive(&stage["decisions"])),
        ("hours", is_positive(&stage["hours"])),
        ("validation", stage.get("validation").is_some()),
        ("seed", has_seed),
        ("maps", has_maps),
        ("config, or config_unknown with the reason", stage["config"].is_object() || has_reason("config")),
        ("revision, or revision_unknown with the reason", is_hash(&stage["revision"], 40) || has_reason("revision")),
        // The hash in `started_from` says which weights a run started from; a path does not.
        ("no config.start_from", stage["config"].get("start_from").is_none()),
    ];
    checks.into_iter().filter(|(_, holds)| !holds).map(|(what, _)| what.to_owned()).collect()
}

#[test]
fn the_manifests_hold_every_stage_of_training() {
    let models = models();
    assert!(models.len() >= 10, "{models:?}");
    for folder in models {
        let policy = Policy::load(&folder).unwrap();
        let training = training(&folder);
        let stages = stages(&training);
        for (idx, stage) in stages.iter().enumerate() {
            assert_eq!(gaps(stage), Vec::<String>::new(), "stage {idx} of {}", folder.display());
        }
        let earlier = &stages[1..];
        assert!(earlier.iter().all(|it| is_hash(&it["weights_hash"], 64) && it["name"].is_string()), "{training}");
        let hashes: BTreeSet<&str> = earlier.iter().filter_map(|stage| stage["weights_hash"].as_str()).collect();
        assert_eq!(hashes.len(), earlier.len(), "a stage of {} started from itself", folder.display());
        assert!(!hashes.contains(policy.weights_hash()), "{} started from itself", folder.display());
        for figure in ["updates", "decisions"] {
            let sum: u64 = stages.iter().map(|stage| stage[figure].as_u64().unwrap()).sum();
            assert_eq!(training["total"][figure], sum, "{figure} of {}", folder.display());
        }
        let hours: f64 = stages.iter().map(|stage| stage["hours"].as_f64().unwrap()).sum();
        assert!((training["total"]["hours"].as_f64().unwrap() - hours).abs() < 1.0e-9, "{}", folder.display());
    }
}

#[test]
fn models_that_are_not_made_from_nothing_have_earlier_stages() {
    for (model, count) in [("general-reactive", 5), ("general-lstm", 2), ("lstm-map-2000", 3), ("lstm-map-3000", 4)] {
        assert_eq!(stages(&training(&root().join("models").join(model))).len(), count, "{model}");
    }
    // A stage that more than one model went through is described alike.
    let lstm = training(&root().join("models/general-lstm"));
    for seed in [2000, 2001, 2002, 2003] {
        let start = &training(&root().join(format!("models/lstm-map-{seed}")))["started_from"];
        for field in ["updates", "decisions", "hours", "revision", "config", "started_from"] {
            assert_eq!(start[field], lstm[field], "{field} of the start of lstm-map-{seed}");
        }
    }
}

#[test]
fn the_page_about_models_states_the_sums_of_the_manifests() {
    let page = std::fs::read_to_string(root().join("docs/guides/training.md")).unwrap();
    for model in ["general-reactive", "general-lstm", "lstm-map-3000"] {
        let total = &training(&root().join("models").join(model))["total"];
        let (updates, hours) = (total["updates"].as_u64().unwrap(), total["hours"].as_f64().unwrap());
        let stated = format!("{},{:03} updates, {hours:.2} h", updates / 1000, updates % 1000);
        let row = page.lines().find(|line| line.starts_with(&format!("| `{model}`"))).unwrap();
        assert!(row.contains(&stated), "{row}: expected `{stated}`");
    }
}
