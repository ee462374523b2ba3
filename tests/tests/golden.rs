//! Golden values: results that must stay equal bit for bit, unless a change is meant to change them.
//!
//! Maps are in `core/world/tests/maps.rs`, graphs in `core/planner/tests/build.rs`.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::sync::Arc;
use surefoot_policy::{Batch, Policy, Scratch};
use surefoot_world::{Action, CharacterProfile, MapSpec, NpcSlot, OBSERVATION_LEN, TaskConfig, World, navigable};

/// A world on a map of 120 m with 16 NPCs that act at random, after 3,600 ticks: one minute.
fn after_a_minute() -> World {
    let map = Arc::new(surefoot_generate::generate(&MapSpec::with_side(77, 120).unwrap()));
    let profile = CharacterProfile::of_paper();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let points = navigable::sample_many(&map, &profile, 32, &mut rng).unwrap();
    let mut world = World::new(map, profile, TaskConfig::default());
    for pair in points.chunks_exact(2) {
        let slot = world.spawn(pair[0], 0.5);
        world.set_waypoint(slot, pair[1]);
    }
    for _ in 0..360 {
        for idx in 0..16 {
            let action = [(); 4].map(|()| rng.random_range(-1.0..1.0));
            world.decide(NpcSlot(idx), Action::from_array(action).unwrap());
        }
        world.tick_decision();
        for idx in 0..16 {
            world.close_decision(NpcSlot(idx));
            if world.npc(NpcSlot(idx)).unwrap().harm.is_some() {
                world.teleport(NpcSlot(idx), points[2 * idx as usize], 0.5);
                world.set_waypoint(NpcSlot(idx), points[2 * idx as usize + 1]);
            }
        }
    }
    world
}

fn hex(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

#[test]
fn the_state_after_a_minute_and_what_is_observed_then_are_bit_for_bit_those_of_before() {
    let world = after_a_minute();
    assert_eq!(world.current_tick().0, 3600);
    assert_eq!(hex(&world.save().hash()), "7ea71796b5e20e04a528857acb4254c52c65d119073d70d47e996f3eb4bb8e64");
    let mut row = vec![0.0; OBSERVATION_LEN];
    let mut bytes = Vec::new();
    for idx in 0..16 {
        world.observe(NpcSlot(idx), &mut row);
        bytes.extend(row.iter().flat_map(|value| value.to_bits().to_le_bytes()));
    }
    assert_eq!(hex(&bytes), "580f1242c726c63169de40b0839b6e0af66f0a3563efd4b5ed52e23aa6e3675b");
}

#[test]
fn the_shipped_weights_decide_as_before() {
    let world = after_a_minute();
    let mut observations = vec![0.0; 16 * OBSERVATION_LEN];
    for (idx, row) in observations.chunks_exact_mut(OBSERVATION_LEN).enumerate() {
        world.observe(NpcSlot(idx as u32), row);
    }
    let (policy, mut actions) = (Policy::shipped().unwrap(), Vec::new());
    policy.act(
        Batch { observations: &observations, memory: &mut [], noise: &[] },
        &mut Scratch::default(),
        &mut actions,
    );
    // The order of additions in matrix products depends on the processor; four digits agree on all processors.
    let digits: Vec<i32> =
        actions[0].to_array().into_iter().map(|value| (f64::from(value) * 1.0e4).round() as i32).collect();
    assert_eq!(digits, [9022, -8143, 8354, -9451]);
    assert_eq!(policy.weights_hash(), "e892d7d5da9b08ba8bbe5a1fae2a93a7c20381495862f0f54001020efe4d98f7");
}
