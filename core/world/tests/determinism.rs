//! Same inputs, same bits.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::sync::Arc;
use surefoot_world::map::Features;
use surefoot_world::replay::{Recording, ReplayError};
use surefoot_world::{
    Action, CharacterProfile, Map, MapSpec, NpcSlot, OBSERVATION_LEN, ProfileIdx, RawMapSpec, TaskConfig, Tick, World,
    WorldConfig, navigable,
};

fn crowd(map: &Arc<Map>, count: usize) -> World {
    let profile = CharacterProfile::default();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let points = navigable::sample_many(map, &profile, 2 * count, &mut rng).unwrap();
    let mut world = World::new(map.clone(), profile, TaskConfig::default());
    for pair in points.chunks_exact(2) {
        let slot = world.spawn(pair[0], 0.5);
        world.set_waypoint(slot, pair[1]);
    }
    world
}

fn step(world: &mut World, rng: &mut ChaCha8Rng) {
    for idx in 0..world.slot_count() {
        let action = [(); 4].map(|()| rng.random_range(-1.0..1.0));
        world.decide(NpcSlot(idx as u32), Action::from_array(action).unwrap());
    }
    world.tick_decision();
    for idx in 0..world.slot_count() {
        world.close_decision(NpcSlot(idx as u32));
    }
}

#[test]
fn a_spec_always_generates_the_same_map_and_another_seed_another() {
    let spec = MapSpec::with_side(11, 100).unwrap();
    let first = surefoot_generate::generate(&spec);
    assert_eq!(first.hash(), surefoot_generate::generate(&spec).hash());
    assert_ne!(first.hash(), surefoot_generate::generate(&MapSpec::with_side(12, 100).unwrap()).hash());
}

#[test]
fn equal_actions_give_equal_worlds_also_after_a_restore_in_the_middle() {
    let map = Arc::new(surefoot_generate::generate(&MapSpec::with_side(4, 100).unwrap()));
    let (mut one, mut other) = (crowd(&map, 24), crowd(&map, 24));
    let (mut rng_one, mut rng_other) = (ChaCha8Rng::seed_from_u64(9), ChaCha8Rng::seed_from_u64(9));
    for round in 0..120 {
        step(&mut one, &mut rng_one);
        step(&mut other, &mut rng_other);
        if round == 60 {
            let state = other.save();
            other = World::new(map.clone(), CharacterProfile::default(), TaskConfig::default());
            other.restore(state);
        }
        assert_eq!(one.save(), other.save(), "round {round}");
    }
    let (mut row_one, mut row_other) = (vec![0.0; OBSERVATION_LEN], vec![0.0; OBSERVATION_LEN]);
    for idx in 0..one.slot_count() {
        one.observe(NpcSlot(idx as u32), &mut row_one);
        other.observe(NpcSlot(idx as u32), &mut row_other);
        assert_eq!(row_one, row_other);
    }
}

#[test]
fn specs_out_of_range_are_refused_by_the_name_of_the_field() {
    let with = |change: fn(&mut RawMapSpec)| MapSpec::new(1).with(change).unwrap_err().field;
    assert_eq!(with(|spec| spec.size.width = 49), "size.width");
    assert_eq!(with(|spec| spec.size.height = 201), "size.height");
    assert_eq!(with(|spec| spec.size.depth = 100_000), "size.depth");
    assert_eq!(with(|spec| spec.features.lava = f32::NAN), "features.lava");
    assert_eq!(with(|spec| spec.features.pads = -0.1), "features.pads");
    assert_eq!(with(|spec| spec.features.plateaus = f32::INFINITY), "features.plateaus");
    assert_eq!(with(|spec| spec.features.jetpacks = 5.0), "features.jetpacks");
}

