//! The cache on disk: truncated and damaged files, eviction, layers and live evidence.

use redb::{Database, TableDefinition};
use std::collections::BTreeMap;
use std::path::Path;
use surefoot_planner::edits::{Edit, Layer};
use surefoot_planner::evidence::{Evidence, TryEnd};
use surefoot_planner::graph::GraphData;
use surefoot_planner::live::{LiveEvidence, Reporter, Traversal};
use surefoot_planner::store::{
    Call, GraphStore, LevelId, MAX_RECEIPTS, Receipt, decode_layer, decode_live, encode_layer,
};
use surefoot_planner::{BuildStats, GraphId};
use surefoot_planner::{Built, Edge, EdgeKey, NavGraph};
use surefoot_planner_service::store::{DEFAULT_LIMIT_BYTES, DiskStore};
use surefoot_world::Vec3;
use surefoot_world::{Ability, Decisions};

/// A graph that its number of vertices identifies.
fn built(vertices: u32) -> Built {
    let edges = (1..vertices).map(|to| {
        let mut evidence = Evidence::default();
        evidence.note(TryEnd::Arrived, 7, Ability::JUMP);
        Edge { key: EdgeKey::new(to - 1, to), evidence }
    });
    let graph = NavGraph::check(GraphData {
        vertices: (0..vertices).map(|idx| Vec3::new(3.0 * idx as f32, 0.0, 0.0)).collect(),
        edges: edges.collect(),
        ..GraphData::default()
    });
    Built { graph: graph.unwrap(), stats: BuildStats { probes: u64::from(vertices), ..BuildStats::default() } }
}

fn id(number: u8) -> GraphId {
    GraphId([number; 32])
}

fn worker() -> Reporter {
    Reporter { name: "worker".to_owned(), is_trusted: true }
}

fn open(folder: &Path) -> DiskStore {
    DiskStore::open(folder, DEFAULT_LIMIT_BYTES).unwrap()
}

#[test]
fn a_truncated_or_damaged_file_never_yields_a_wrong_graph() {
    let folder = tempfile::tempdir().unwrap();
    {
        let store = open(folder.path());
        (1..=3).for_each(|number| store.put(&id(number), &built(20 * u32::from(number))).unwrap());
    }
    let whole = std::fs::read(folder.path().join("graphs.redb")).unwrap();
    let mut lost = 0;
    // Steps are odd, so that all positions within a page and all bits of a byte occur.
    let flips = (0..whole.len() * 8).step_by((whole.len() * 8 / 150) | 1).map(|bit| {
        let mut bytes = whole.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        bytes
    });
    let cuts = (0..whole.len()).step_by((whole.len() / 40) | 1).map(|length| whole[..length].to_vec());
    for bytes in flips.chain(cuts) {
        let damaged = tempfile::tempdir().unwrap();
        std::fs::write(damaged.path().join("graphs.redb"), bytes).unwrap();
        let Ok(store) = DiskStore::open(damaged.path(), DEFAULT_LIMIT_BYTES) else {
            lost += 3;
            continue;
        };
        for number in 1..=3 {
            match store.get(&id(number)) {
                Ok(Some(found)) => {
                    let expected = built(20 * u32::from(number));
                    assert_eq!(found.graph.to_data(), expected.graph.to_data());
                    assert_eq!(found.stats, expected.stats);
                }
                Ok(None) | Err(_) => lost += 1,
            }
        }
    }
    assert!(lost > 0, "no damage was detected");
}

#[test]
fn a_file_of_garbage_is_set_aside() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("graphs.redb"), b"not a database, but long enough to have a header").unwrap();
    let store = open(folder.path());
    store.put(&id(1), &built(2)).unwrap();
    assert!(folder.path().join("graphs.redb.damaged").exists());
    assert!(store.get(&id(1)).unwrap().is_some());
}

