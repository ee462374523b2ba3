//! Motion: composed NPCs face where they go, turn less and jump less than free ones, and arrive as often.

use super::stage::{of_boxes, router};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::f32::consts::PI;
use std::sync::Arc;
use surefoot_policy::Policy;
use surefoot_rollout::attempts::Figures;
use surefoot_rollout::steer::Course;
use surefoot_rollout::{AttemptResult, Goal, Motion, Rollout, Style};
use surefoot_world::character::{Body, Support};
use surefoot_world::map::MapSize;
use surefoot_world::{
    Ability, Action, Arrival, CharacterProfile, DECISION_SECONDS, End, Gait, Map, MapSpec, TaskConfig, Vec3, World,
    navigable,
};

fn map(side: u32) -> Arc<Map> {
    Arc::new(surefoot_generate::generate(&MapSpec::with_side(1000, side).unwrap()))
}

#[test]
fn composed_npcs_turn_and_jump_less_and_arrive_as_often() {
    let (map, policy) = (map(120), Policy::shipped().unwrap());
    let router = router(&map, 120);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let points = navigable::sample_many(&map, &CharacterProfile::default(), 400, &mut rng).unwrap();
    let goals = Goal::draw(&points, 5.0..200.0, 80, &mut rng);
    let run = |composes: bool| -> (Vec<AttemptResult>, Motion) {
        let mut rollout = Rollout::new(map.clone(), CharacterProfile::default(), TaskConfig::default());
        rollout.follow.composes = composes;
        let mut figures = Figures::default();
        let attempts = rollout.measure(&policy, Some(&router), &goals, &mut figures);
        assert_eq!(figures.steered > 0, composes, "only composed NPCs are steered");
        (attempts, figures.motion)
    };
    let ((composed, calm), (free, restless)) = (run(true), run(false));
    let reached = |attempts: &[AttemptResult]| attempts.iter().filter(|attempt| attempt.end == End::Reached).count();
    assert!(reached(&composed) + 1 >= reached(&free), "{} of {}", reached(&composed), reached(&free));
    assert!(2.0 * calm.reversals_per_s() < restless.reversals_per_s(), "{calm:?} {restless:?}");
    assert!(2.0 * calm.walk.jumps_per_100m() < restless.walk.jumps_per_100m(), "{calm:?} {restless:?}");
    assert!(calm.facing_deg(0.5) < restless.facing_deg(0.5), "{calm:?} {restless:?}");
    assert!(calm.mean_jerk() < restless.mean_jerk(), "{calm:?} {restless:?}");
    assert_eq!(composed, run(true).0, "the same seed, the same attempts");
}

#[test]
fn a_composed_action_goes_where_the_policy_wants_and_looks_there() {
    let profile = CharacterProfile::default();
    let mut world = World::new(map(60), profile.clone(), TaskConfig::default());
    let slot = world.spawn(Vec3::new(30.0, 10.0, 30.0), 0.0);
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..2000 {
        let mut draw = |most: f32| rng.random_range(-most..=most);
        let action = Action::from_array([draw(1.0), draw(1.0), draw(1.0), draw(1.0)]).unwrap();
        let mut npc = *world.npc(slot).unwrap();
        npc.body = Body::at(npc.body.feet, draw(PI));
        npc.body.velocity = Vec3::new(draw(11.0), 0.0, draw(11.0));
        assert_eq!(Style::Free.shape(action, &npc, &profile), action);
        let walks = Style::for_leg(Ability::WALK).shape(action, &npc, &profile);
        assert!(walks.to_array().iter().all(|value| (-1.0..=1.0).contains(value)), "{walks:?}");
        assert!(walks.jump <= 0.0, "no jumps on a leg that can be walked");
        assert_eq!(Style::for_leg(Ability::JUMP).shape(action, &npc, &profile).jump, action.jump);
        // A body that stands turns towards where the policy wants to go, as far as it can.
        (npc.body.velocity, npc.body.support) = (Vec3::ZERO, Support::Ground);
        let turned = Style::for_leg(Ability::WALK).shape(action, &npc, &profile);
        let most = profile.turn_speed * DECISION_SECONDS;
        let (forward, right) =
            (action.forward.max(-profile.side_speed_share), action.strafe * profile.side_speed_share);
        if forward.abs().max(right.abs()) < 0.2 {
            continue;
        }
        // Yaw grows to the left.
        let off = f32::atan2(-right, forward) + 0.5 * action.turn * most;
        let off = (off + PI).rem_euclid(2.0 * PI) - PI;
        if off.abs() > 0.2 && off.abs() < PI - 0.2 {
            assert_eq!(turned.turn.signum(), off.signum(), "{action:?} {off}");
            assert!(turned.turn.abs() <= 1.0 && (turned.turn * most).abs() <= off.abs());
        }
    }
}

