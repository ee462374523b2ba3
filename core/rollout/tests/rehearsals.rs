//! Rehearsals: what they foretell happens, and NPCs that rehearse stay alive where others fall.

use super::stage::{of_boxes, router};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::Arc;
use surefoot_planner::LegKey;
use surefoot_policy::Policy;
use surefoot_rollout::attempt::{Recovery, RetryBudget};
use surefoot_rollout::attempts::Figures;
use surefoot_rollout::game::Rehearsals;
use surefoot_rollout::rehearse::{NoiseStream, Rehearsal, RehearsalFailure, RehearsalStart};
use surefoot_rollout::{
    AttemptResult, DecidingNpc, DecisionBatch, DecisionLoop, FollowConfig, Follower, Goal, Noise, Rollout,
};
use surefoot_world::map::{MapKind, MapSize, Piece, PieceShape};
use surefoot_world::{Arrival, CharacterProfile, End, Map, MapSpec, RawMapSpec, TaskConfig, Vec3, World, navigable};

/// Platforms over a void.
fn islands() -> Arc<Map> {
    let mut spec = RawMapSpec::new(1000);
    (spec.kind, spec.size.width, spec.size.depth) = (MapKind::Islands, 120, 120);
    Arc::new(surefoot_generate::generate(&MapSpec::try_from(spec).unwrap()))
}

fn goals(map: &Map, count: usize) -> Vec<Goal> {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let points = navigable::sample_many(map, &CharacterProfile::default(), 400, &mut rng).unwrap();
    Goal::draw(&points, 5.0..200.0, count, &mut rng)
}

fn harmed(attempts: &[AttemptResult]) -> usize {
    attempts.iter().filter(|attempt| attempt.end.is_harm()).count()
}

#[test]
fn npcs_that_rehearse_do_not_fall_where_others_do() {
    let (map, policy) = (islands(), Policy::shipped().unwrap());
    let router = router(&map, 120);
    let goals = goals(&map, 150);
    let mut rollout = Rollout::new(map, CharacterProfile::default(), TaskConfig::default());
    let run = |rollout: &Rollout| rollout.measure(&policy, Some(&router), &goals, &mut Figures::default());
    let rehearsed = run(&rollout);
    assert_eq!(rehearsed, run(&rollout), "the same seed, the same end");
    rollout.rehearses = false;
    let unrehearsed = run(&rollout);
    assert!(harmed(&unrehearsed) >= 5, "{} of {} fell without rehearsals", harmed(&unrehearsed), goals.len());
    assert_eq!(harmed(&rehearsed), 0);
}

/// A world with one NPC that heads straight for its goal, and the start of its rehearsal.
fn heads_straight(
    map: &Arc<Map>,
    policy: &Policy,
    goal: &Goal,
    noise: NoiseStream,
) -> ([World; 1], DecidingNpc, RehearsalStart) {
    let mut world = World::new(map.clone(), CharacterProfile::default(), TaskConfig::default());
    let deciding = DecidingNpc::of(world.spawn(goal.start, goal.yaw));
    world.head_for(deciding.slot, goal.goal, Arrival::Stand);
    let follower = Follower::new(goal.goal, FollowConfig::default()).straight();
    let npc = *world.npc(deciding.slot).unwrap();
    let start = RehearsalStart { npc, follower, hidden: vec![0.0; policy.memory_len()], noise, forecast: None };
    ([world], deciding, start)
}

#[test]
fn an_npc_does_what_its_rehearsal_foretold() {
    let (map, policy) = (islands(), Policy::shipped().unwrap());
    let mut rehearsal = Rehearsal::new(map.clone(), CharacterProfile::default(), TaskConfig::default(), &policy);
    let mut foretold = 0;
    for (stream, goal) in (0..).zip(goals(&map, 12)) {
        let mut noise = NoiseStream::new(0.5, 7, stream);
        let (mut worlds, deciding, start) = heads_straight(&map, &policy, &goal, noise);
        let Ok(mut forecast) = rehearsal.run(&policy, vec![start], &[]).remove(0) else { continue };
        let mut decisions = DecisionLoop::new(&policy);
        decisions.begin(deciding.row_idx);
        loop {
            let draw = Noise::Rows(noise.draw(deciding.style).collect());
            let end =
                decisions.decide(&mut DecisionBatch { worlds: &mut worlds, npcs: &[deciding] }, &policy, draw)[0].end;
            let body = worlds[0].npc(deciding.slot).unwrap().body;
            if end.is_none() && !forecast.matches(&body, 0.0) {
                // As far as it was rehearsed.
                break;
            }
            foretold += 1;
            if end.is_some() {
                assert!(forecast.matches(&body, 0.0), "the end was foretold, too");
                break;
            }
            let mut elsewhere = body;
            elsewhere.feet += Vec3::X * 0.001;
            assert!(!forecast.clone().matches(&elsewhere, 0.0), "another body is another story");
        }
    }
    assert!(foretold > 100, "{foretold} decisions were foretold");
}

