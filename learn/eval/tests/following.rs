//! Following plans, and the shipped policy on an unseen map.

use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use surefoot_eval::{EvalConfig, EvalError, MapName, Method, Price, Rate, evaluate};
use surefoot_planner::{Attach, BuildSettings, EdgeKey, Leg, NoPath, Plan};
use surefoot_policy::Policy;
use surefoot_rollout::follow::{FollowConfig, Follower, Step};
use surefoot_rollout::{DEFAULT_NOISE_SHARE, Goal};
use surefoot_world::{Ability, Chance, CharacterProfile, End, MapSpec, Seconds, Vec3, navigable};

const REACHED: Option<End> = Some(End::Reached);

fn plan(waypoints: &[f32]) -> Plan {
    let legs = (0..waypoints.len() as u32).map(|idx| Leg {
        key: EdgeKey::new(idx, idx + 1).into(),
        seconds: Seconds(1.0),
        chance: Chance::new(0.9),
        death_chance: 0.0,
        ability: Ability::WALK,
    });
    Plan {
        waypoints: waypoints.iter().map(|x| Vec3::new(*x, 0.0, 0.0)).collect(),
        legs: legs.collect(),
        no_path: None,
        needs: Vec::new(),
        nearest: None,
    }
}

fn follower() -> Follower {
    let mut follower = Follower::new(
        Vec3::new(30.0, 0.0, 0.0),
        FollowConfig { replan_after: 5, patience: 40, max_replans: 3, composes: false, ..FollowConfig::default() },
    );
    assert_eq!(follower.record_decision(Vec3::ZERO, None), Step::Plan, "without a plan, the follower needs one");
    assert_eq!(follower.take_plan(plan(&[10.0, 20.0, 30.0])), Vec3::new(10.0, 0.0, 0.0));
    follower
}

#[test]
fn each_touched_waypoint_leads_to_the_next() {
    let mut follower = follower();
    assert_eq!(follower.record_decision(Vec3::new(5.0, 0.0, 0.0), None), Step::Keep);
    assert_eq!(follower.record_decision(Vec3::new(10.0, 0.0, 0.0), REACHED), Step::HeadFor(Vec3::new(20.0, 0.0, 0.0)));
    assert_eq!(follower.record_decision(Vec3::new(20.0, 0.0, 0.0), REACHED), Step::HeadFor(Vec3::new(30.0, 0.0, 0.0)));
    assert!(follower.is_last_leg());
}

#[test]
fn a_leg_without_progress_is_avoided_by_re_plans_until_patience_ends() {
    let mut follower = follower();
    let stuck = Vec3::new(4.0, 0.0, 0.0);
    let mut replans = 0;
    for decision in 0..200 {
        match follower.record_decision(stuck, None) {
            Step::Keep => {}
            Step::Plan => {
                replans += 1;
                assert!(follower.query(stuck).avoid.contains(&EdgeKey::new(0, 1).into()));
                follower.take_plan(plan(&[10.0, 30.0]));
            }
            Step::End(End::NoProgress) => {
                assert_eq!(replans, 3);
                assert!(decision < 40);
                return;
            }
            Step::HeadFor(_) | Step::End(_) => panic!("no waypoint was touched"),
        }
    }
    panic!("never gave up");
}

#[test]
fn legs_without_progress_get_another_chance_where_no_other_way_is_left_and_harmful_ones_never() {
    let goal = Vec3::new(50.0, 0.0, 0.0);
    let mut follower = Follower::new(goal, FollowConfig::default());
    let nowhere = Plan { no_path: Some(NoPath::DifferentIslands), ..plan(&[10.0]) };
    assert!(!follower.reconsiders(&nowhere), "no leg has failed yet");
    let (stalled, harmful) = (EdgeKey::new(0, 1).into(), EdgeKey::new(1, 2).into());
    follower.take_plan(plan(&[10.0, 20.0]));
    assert_eq!(follower.avoid(harmful, true), Step::Plan);
    for chance in 0..3 {
        assert_eq!(follower.avoid(stalled, false), Step::Plan);
        assert_eq!(follower.query(Vec3::ZERO).avoid, [harmful, stalled]);
        assert!(!follower.reconsiders(&plan(&[10.0, 20.0])), "another way is left");
        assert!(follower.reconsiders(&nowhere), "chance {chance}");
        assert_eq!(follower.query(Vec3::ZERO).avoid, [harmful]);
    }
    follower.avoid(stalled, false);
    assert!(!follower.reconsiders(&nowhere), "three chances are enough");
}