#[test]
fn a_composed_body_keeps_its_heading_in_the_air() {
    let (map, profile) = (floor(), CharacterProfile::default());
    let mut world = World::new(map.clone(), profile.clone(), TaskConfig::default());
    let [start, goal] = [[10.0, 10.0], [30.0, 10.0]].map(|[x, z]| Vec3::new(x, 2.0, z));
    let slot = world.spawn(start, 0.0);
    world.head_for(slot, goal, Arrival::Pass);
    // The policy spins and swerves.
    let action = Action { forward: 1.0, strafe: 0.4, turn: -1.0, jump: 1.0 };
    let leap = Style::for_leg(Ability::JUMP);
    let mut npc = *world.npc(slot).unwrap();
    npc.body.yaw = PI / 2.0;
    (npc.body.velocity, npc.body.support) = (Vec3::X * 8.0, Support::Air);
    assert_eq!(leap.shape(action, &npc, &profile).turn, 0.0, "it keeps the heading of its take-off");
    npc.body.yaw = 0.0;
    assert!(leap.shape(action, &npc, &profile).turn > 0.9, "it flies to the left");
}

#[test]
fn motion_counts_what_is_seen() {
    let (policy, profile) = (Policy::shipped().unwrap(), CharacterProfile::default());
    let map = map(120);
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let points = navigable::sample_many(&map, &profile, 100, &mut rng).unwrap();
    let goals = Goal::draw(&points, 5.0..60.0, 20, &mut rng);
    let mut figures = Figures::default();
    let rollout = Rollout::new(map, profile, TaskConfig::default());
    let attempts = rollout.measure(&policy, None, &goals, &mut figures);
    assert_eq!(figures.steered, 0, "no NPC follows a plan");
    let motion = figures.motion;
    assert_eq!(motion.decisions, attempts.iter().map(|attempt| u64::from(attempt.decisions)).sum::<u64>());
    let length: f64 = attempts.iter().map(|attempt| f64::from(attempt.length)).sum();
    assert!((motion.all.metres - length).abs() < 1.0e-2 * length, "{} m, {length} m", motion.all.metres);
    assert!(motion.facing.iter().sum::<u64>() <= motion.decisions);
    assert!(motion.facing_deg(0.5) <= motion.facing_deg(0.9));
    assert_eq!(motion.walk.decisions, 0, "no NPC follows a plan");
    let mut twice = motion.clone();
    twice.add(&motion);
    assert_eq!(twice.reversals, 2 * motion.reversals);
    assert_eq!(twice.facing_deg(0.9), motion.facing_deg(0.9));
}

/// A floor of 60 x 60 m, 2 m above the lowest point of its map.
fn floor() -> Arc<Map> {
    let size = MapSize { width: 60, height: 60, depth: 60 };
    of_boxes(size, [[Vec3::new(0.0, 1.0, 0.0), Vec3::new(60.0, 2.0, 60.0)]])
}

#[test]
fn a_steered_body_faces_where_it_goes_cuts_corners_and_stops() {
    let profile = CharacterProfile::default();
    let mut world = World::new(floor(), profile.clone(), TaskConfig::default());
    let [start, corner, goal] = [[10.0, 10.0], [30.0, 10.5], [30.0, 30.0]].map(|[x, z]| Vec3::new(x, 2.0, z));
    // It faces away from its way.
    let slot = world.spawn(start, -PI / 2.0);
    let mut course = Course { to: corner, then: Some(goal), cuts: true, gait: Gait::default(), around: None };
    let (mut off, mut nearest, mut track) = (Vec::new(), f32::INFINITY, vec![start]);
    for _ in 0..60 {
        let body = world.npc(slot).unwrap().body;
        if course.then.is_some() && body.feet.distance(corner) <= 1.0 {
            course = Course { to: goal, then: None, cuts: true, gait: Gait::default(), around: None };
        }
        let action = course.action(&body, &profile);
        assert!(action.to_array().iter().all(|value| (-1.0..=1.0).contains(value)) && action.jump < 0.0, "{action:?}");
        world.decide(slot, action);
        world.tick_decision();
        let body = world.npc(slot).unwrap().body;
        let speed = body.velocity.with_y(0.0).length();
        if speed > 2.0 {
            off.push(body.velocity.with_y(0.0).angle_between(body.facing()).to_degrees());
        }
        nearest = nearest.min(body.feet.distance(corner));
        track.push(body.feet);
    }
    let body = world.npc(slot).unwrap().body;
    assert!(body.feet.distance(goal) <= 0.5 && body.is_at_rest(), "{body:?}");
    assert!(nearest <= 1.0, "it passed the corner at {nearest} m");
    let length: f32 = track.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
    assert!(length <= 1.03 * (start.distance(corner) + corner.distance(goal)), "{length} m");
    off.sort_by(f32::total_cmp);
    // It sets out while it turns.
    assert!(off[off.len() / 2] <= 5.0, "facing: {off:?}");
}
