//! Crowds: NPCs that head for one goal after another, for recordings and for samples of the decisions of a policy.

use crate::decision::{DEFAULT_NOISE_SHARE, DecidingNpc, DecisionBatch, DecisionLoop, Noise};
use crate::goals::random_point;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::Arc;
use surefoot_policy::Policy;
use surefoot_world::navigable::{self, NoGround};
use surefoot_world::replay::Recording;
use surefoot_world::{CharacterProfile, Map, TaskConfig, Vec3, World};

/// Records `npc_count` NPCs that head for one goal after another for `decision_count` decisions.
///
/// # Errors
/// If no place to stand is found on the map.
pub fn record(map: Arc<Map>, policy: &Policy, npc_count: usize, decision_count: u64) -> Result<Recording, NoGround> {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let profile = CharacterProfile::default();
    let points = navigable::sample_many(&map, &profile, npc_count * 4, &mut rng)?;
    let mut worlds = [World::new(map, profile, TaskConfig::default())];
    worlds[0].start_recording();
    let npcs: Vec<DecidingNpc> =
        points[..npc_count].iter().map(|&feet| DecidingNpc::of(worlds[0].spawn(feet, 0.0))).collect();
    let mut decisions = DecisionLoop::new(policy);
    npcs.iter().for_each(|npc| decisions.begin(npc.row_idx));
    for _ in 0..decision_count {
        npcs.iter().for_each(|npc| renew_goal(&mut worlds[0], *npc, &points, &mut rng));
        let mut batch = DecisionBatch { worlds: &mut worlds, npcs: &npcs };
        decisions.decide(&mut batch, policy, Noise::Shared(DEFAULT_NOISE_SHARE, &mut rng));
    }
    Ok(worlds[0].finish_recording().expect("a recording is under way"))
}

/// Sets a new goal for an NPC whose episode has ended; an NPC that came to harm is teleported first.
fn renew_goal(world: &mut World, deciding: DecidingNpc, points: &[Vec3], rng: &mut ChaCha8Rng) {
    let npc = world.npc(deciding.slot).expect("a spawned NPC");
    let (harmed, episode) = (npc.harm.is_some(), npc.episode);
    if harmed {
        world.teleport(deciding.slot, random_point(points, rng), 0.0);
    }
    if harmed || episode.is_none_or(|episode| episode.end.is_some()) {
        world.set_waypoint(deciding.slot, random_point(points, rng));
    }
}

/// Observations of NPCs at one decision, and the actions of the policy without noise.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// As many values for each NPC as the policy's observations have.
    pub observations: Vec<f32>,
    /// [`ACTION_LEN`](surefoot_world::character::ACTION_LEN) values for each NPC.
    pub actions: Vec<f32>,
}

/// Runs `npc_count` NPCs that head for random goals on `map`, and returns one sample for each of `decision_count`
/// decisions.
///
/// # Errors
/// If no place to stand is found on the map.
pub fn sample_decisions(
    map: Arc<Map>,
    policy: &Policy,
    npc_count: usize,
    decision_count: usize,
) -> Result<Vec<Sample>, NoGround> {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let profile = CharacterProfile::default();
    let points = navigable::sample_many(&map, &profile, 2 * npc_count, &mut rng)?;
    let mut worlds = [World::new(map, profile, TaskConfig::default())];
    let mut decisions = DecisionLoop::new(policy);
    let mut npcs = Vec::with_capacity(npc_count);
    for pair in points.chunks_exact(2) {
        let slot = worlds[0].spawn(pair[0], 0.0);
        worlds[0].set_waypoint(slot, pair[1]);
        decisions.begin(DecidingNpc::of(slot).row_idx);
        npcs.push(DecidingNpc::of(slot));
    }
    let samples = (0..decision_count).map(|_| {
        decisions.decide(&mut DecisionBatch { worlds: &mut worlds, npcs: &npcs }, policy, Noise::Shared(0.0, &mut rng));
        let actions = decisions.actions().iter().flat_map(|action| action.to_array()).collect();
        Sample { observations: decisions.observations().to_vec(), actions }
    });
    Ok(samples.collect())
}