#[test]
fn an_npc_whose_rehearsal_arrived_stands_alive_afterwards() {
    let (map, policy) = (islands(), Policy::shipped().unwrap());
    let mut rehearsal = Rehearsal::new(map.clone(), CharacterProfile::default(), TaskConfig::default(), &policy);
    let (mut arrived, mut refused) = (0, 0);
    for (stream, goal) in (0..).zip(goals(&map, 400)) {
        let mut noise = NoiseStream::new(0.5, 9, stream);
        let (mut worlds, deciding, start) = heads_straight(&map, &policy, &goal, noise);
        if rehearsal.run(&policy, vec![start], &[])[0].is_err() {
            refused += 1;
            continue;
        }
        let mut decisions = DecisionLoop::new(&policy);
        decisions.begin(deciding.row_idx);
        // The rehearsal went on for 160 decisions at most.
        let mut end = None;
        for _ in 0..160 {
            let draw = Noise::Rows(noise.draw(deciding.style).collect());
            end = decisions.decide(&mut DecisionBatch { worlds: &mut worlds, npcs: &[deciding] }, &policy, draw)[0].end;
            if end.is_some() {
                break;
            }
        }
        if end != Some(End::Reached) {
            continue;
        }
        // What the server does with an NPC that has arrived.
        worlds[0].clear_waypoint(deciding.slot);
        (0..240).for_each(|_| worlds[0].tick());
        let npc = worlds[0].npc(deciding.slot).unwrap();
        assert_eq!(npc.harm, None, "an NPC that arrived at {} died", goal.goal);
        assert!(npc.body.velocity.length() < 0.5, "{:?}", npc.body);
        arrived += 1;
    }
    assert!(arrived > 20 && refused > 20, "{arrived} arrived, {refused} were refused");
}

#[test]
fn after_a_failure_other_noise_is_tried_then_another_way_and_at_last_nothing() {
    let harm = RehearsalFailure { leg: LegKey::DIRECT, is_harm: true };
    let stall = RehearsalFailure { is_harm: false, ..harm };
    let recoveries = |failure| {
        let mut retries = RetryBudget::default();
        let mut follower = Follower::new(Vec3::ZERO, FollowConfig::default());
        (0..96).map(|_| retries.spend(failure, &mut follower)).collect::<Vec<Recovery>>()
    };
    assert_eq!(recoveries(harm)[..3], [Recovery::ChangeNoise, Recovery::ChangeNoise, Recovery::Avoid(harm)]);
    assert_eq!(recoveries(stall)[..2], [Recovery::ChangeNoise, Recovery::Avoid(stall)]);
    assert_eq!([recoveries(harm)[95], recoveries(stall)[95]], [Recovery::Stop; 2]);
}

#[test]
fn a_level_that_has_its_pieces_already_stays_the_same() {
    let size = MapSize { width: 32, height: 30, depth: 24 };
    let map = of_boxes(size, [[Vec3::ZERO, Vec3::new(32.0, 1.0, 24.0)]]);
    let rehearsals = Rehearsals::new(map, CharacterProfile::default(), &Policy::shipped().unwrap(), 0);
    // The names of a dozen do not sort by their numbers.
    let block = |idx: u8| {
        let foot = Vec3::new(2.0 * f32::from(idx) + 2.0, 1.0, 12.0);
        Piece { name: format!("block {idx}"), shape: PieceShape::Block { foot, half: [0.5; 2], height: 1.0, yaw: 0.0 } }
    };
    let level_with = |count| {
        rehearsals.set_pieces((0..count).map(block).collect()).unwrap();
        rehearsals.map()
    };
    let level = level_with(12);
    assert!(Arc::ptr_eq(&level, &level_with(12)));
    assert!(!Arc::ptr_eq(&level, &level_with(11)));
}
