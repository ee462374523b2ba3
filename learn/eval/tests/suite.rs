//! Evaluation by units: saving, resuming, and summarising beside the paper's table.

use surefoot_eval::ablation::{self, Factor, Policies};
use surefoot_eval::record::Comparison;
use surefoot_eval::suite::{self, Entry};
use surefoot_eval::{EvalConfig, EvalMap, Method, Price, Report, Shard, evaluate};
use surefoot_planner::BuildSettings;
use surefoot_policy::Policy;
use surefoot_rollout::FollowConfig;
use surefoot_world::{CharacterProfile, MapSpec};

fn maps() -> Vec<MapSpec> {
    [1000, 1001].map(|seed| MapSpec::with_side(seed, 60).unwrap()).to_vec()
}

fn config(keep_in: Option<&tempfile::TempDir>, thread_count: usize) -> EvalConfig {
    EvalConfig {
        maps: maps().into_iter().map(EvalMap::from).collect(),
        profile: CharacterProfile::default(),
        goals: 9,
        seeds: vec![0, 1],
        method: Method::Policy,
        distance: 1.0..f32::INFINITY,
        noise_share: 0.5,
        rehearses: true,
        follow: FollowConfig::default(),
        price: Price::Risk,
        thread_count,
        keep_in: keep_in.map(|folder| folder.path().to_owned()),
        shard: None,
        game: None,
        graph: None,
        record: None,
    }
}

fn report(config: &EvalConfig) -> Report {
    evaluate(&Policy::shipped().unwrap(), config, |_, _| {}).unwrap()
}

#[test]
fn finished_units_are_loaded_from_disk_and_damaged_ones_run_again() {
    let folder = tempfile::tempdir().unwrap();
    let fresh = report(&config(None, 2));
    assert_eq!(report(&config(Some(&folder), 1)), fresh, "threads and disk change nothing");
    assert_eq!(fresh.success.all.n, 36);
    let mut units: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
    units.sort();
    assert_eq!(units.len(), 4);

    // A saved unit is loaded: an altered outcome shows in the report.
    let text = std::fs::read_to_string(&units[0]).unwrap();
    assert!(text.contains("Reached") || text.contains("reached"));
    std::fs::write(&units[0], text.replacen("\"reached\"", "\"drowned\"", 1)).unwrap();
    assert_eq!(report(&config(Some(&folder), 2)).ends["drowned"], fresh.ends["drowned"] + 1);

    // A truncated file is not loaded.
    std::fs::write(&units[0], &text[..text.len() / 2]).unwrap();
    assert_eq!(report(&config(Some(&folder), 2)), fresh);
    assert_eq!(std::fs::read_to_string(&units[0]).unwrap(), text);

    // Another number of goals gives other units.
    report(&EvalConfig { goals: 8, ..config(Some(&folder), 2) });
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 8);
}

#[test]
fn the_suite_stands_beside_the_papers_table() {
    let policy = Policy::shipped().unwrap();
    let entries = [
        Entry { name: "general reactive", method: Method::Policy, models: vec![(policy.clone(), maps())] },
        Entry {
            name: "map-specific LSTM",
            method: Method::Policy,
            models: maps().into_iter().map(|spec| (policy.clone(), vec![spec])).collect(),
        },
    ];
    let splits = [("training", vec![MapSpec::with_side(0, 60).unwrap()]), ("test", maps())];
    // The method of each entry overrides the method of the base.
    let base = EvalConfig { method: Method::Graph(BuildSettings::default()), ..config(None, 2) };
    let report = suite::run(&entries, &splits, &base, |_, _, _| {}).unwrap();
    let [general, specific] = report.rows.as_slice() else { panic!("two rows") };
    assert_eq!(general.success, specific.success, "the same weights on the same goals");
    assert!((general.efficiency - general.success.all.rate).abs() < 1.0e-9, "both rows found the same shortest paths");
    assert_eq!(general.by_distance.iter().map(|(_, rate)| rate.n).sum::<usize>(), 36);
    assert_eq!(general.ends.values().sum::<usize>(), 36);
    let [only] = report.generalisation.as_slice() else { panic!("only one model is bound to no map") };
    let first_seed = EvalConfig { seeds: vec![0], ..config(None, 2) };
    assert_eq!(only.splits[1].1, evaluate(&policy, &first_seed, |_, _| {}).unwrap().success.all);
    assert_eq!(only.splits.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["training", "test"]);
    let table = report.markdown();
    for words in ["| general reactive | **", "(68.0)", "(57.4)", "| map-specific LSTM |", "(89.9)", "no progress"] {
        assert!(table.contains(words), "{words} is missing in\n{table}");
    }
}