/// Runs NPCs with random actions for ten simulated minutes; now and then NPCs are teleported, despawned and respawned.
fn recorded(map: &Arc<Map>, seed: u64) -> Recording {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let profiles = vec![CharacterProfile::default(), CharacterProfile::default().with(|it| it.height = 1.2).unwrap()];
    let config = WorldConfig { profiles, task: TaskConfig::default(), npc_collision: !seed.is_multiple_of(2) };
    let points = navigable::sample_many(map, &config.profiles[0], 32, &mut rng).unwrap();
    let mut world = World::with_config(map.clone(), config);
    // The recording begins in the middle of a run.
    let slots: Vec<NpcSlot> =
        (0..4).map(|idx| world.spawn_as(ProfileIdx(idx % 2), points[usize::from(idx)], 0.3)).collect();
    world.tick();
    world.start_recording();
    let point = |rng: &mut ChaCha8Rng| points[rng.random_range(0..points.len())];
    while world.current_tick().0 < 36_001 {
        for &slot in &slots {
            let npc = world.npc(slot).unwrap();
            if npc.harm.is_some() || rng.random_bool(0.01) {
                world.despawn(slot);
                let profile = ProfileIdx(rng.random_range(0..2));
                assert_eq!(world.spawn_as(profile, point(&mut rng), 0.0), slot);
            }
            if world.npc(slot).unwrap().episode.is_none_or(|episode| episode.end.is_some()) {
                world.set_waypoint(slot, point(&mut rng));
            }
            let action = [(); 4].map(|()| rng.random_range(-1.0..1.0));
            world.decide(slot, Action::from_array(action).unwrap());
        }
        world.tick_decision();
        for &slot in &slots {
            world.close_decision(slot);
        }
    }
    world.finish_recording().unwrap()
}

#[test]
fn recordings_of_ten_minutes_replay_to_the_same_state_on_any_thread_and_over_a_restore() {
    let map = Arc::new(surefoot_generate::generate(
        &MapSpec::with_side(4, 100).unwrap().with(|it| it.features = Features::all()).unwrap(),
    ));
    let check = |seeds: std::ops::Range<u64>| {
        for seed in seeds {
            let recording = recorded(&map, seed);
            assert_eq!(recording.tick_count(), 36_000);
            let read = Recording::decode(&recording.encode()).unwrap();
            let plain = read.replay(map.clone(), None).unwrap();
            let restored = read.replay(map.clone(), Some(Tick(17_777))).unwrap();
            assert_eq!(plain, restored, "seed {seed}");
        }
    };
    // Twenty seeds: the first on one thread, the others on two at once.
    check(0..2);
    std::thread::scope(|scope| {
        scope.spawn(|| check(2..11));
        scope.spawn(|| check(11..20));
    });
}

#[test]
fn a_recording_says_where_a_replay_differs_and_what_is_wrong_with_a_file() {
    let map = Arc::new(surefoot_generate::generate(&MapSpec::with_side(4, 60).unwrap()));
    let mut world = crowd(&map, 3);
    world.start_recording();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..130 {
        step(&mut world, &mut rng);
    }
    let recording = world.finish_recording().unwrap();
    let other = Arc::new(surefoot_generate::generate(&MapSpec::with_side(5, 60).unwrap()));
    assert!(matches!(recording.replay(other, None), Err(ReplayError::OtherMap { .. })));
    let bytes = recording.encode();
    assert_eq!(Recording::decode(b"something else"), Err(ReplayError::Magic));
    for length in [8, 10, 12, 43, 44, 500, bytes.len() - 1] {
        assert_eq!(Recording::decode(&bytes[..length]), Err(ReplayError::Damaged), "{length} bytes");
    }
    let mut newer = bytes.clone();
    newer[8] = 10;
    assert_eq!(Recording::decode(&newer), Err(ReplayError::Version(10)));
    for position in (12..bytes.len()).step_by(997) {
        let mut flipped = bytes.clone();
        flipped[position] ^= 4;
        assert_eq!(Recording::decode(&flipped), Err(ReplayError::Damaged), "byte {position}");
    }
}

#[test]
fn a_changed_input_is_found_by_the_replay() {
    let map = Arc::new(surefoot_generate::generate(&MapSpec::with_side(4, 60).unwrap()));
    let run = |turn: f32| {
        let mut world = crowd(&map, 1);
        world.start_recording();
        for decision in 0..130 {
            // The NPC runs in circles, so that it stays on the map.
            let turn = if decision == 70 { turn } else { 1.0 };
            world.decide(NpcSlot(0), Action { forward: 0.2, strafe: 0.0, turn, jump: -1.0 });
            world.tick_decision();
        }
        world.finish_recording().unwrap()
    };
    let (one, other) = (run(1.0), run(0.5));
    let spliced = Recording::with_inputs_of(&one, &other);
    assert_eq!(spliced.replay(map.clone(), None), Err(ReplayError::Diverged { tick: Tick(1200), agreed: Tick(600) }));
}
