//! Same inputs, same bits.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::sync::Arc;
use surefoot_world::{Action, CharacterProfile, Map, MapSpec, NpcSlot, OBSERVATION_LEN, TaskConfig, World, navigable};

fn crowd(map: &Arc<Map>, count: usize) -> World {
    let profile = CharacterProfile::default();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let points = navigable::sample_many(map, &profile, 2 * count, &mut rng).unwrap();
    let mut world = World::new(map.clone(), profile, TaskConfig::default());
    for pair in points.chunks_exact(2) {
        let slot = world.spawn(pair[0], 0.5);
        world.set_goal(slot, pair[1]);
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
    let spec = MapSpec::with_side(11, 100);
    let first = Map::generate(&spec).unwrap();
    assert_eq!(first.hash(), Map::generate(&spec).unwrap().hash());
    assert_ne!(first.hash(), Map::generate(&MapSpec::with_side(12, 100)).unwrap().hash());
}

#[test]
fn equal_actions_give_equal_worlds_also_after_a_restore_in_the_middle() {
    let map = Arc::new(Map::generate(&MapSpec::with_side(4, 100)).unwrap());
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
    let with = |change: fn(&mut MapSpec)| {
        let mut spec = MapSpec::new(1);
        change(&mut spec);
        Map::generate(&spec).unwrap_err().field
    };
    assert_eq!(with(|spec| spec.size.width = 49), "size.width");
    assert_eq!(with(|spec| spec.size.height = 201), "size.height");
    assert_eq!(with(|spec| spec.size.depth = 100_000), "size.depth");
    assert_eq!(with(|spec| spec.features.lava = f32::NAN), "features.lava");
    assert_eq!(with(|spec| spec.features.pads = -0.1), "features.pads");
    assert_eq!(with(|spec| spec.features.plateaus = f32::INFINITY), "features.plateaus");
}
