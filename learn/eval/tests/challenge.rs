//! The challenge: sets that stay what they are, runs that are believed in nothing but what they do, and a plain
//! controller.

use std::path::Path;
use surefoot_eval::EvalMap;
use surefoot_eval::challenge::motion::{Comparison, MotionRow, compare};
use surefoot_eval::challenge::record::{Entry, record};
use surefoot_eval::challenge::{Approach, GoalSet, MapRun, PathPoint, Run, VERSION, score};
use surefoot_planner::BuildSettings;
use surefoot_policy::Policy;
use surefoot_world::{Ability, CharacterProfile, MapSpec};

/// Two small maps with 12 goals each.
fn small() -> GoalSet {
    let spec = |seed| EvalMap::from(MapSpec::with_side(seed, 60).unwrap());
    let maps = vec![(spec(1000), None), (spec(1001), None)];
    GoalSet::draw("small", maps, CharacterProfile::default(), 12, 0).unwrap()
}

fn run_of(set: &GoalSet, approach: impl Fn(&surefoot_eval::challenge::SetGoal) -> Approach) -> Run {
    let map = |map: &surefoot_eval::challenge::SetMap| MapRun {
        name: map.name.clone(),
        build_s: 2.0,
        bytes: 10,
        attempts: map.goals.iter().map(&approach).collect(),
    };
    let maps = set.maps.iter().map(map).collect();
    Run { challenge: VERSION, set: set.set.clone(), entrant: "test".to_owned(), about: String::new(), maps }
}

fn straight(goal: &surefoot_eval::challenge::SetGoal) -> Approach {
    let at = |at| PathPoint { at, by: Ability::WALK };
    Approach::Path(vec![at(goal.start), at(goal.goal)])
}