#[test]
fn a_damaged_file_never_overwrites_an_earlier_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let names = ["graphs.redb.damaged", "graphs.redb.damaged-2", "graphs.redb.damaged-3"];
    for name in names {
        std::fs::write(path("graphs.redb"), format!("not a database, to be kept as {name}")).unwrap();
        drop(open(folder.path()));
    }
    for name in names {
        assert!(std::fs::read_to_string(path(name)).unwrap().ends_with(name));
    }
}

#[test]
fn a_file_that_may_be_whole_stops_the_start_and_stays() {
    // Written by a later version: both headers name a later format.
    let folder = tempfile::tempdir().unwrap();
    open(folder.path()).put(&id(1), &built(2)).unwrap();
    let path = folder.path().join("graphs.redb");
    let whole = std::fs::read(&path).unwrap();
    for (version, words) in [(9, "a newer version of surefoot"), (1, "Manual upgrade required")] {
        let mut bytes = whole.clone();
        (bytes[64], bytes[192]) = (version, version);
        std::fs::write(&path, &bytes).unwrap();
        let error = DiskStore::open(folder.path(), DEFAULT_LIMIT_BYTES).unwrap_err();
        assert!(error.reason.contains(words), "{error}");
        assert!(std::fs::read(&path).unwrap() == bytes && !folder.path().join("graphs.redb.damaged").exists());
    }
    // Something that cannot be opened at all.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("graphs.redb");
    std::fs::create_dir(&path).unwrap();
    DiskStore::open(folder.path(), DEFAULT_LIMIT_BYTES).unwrap_err();
    assert!(path.is_dir(), "it is not renamed");
    // Open in another store.
    let folder = tempfile::tempdir().unwrap();
    let _first = open(folder.path());
    let error = DiskStore::open(folder.path(), DEFAULT_LIMIT_BYTES).unwrap_err();
    assert!(error.reason.contains("another process"), "{error}");
}

fn layer(name: &str) -> Layer {
    Layer { name: name.to_owned(), edits: vec![Edit::AddVertex { at: Vec3::ONE }] }
}

#[test]
fn layers_in_an_earlier_cache_file_move_to_files_of_their_own_once() {
    const LAYERS: TableDefinition<'_, &[u8], &[u8]> = TableDefinition::new("layers");
    let folder = tempfile::tempdir().unwrap();
    let level = LevelId::of(b"one");
    let write = |entries: &[(&str, Vec<u8>)]| {
        let database = Database::create(folder.path().join("graphs.redb")).unwrap();
        let transaction = database.begin_write().unwrap();
        for (name, bytes) in entries {
            let key = [level.0.as_slice(), name.as_bytes()].concat();
            transaction.open_table(LAYERS).unwrap().insert(key.as_slice(), bytes.as_slice()).unwrap();
        }
        transaction.commit().unwrap();
    };
    let damaged = encode_layer(&layer("c/d"))[1..].to_vec();
    write(&[("a", encode_layer(&layer("a"))), ("B", encode_layer(&layer("B"))), ("c/d", damaged)]);
    for _ in 0..2 {
        let found = open(folder.path()).layers(&level).unwrap();
        assert_eq!(found.layers, [layer("B"), layer("a")]);
        assert_eq!(found.damaged.len(), 1);
        assert_eq!(found.damaged[0].name, "c/d");
        assert!(found.whole().is_err(), "a damaged layer is not left out");
    }
    // What has a file already is newer than what the cache file has.
    let newer = Layer { edits: vec![Edit::RemoveVertex { at: Vec3::ONE }], ..layer("a") };
    open(folder.path()).put_layer(&level, &newer).unwrap();
    write(&[("a", encode_layer(&layer("a")))]);
    let store = open(folder.path());
    assert_eq!(store.layers(&level).unwrap().layers, [layer("B"), newer]);
    store.put_layer(&level, &layer("c/d")).unwrap();
    store.put_layer(&level, &Layer { edits: Vec::new(), ..layer("a") }).unwrap();
    drop(store);
    assert_eq!(open(folder.path()).layers(&level).unwrap().whole().unwrap(), [layer("B"), layer("c/d")]);
}

