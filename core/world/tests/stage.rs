//! What tests share: an NPC that is steered, players, and the settings of property tests.

use proptest::test_runner::{Config, RngSeed};
use surefoot_world::{Action, NpcSlot, Player, PlayerContact, Vec3, World};

pub const FORWARD: Action = Action { forward: 1.0, strafe: 0.0, turn: 0.0, jump: -1.0 };
pub const STAND: Action = Action { forward: 0.0, strafe: 0.0, turn: 0.0, jump: -1.0 };
/// The first NPC of a world.
pub const NPC: NpcSlot = NpcSlot(0);

/// Lets the NPC do the same for some decisions.
pub fn run(world: &mut World, action: Action, decisions: u32) {
    for _ in 0..decisions {
        world.decide(NPC, action);
        world.tick_decision();
    }
}

pub fn feet(world: &World) -> Vec3 {
    world.npc(NPC).expect("the NPC").body.feet
}

pub fn player(feet: Vec3, contact: PlayerContact) -> Player {
    Player { feet, velocity: Vec3::ZERO, radius: 0.4, height: 1.8, contact }
}

/// So many cases, the same in every run.
pub fn cases(cases: u32) -> Config {
    Config { cases, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..Config::default() }
}