#[test]
fn named_sets_stay_what_they_are() {
    // A change of these hashes is a new version of the challenge.
    for (name, hash) in [("paper-like:2x3", "2800068d477dec55"), ("kinds:7x2", "9c5e167b8ca7df48")] {
        assert_eq!(GoalSet::named(name).unwrap().hash()[..16], *hash, "{name}");
    }
    let part = GoalSet::named("paper-like:1x10").unwrap();
    assert_eq!((part.maps.len(), part.maps[0].goals.len()), (1, 10));
    for wrong in ["nothing", "paper-like:0x1", "paper-like:5x1", "paper-like:1x301", "paper-like:1"] {
        assert!(GoalSet::named(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn what_was_recorded_happens_again() {
    let set = small();
    let settings = BuildSettings::default().with(|it| it.vertices = 60).unwrap();
    let entry =
        Entry { name: "ours".to_owned(), policy: Policy::shipped().unwrap(), graph: Some(settings), thread_count: 2 };
    let by_plan = record(&entry, &set, Path::new(""), |_| {}).unwrap();
    // Through the text of a file.
    let text = serde_json::to_string(&by_plan).unwrap();
    assert_eq!(serde_json::from_str::<Run>(&text).unwrap(), by_plan);
    let scored = score(&set, Path::new(""), &by_plan, 2, |_| {}).unwrap();
    assert_eq!(scored.success.all.n, 24);
    assert!(scored.success.all.rate > 0.9, "{:?}", scored.ends);
    assert_eq!(score(&set, Path::new(""), &by_plan, 1, |_| {}).unwrap(), scored, "threads change nothing");

    // Without its last action, an attempt that reached its goal falls short.
    let mut cut = by_plan.clone();
    let is_actions = |approach: &&mut Approach| matches!(approach, Approach::Actions(actions) if actions.len() > 3);
    let Some(Approach::Actions(actions)) = cut.maps[0].attempts.iter_mut().find(is_actions) else { panic!() };
    actions.truncate(actions.len() - 2);
    let shorter = score(&set, Path::new(""), &cut, 2, |_| {}).unwrap();
    assert!(shorter.ends["reached"] < scored.ends["reached"]);
}

#[test]
fn the_scorer_believes_nothing_but_what_happens() {
    let set = small();
    let walked = score(&set, Path::new(""), &run_of(&set, straight), 2, |_| {}).unwrap();
    let told = score(&set, Path::new(""), &run_of(&set, |_| Approach::Unreachable), 2, |_| {}).unwrap();
    let idle = score(&set, Path::new(""), &run_of(&set, |_| Approach::Actions(Vec::new())), 2, |_| {}).unwrap();
    // Some goals are near enough for a straight line, and nobody gets anywhere by saying or doing nothing.
    assert!(walked.success.all.rate > told.success.all.rate, "{:?}", walked.ends);
    assert!(walked.success.all.rate < 1.0);
    assert_eq!((told.ends["unreachable"], idle.ends["no_progress"]), (24, 24));
    assert_eq!((walked.build_s, walked.bytes), (2.0, 10.0));
    // A path that ends elsewhere does not count, wherever it says it ends.
    let elsewhere = |goal: &surefoot_eval::challenge::SetGoal| {
        Approach::Path(vec![PathPoint { at: goal.start, by: Ability::WALK }])
    };
    let elsewhere = score(&set, Path::new(""), &run_of(&set, elsewhere), 2, |_| {}).unwrap();
    assert_eq!(elsewhere.success.all.rate, 0.0);
}

#[test]
fn a_run_that_does_not_answer_the_set_is_refused_by_name() {
    let set = small();
    let good = run_of(&set, |_| Approach::Unreachable);
    let changed = |change: fn(&mut Run)| {
        let mut run = good.clone();
        change(&mut run);
        score(&set, Path::new(""), &run, 1, |_| {}).unwrap_err().to_string()
    };
    for (error, words) in [
        (changed(|run| run.challenge = 9), "version 9"),
        (changed(|run| run.set = "kinds".to_owned()), "to the set `kinds`"),
        (changed(|run| drop(run.maps.pop())), "0 entries"),
        (changed(|run| run.maps[0].name = run.maps[1].name.clone()), "2 entries"),
        (changed(|run| drop(run.maps[0].attempts.pop())), "11 attempts"),
        (
            changed(|run| run.maps[0].attempts[3] = Approach::Actions(vec![[0.0, f32::NAN, 0.0, 0.0]])),
            "attempt 3 on `terrain-1000`: action[1] is NaN",
        ),
        (changed(|run| run.maps[0].attempts[0] = Approach::Actions(vec![[0.0; 4]; 1801])), "at most 1800"),
        (
            changed(|run| {
                let point = PathPoint { at: [f32::INFINITY, 0.0, 0.0], by: Ability::WALK };
                run.maps[0].attempts[0] = Approach::Path(vec![point]);
            }),
            "point 0 is not a place",
        ),
    ] {
        assert!(error.contains(words), "{error}");
    }
    let mut other = set.clone();
    other.maps[0].hash = "0".repeat(64);
    let error = score(&other, Path::new(""), &good, 1, |_| {}).unwrap_err().to_string();
    assert!(error.contains("differs from the map that the goals were drawn on"), "{error}");
}

/// The track of a body that slides straight to the goal at 6 m/s, so by 1 m in a decision, and looks where it goes; its
/// heading swings to both sides by `swing`, rad.
fn slide(goal: &surefoot_eval::challenge::SetGoal, swing: f32) -> Approach {
    let [from, to] = [goal.start, goal.goal];
    let way = [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
    let length = way.iter().map(|it| it * it).sum::<f32>().sqrt();
    let yaw = way[0].atan2(way[2]);
    let sample = |decision: u16| {
        let share = (f32::from(decision) / length).min(1.0);
        let side = if decision.is_multiple_of(2) { swing } else { -swing };
        let [x, y, z] = [0, 1, 2].map(|axis| from[axis] + share * way[axis]);
        let [speed_x, speed_y, speed_z] = way.map(|it| 6.0 * it / length);
        [x, y, z, yaw + side, speed_x, speed_y, speed_z, 0.0]
    };
    Approach::Track((0..=length.ceil() as u16).map(sample).collect())
}

#[test]
fn tracks_of_other_programs_are_measured_beside_runs_but_have_no_score() {
    let set = small();
    let runs = [
        Run { entrant: "calm".to_owned(), ..run_of(&set, |goal| slide(goal, 0.0)) },
        Run { entrant: "restless".to_owned(), ..run_of(&set, |goal| slide(goal, 0.1)) },
        Run { entrant: "driven".to_owned(), ..run_of(&set, straight) },
    ];
    let refused = score(&set, Path::new(""), &runs[0], 2, |_| {}).unwrap_err();
    assert!(refused.to_string().contains("only their motion is measured"), "{refused}");
    let all = Comparison { runs: &runs, shortest: Some(&runs[2]), on_foot: false };
    let measure = |comparison| compare((&set, Path::new("")), comparison, 2, |_| {}).unwrap();
    let rows = measure(all);
    let maps: Vec<Option<&str>> = rows.iter().map(|row| row.map.as_deref()).collect();
    let [first, second] = [Some("terrain-1000"), Some("terrain-1001")];
    assert_eq!(maps, [first, first, first, second, second, second, None, None, None]);
    let [calm, restless, driven] = &rows[6..] else { panic!() };
    let walked = score(&set, Path::new(""), &runs[2], 2, |_| {}).unwrap().ends["reached"];
    assert_eq!((calm.goals, calm.reached, driven.reached), (24, 24, walked));
    // Like with like: only what the plain controller reaches as well.
    assert!(rows[6..].iter().all(|row| row.measured == walked));
    assert_eq!((calm.reversals_per_s, calm.facing_p90_deg), (0.0, 1.0));
    assert!(restless.reversals_per_s > 4.0 && restless.facing_p50_deg >= 5.0, "{restless:?}");
    let ratio = |row: &MotionRow| row.path_over_shortest.unwrap();
    assert!((ratio(calm) - 1.0).abs() < 1.0e-3 && ratio(driven) >= 1.0 - 1.0e-3, "{} {}", ratio(calm), ratio(driven));
    assert!(driven.seconds_to_goal > 0.0 && driven.jerk > calm.jerk);
    let on_foot = &measure(Comparison { on_foot: true, ..all })[6..];
    assert!(on_foot[2].measured <= walked && on_foot[2].jumps_per_100m == 0.0, "{on_foot:?}");
    let alone = measure(Comparison { runs: &runs[..1], shortest: None, on_foot: false });
    assert_eq!((alone[2].measured, alone[2].path_over_shortest), (24, None));
}