#[test]
fn layers_outlive_a_damaged_cache_file() {
    let folder = tempfile::tempdir().unwrap();
    let level = LevelId::of(b"one");
    open(folder.path()).put_layer(&level, &layer("night")).unwrap();
    std::fs::write(folder.path().join("graphs.redb"), b"not a database, but long enough to have a header").unwrap();
    assert_eq!(open(folder.path()).layers(&level).unwrap().whole().unwrap(), [layer("night")]);
}

#[test]
fn the_least_recently_used_graphs_are_evicted() {
    let folder = tempfile::tempdir().unwrap();
    let size = {
        let store = open(folder.path());
        store.put(&id(9), &built(400)).unwrap();
        postcard::to_stdvec(&built(400).graph.to_data()).unwrap().len() as u64
    };
    let folder = tempfile::tempdir().unwrap();
    let store = DiskStore::open(folder.path(), 3 * size + size / 2).unwrap();
    (1..=3).for_each(|number| store.put(&id(number), &built(400)).unwrap());
    assert!(store.get(&id(1)).unwrap().is_some());
    store.put(&id(4), &built(400)).unwrap();
    let kept: Vec<u8> = (1..=4).filter(|&number| store.get(&id(number)).unwrap().is_some()).collect();
    assert_eq!(kept, [1, 3, 4], "the second was used least recently");
    // A graph larger than the whole limit is kept until the next one is stored.
    store.put(&id(5), &built(4000)).unwrap();
    assert!(store.get(&id(5)).unwrap().is_some());
}

#[test]
fn layers_and_live_evidence_persist() {
    let folder = tempfile::tempdir().unwrap();
    let (level, other) = (LevelId::of(b"one"), LevelId::of(b"two"));
    let graph = built(5);
    let mut live = LiveEvidence::default();
    live.note(&graph.graph, &worker(), &Traversal { edge: EdgeKey::new(0, 1), end: TryEnd::Failed, decisions: 9 })
        .unwrap();
    {
        let store = open(folder.path());
        store.put_layer(&level, &layer("night")).unwrap();
        store.put_layer(&level, &layer("day")).unwrap();
        store.put_layer(&other, &layer("else")).unwrap();
        store.put_live(&id(1), &live, &[]).unwrap();
    }
    let store = open(folder.path());
    assert_eq!(store.layers(&level).unwrap().whole().unwrap(), [layer("day"), layer("night")]);
    assert_eq!(store.live(&id(1)).unwrap(), live);
    assert!(store.live(&id(2)).unwrap().is_empty());
    store.put_layer(&level, &Layer { edits: Vec::new(), ..layer("day") }).unwrap();
    assert_eq!(store.layers(&level).unwrap().whole().unwrap(), [layer("night")]);
    assert_eq!(store.layers(&LevelId::of(b"three")).unwrap().whole().unwrap(), []);
}

fn receipt(client: &str, number: usize) -> Receipt {
    let call = Call { client: client.to_owned(), id: number.to_string(), request: [number as u8; 32] };
    Receipt { call, answer: vec![number as u8; 3] }
}

#[test]
fn a_receipt_counts_once_its_layer_is_stored_and_goes_on_counting_when_the_layer_changes() {
    let folder = tempfile::tempdir().unwrap();
    let level = LevelId::of(b"one");
    let store = open(folder.path());
    assert!(store.replace_layer(&level, 0, &layer("night"), Some(&receipt("a", 1))).unwrap());
    // A folder that cannot be written stands for a crash between the receipt and the layer.
    let levels = folder.path().join("layers");
    let aside = folder.path().join("aside");
    std::fs::rename(&levels, &aside).unwrap();
    std::fs::write(&levels, b"a file where a folder belongs").unwrap();
    store.replace_layer(&level, 0, &layer("day"), Some(&receipt("a", 2))).unwrap_err();
    std::fs::remove_file(&levels).unwrap();
    std::fs::rename(&aside, &levels).unwrap();
    assert_eq!(store.receipt("a", "2").unwrap(), None);
    store.put_layer(&level, &Layer { edits: Vec::new(), ..layer("night") }).unwrap();
    assert_eq!(store.receipt("a", "1").unwrap(), Some(receipt("a", 1)));
    drop(store);
    let store = open(folder.path());
    // Had it been kept, it would count by chance now.
    store.put_layer(&level, &layer("day")).unwrap();
    assert_eq!(store.receipt("a", "2").unwrap(), None);
    assert_eq!(store.receipt("a", "1").unwrap(), Some(receipt("a", 1)));
    assert_eq!(store.receipt("b", "1").unwrap(), None, "each client has its own ids");
}

