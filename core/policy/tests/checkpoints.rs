//! Weights on disk: whole, damaged, and of another shape.

use crate::{act, model, observations};
use std::path::Path;
use surefoot_policy::checkpoint::{self, MANIFEST_FILE, WEIGHTS_FILE};
use surefoot_policy::{ActorConfig, CheckpointError, Manifest, Policy, Weights};
use surefoot_world::sense::OBSERVATION_VERSION;

fn save(folder: &Path) -> Policy {
    let config = ActorConfig { ray_features: 16, hidden: 32, memory: None, sees_others: false };
    let (manifest, weights) = model(config);
    checkpoint::save(folder, &manifest, &weights).unwrap();
    Policy::from_bytes(manifest, &weights).unwrap()
}

#[test]
fn saved_weights_decide_as_before() {
    let folder = tempfile::tempdir().unwrap();
    let saved = save(folder.path());
    let loaded = Policy::load(folder.path()).unwrap();
    let observations = observations(&saved, 5);
    assert_eq!(act(&saved, &observations, &[]), act(&loaded, &observations, &[]));
    assert_eq!(loaded.manifest().name, "test");
}

#[test]
fn two_saves_that_are_killed_one_after_the_other_leave_a_whole_model() {
    let sizes = |hidden| ActorConfig { ray_features: 16, hidden, memory: None, sees_others: false };
    let (folder, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let at = |name: &str| folder.path().join(name);
    let hidden = || Policy::load(folder.path()).unwrap().manifest().actor.hidden;
    save(folder.path());
    // Killed after it wrote its manifest.
    let (manifest, weights) = model(sizes(24));
    checkpoint::save(other.path(), &manifest, &weights).unwrap();
    std::fs::copy(other.path().join(MANIFEST_FILE), at(MANIFEST_FILE)).unwrap();
    std::fs::copy(other.path().join(WEIGHTS_FILE), at("weights.next")).unwrap();
    assert_eq!(hidden(), 24);
    // Ends after it wrote its weights, because its manifest cannot be written.
    std::fs::create_dir(at("manifest.tmp")).unwrap();
    let (manifest, weights) = model(sizes(40));
    assert!(checkpoint::save(folder.path(), &manifest, &weights).is_err());
    assert_eq!(hidden(), 24);
    std::fs::remove_dir(at("manifest.tmp")).unwrap();
    checkpoint::save(folder.path(), &manifest, &weights).unwrap();
    assert_eq!(hidden(), 40);
}

#[test]
fn damaged_missing_and_foreign_weights_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    save(folder.path());
    let (weights, manifest) = (folder.path().join(WEIGHTS_FILE), folder.path().join(MANIFEST_FILE));
    let (good_weights, good_manifest) = (std::fs::read(&weights).unwrap(), std::fs::read_to_string(&manifest).unwrap());

    std::fs::write(&weights, &good_weights[..good_weights.len() / 2]).unwrap();
    assert!(matches!(Policy::load(folder.path()), Err(CheckpointError::Damaged { .. })));
    std::fs::write(&weights, &good_weights).unwrap();

    let version = format!("\"observation_version\": {OBSERVATION_VERSION}");
    assert!(good_manifest.contains(&version));
    std::fs::write(&manifest, good_manifest.replace(&version, "\"observation_version\": 99")).unwrap();
    let refusal = Policy::load(folder.path()).unwrap_err().to_string();
    assert!(refusal.contains("observation_version is 99"), "{refusal}");

    std::fs::write(&manifest, good_manifest.replace("\"hidden\": 32", "\"hidden\": 64")).unwrap();
    assert!(matches!(Policy::load(folder.path()), Err(CheckpointError::Mismatch { field: "a parameter", .. })));

    std::fs::write(&manifest, "{").unwrap();
    assert!(matches!(Policy::load(folder.path()), Err(CheckpointError::Manifest { .. })));

    std::fs::remove_file(&manifest).unwrap();
    let refusal = Policy::load(folder.path()).unwrap_err().to_string();
    assert!(refusal.contains("manifest.json"), "{refusal}");
}

#[test]
fn a_manifest_with_sizes_that_are_not_allowed_or_not_the_weights_is_refused() {
    let config = ActorConfig { ray_features: 2, hidden: 3, memory: None, sees_others: false };
    let (sound, weights) = model(config);
    let refusal = |actor| {
        let manifest = Manifest::new("greedy", actor, &weights, serde_json::Value::Null);
        Policy::from_bytes(manifest, &weights).unwrap_err().to_string()
    };
    assert!(Policy::from_bytes(sound, &weights).is_ok());
    // Each of these once allocated its memory, or crashed the program, before the weights were checked.
    for actor in [
        ActorConfig { hidden: 1 << 40, ..config },
        ActorConfig { ray_features: usize::MAX, ..config },
        ActorConfig { memory: std::num::NonZeroUsize::new(1 << 20), ..config },
        ActorConfig { hidden: 0, ..config },
        ActorConfig { ray_features: 0, ..config },
    ] {
        let message = refusal(actor);
        assert!(message.contains("sizes that are not allowed"), "{message}");
    }
    let message = refusal(ActorConfig { ray_features: 4096, hidden: 4096, ..config });
    assert!(message.contains("this program has head.weight: [4096, 8]"), "{message}");
}

#[test]
fn damaged_burnpack_files_are_refused_with_the_reason() {
    let config = ActorConfig { ray_features: 2, hidden: 3, memory: None, sees_others: false };
    let (_, weights) = model(config);
    let refusal = |bytes: &[u8]| Weights::from_burnpack(&config, bytes).unwrap_err().to_string();
    assert!(refusal(&[]).contains("no header"));
    assert!(refusal(&weights[..40]).contains("metadata is cut off"));
    assert!(refusal(&weights[..weights.len() - 1]).contains("trunk.second.weight: it is cut off"));
    let edited = |from: &[u8], to: &[u8]| {
        let at = weights.windows(from.len()).position(|window| window == from).unwrap();
        let mut edited = weights.clone();
        edited[at..at + to.len()].copy_from_slice(to);
        refusal(&edited)
    };
    assert!(edited(b"NRUB", b"BURN").contains("not a burnpack file"));
    assert!(edited(b"cF32", b"cF16").contains("its type is F16"));
}