#[test]
fn an_ablation_changes_one_factor_at_a_time_and_shares_graphs() {
    let policy = Policy::shipped().unwrap();
    let policies = Policies { recurrent: policy.clone(), reactive: policy };
    let settings = BuildSettings::default()
        .with(|it| {
            it.vertices = 40;
            it.neighbours = 6;
        })
        .unwrap();
    let folder = tempfile::tempdir().unwrap();
    let base = EvalConfig { seeds: vec![0], ..config(Some(&folder), 2) };
    let mut units = 0;
    let report = ablation::run(&policies, &base, settings, |done, total| {
        units = done;
        assert_eq!(total, 2 * 18);
    })
    .unwrap();
    assert_eq!(units, 36);
    assert_eq!((report.paper.ours.len(), report.ours.ours.len(), report.factors.len()), (0, 8, 8));
    for it in &report.factors {
        assert_eq!((it.alone.ours.as_slice(), it.without.ours.len()), ([it.factor].as_slice(), 7));
        let adds = it.alone.success.mean - report.paper.success.mean;
        assert!((it.adds_to_paper.mean - adds).abs() < 1.0e-9, "{it:?}");
    }
    // Both policies are the same here.
    assert_eq!(report.factors[0].factor, Factor::Policy);
    assert!(report.factors[0].adds_to_paper.mean.abs() < 1.0e-9);
    // Attempts with rehearsals and without are not the same units.
    let count = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(count, 32, "all but those in which only equal policies differ");
    assert_eq!(ablation::run(&policies, &base, settings, |_, _| {}).unwrap(), report, "from the saved units");
    let table = report.markdown();
    assert!(table.contains("| rehearsals | ") && table.contains("2 maps, 9 goals"), "{table}");
    let one = EvalConfig { maps: base.maps[..1].to_vec(), ..base };
    assert!(ablation::run(&policies, &one, settings, |_, _| {}).unwrap_err().to_string().contains("two maps"));
}

#[test]
fn shards_together_are_the_whole_whatever_ran_where_and_how_often() {
    let (parts, whole) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let config = |folder, shard| EvalConfig { shard, seeds: (0..4).collect(), ..config(Some(folder), 1) };
    let policy = surefoot_policy::Policy::shipped().unwrap();
    let count = || std::fs::read_dir(parts.path()).map_or(0, |entries| entries.count());
    let mut counts = Vec::new();
    for idx in [2, 0, 2, 1] {
        evaluate(&policy, &config(&parts, Some(Shard { idx, count: 3 })), |_, _| {}).unwrap();
        counts.push(count());
    }
    let units = config(&whole, None).maps.len() * 4;
    assert!(counts[0] < units && counts[1] > counts[0], "a part is not the whole: {counts:?}");
    assert_eq!((counts[2], counts[3]), (counts[1], units), "a part that runs again adds nothing: {counts:?}");
    let [from_parts, at_once] =
        [&parts, &whole].map(|folder| evaluate(&policy, &config(folder, None), |_, _| {}).unwrap());
    assert_eq!(count(), units, "nothing was left to run");
    assert_eq!(from_parts.success, at_once.success);
    assert_eq!(from_parts.ends, at_once.ends);
}

#[test]
fn a_difference_counts_when_it_is_more_than_chance() {
    let of = |lost, gained| Comparison { lost, gained, ..Comparison::default() };
    assert!((of(0, 0).chance() - 1.0).abs() < 1.0e-12);
    // Two-sided: 2 * (1 + 10) / 2^10.
    assert!((of(1, 9).chance() - 22.0 / 1024.0).abs() < 1.0e-12);
    assert!((of(9, 1).chance() - of(1, 9).chance()).abs() < 1.0e-12);
    assert!(of(40, 45).agrees() && !of(60, 20).agrees() && !of(9, 0).agrees());
}