#[test]
fn each_client_keeps_its_latest_receipts() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path());
    let put = |receipts: &[Receipt]| store.put_live(&id(1), &LiveEvidence::default(), receipts).unwrap();
    put(&[receipt("quiet", 1)]);
    let all: Vec<Receipt> = (0..MAX_RECEIPTS).map(|number| receipt("loud", number)).collect();
    put(&all);
    put(&[receipt("loud", MAX_RECEIPTS), receipt("loud", MAX_RECEIPTS)]);
    let is_kept = |number: &usize| store.receipt("loud", &number.to_string()).unwrap().is_some();
    assert_eq!((0..=MAX_RECEIPTS).filter(is_kept).count(), MAX_RECEIPTS);
    assert!(is_kept(&MAX_RECEIPTS), "the latest");
    assert_eq!(store.receipt("quiet", "1").unwrap(), Some(receipt("quiet", 1)));
}

#[test]
fn invalid_evidence_and_layers_count_as_damaged() {
    type Edges = BTreeMap<(u32, u32), Evidence>;
    #[derive(serde::Serialize)]
    struct Stored(BTreeMap<(&'static str, bool), Edges>);
    let sealed = |content: Vec<u8>| [blake3::hash(&content).as_bytes().as_slice(), &content].concat();
    let entry = |change: fn(&mut Evidence)| {
        let mut evidence = Evidence::forced(Decisions(7.0));
        change(&mut evidence);
        let edges = BTreeMap::from([((0, 1), evidence)]);
        sealed(postcard::to_stdvec(&Stored(BTreeMap::from([(("worker", true), edges)]))).unwrap())
    };
    // Regression: more tries than live evidence can hold overflowed when they were added to the probes.
    assert!(decode_live(&entry(|_| {})).is_ok());
    assert!(decode_live(&entry(|evidence| evidence.tries = u32::MAX)).is_err());
    assert!(decode_live(&entry(|evidence| evidence.successes = 2)).is_err());
    assert!(decode_live(&entry(|evidence| evidence.prior = f32::NAN)).is_err());
    let layer = |edit: &str| decode_layer(&sealed(format!(r#"{{"name":"night","edits":[{edit}]}}"#).into_bytes()));
    assert!(layer(r#"{"edit":"add_vertex","at":[1,2,3]}"#).is_ok());
    // Regression: a number beyond the range of floats became an infinite coordinate.
    assert!(layer(r#"{"edit":"add_vertex","at":[1e39,2,3]}"#).is_err());
    assert!(layer(r#"{"edit":"price_edge","from":[1,2,3],"to":[4,5,6],"factor":-1}"#).is_err());
}

#[test]
fn live_evidence_adds_to_an_edge_with_the_maximum_number_of_tries() {
    let mut data = built(2).graph.to_data();
    let evidence = &mut data.edges[0].evidence;
    (evidence.tries, evidence.successes) = (u32::MAX, u32::MAX);
    let graph = NavGraph::check(data).unwrap();
    let mut live = LiveEvidence::default();
    live.note(&graph, &worker(), &Traversal { edge: EdgeKey::new(0, 1), end: TryEnd::Arrived, decisions: 9 }).unwrap();
    assert_eq!(live.apply_to(&graph).edge(EdgeKey::new(0, 1)).unwrap().evidence.tries, u32::MAX);
}