#[test]
fn a_plan_to_the_nearest_place_ends_there_as_unreachable() {
    let goal = Vec3::new(50.0, 0.0, 0.0);
    let mut follower = Follower::new(goal, FollowConfig::default());
    let nearest = Vec3::new(20.0, 0.0, 0.0);
    let no_path = Some(NoPath::DifferentIslands);
    follower.take_plan(Plan { no_path, nearest: Some(nearest), ..plan(&[10.0, 20.0]) });
    assert_eq!(follower.record_decision(Vec3::new(10.0, 0.0, 0.0), REACHED), Step::HeadFor(nearest));
    assert_eq!(follower.record_decision(Vec3::new(15.0, 0.0, 0.0), None), Step::Keep);
    assert_eq!(follower.record_decision(nearest, REACHED), Step::End(End::Unreachable));
    assert_eq!(follower.take_traversals().len(), 2, "both edges were passed");
}

#[test]
fn intervals_contain_the_rate_and_shrink_with_more_attempts() {
    let few = Rate::of(8, 10);
    let many = Rate::of(800, 1000);
    assert!(few.low < 0.8 && 0.8 < few.high && many.high - many.low < few.high - few.low);
    assert!(
        (Rate::of(8, 10).low - 0.4902).abs() < 1.0e-3 && (Rate::of(8, 10).high - 0.9433).abs() < 1.0e-3,
        "Wilson's own figures"
    );
    assert!((Rate::of(10, 10).high - 1.0).abs() < 1.0e-9);
}

#[test]
fn drawn_goals_have_the_requested_distance() {
    let map = surefoot_generate::generate(&MapSpec::with_side(1001, 100).unwrap());
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let points = navigable::sample_many(&map, &CharacterProfile::default(), 200, &mut rng).unwrap();
    let goals = Goal::draw(&points, 10.0..20.0, 50, &mut rng);
    assert_eq!(goals.len(), 50);
    assert!(goals.iter().all(|goal| (10.0..20.0).contains(&goal.distance())));
}

fn config(method: Method) -> EvalConfig {
    EvalConfig {
        maps: vec![MapSpec::with_side(1000, 120).unwrap().into()],
        profile: CharacterProfile::default(),
        goals: 30,
        seeds: vec![0],
        method,
        distance: 1.0..f32::INFINITY,
        noise_share: DEFAULT_NOISE_SHARE,
        rehearses: true,
        follow: FollowConfig::default(),
        price: Price::Risk,
        thread_count: 2,
        keep_in: None,
        shard: None,
        game: None,
        graph: None,
        record: None,
    }
}

#[test]
fn the_shipped_policy_reaches_most_near_goals_on_an_unseen_map() {
    let near = EvalConfig { distance: 2.0..25.0, goals: 60, ..config(Method::Policy) };
    let report = evaluate(&Policy::shipped().unwrap(), &near, |_, _| {}).unwrap();
    assert!(report.success.all.rate >= 0.85, "{:?}", report.success.all);
    assert_eq!(report.ends.values().sum::<usize>(), 60);
    assert_eq!(report.success.easy.n + report.success.medium.n + report.success.hard.n, 60);
}

#[test]
fn an_evaluation_by_plan_does_not_depend_on_the_number_of_threads() {
    let settings = BuildSettings::default()
        .with(|it| {
            it.vertices = 60;
            it.neighbours = 8;
            it.repeats = 1;
        })
        .unwrap();
    let policy = Policy::shipped().unwrap();
    let run = |thread_count| {
        evaluate(&policy, &EvalConfig { thread_count, ..config(Method::Graph(settings)) }, |_, _| {}).unwrap()
    };
    let (one, two) = (run(1), run(2));
    assert_eq!((one.success.clone(), one.ends), (two.success, two.ends));
    assert!(one.success.all.rate > 0.8, "{:?}", one.success);
    assert!(one.graph.unwrap().edges > 100.0);
}

#[test]
fn goals_that_cannot_exist_are_an_error() {
    let far = EvalConfig { distance: 900.0..1000.0, ..config(Method::Policy) };
    assert!(matches!(
        evaluate(&Policy::shipped().unwrap(), &far, |_, _| {}),
        Err(EvalError::NoGoals(MapName::Seed(1000)))
    ));
}

#[test]
fn by_the_papers_rules_nothing_is_remembered_and_only_patience_ends_an_attempt() {
    let config = FollowConfig { replan_after: 5, patience: 300, ..FollowConfig::of_paper() };
    let mut follower = Follower::new(Vec3::new(30.0, 0.0, 0.0), config);
    follower.take_plan(plan(&[10.0, 30.0]));
    let stuck = Vec3::new(4.0, 0.0, 0.0);
    let mut replans = 0;
    let end = (0..1000).find_map(|_| match follower.record_decision(stuck, None) {
        Step::Keep => None,
        Step::Plan => {
            replans += 1;
            let query = follower.query(stuck);
            assert!(query.avoid.is_empty() && query.attach == Attach::Nearest);
            follower.take_plan(plan(&[10.0, 30.0]));
            None
        }
        end => Some(end),
    });
    // The decision that takes a plan up and five without progress on it.
    assert_eq!((end, replans), (Some(Step::End(End::NoProgress)), 300 / 6));
}
