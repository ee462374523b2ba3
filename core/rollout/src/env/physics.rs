//! The physics of an environment, and the simulated world as one.

use crate::decision::{DecidingNpc, DecisionBatch, DecisionLoop};
use std::sync::Arc;
use surefoot_world::sense::observation_len;
use surefoot_world::{Ability, Action, CharacterProfile, DecisionOutcome, Map, TaskConfig, Vec3, World, WorldConfig};

/// An NPC that is put at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Index of the NPC.
    pub npc_idx: usize,
    /// Position of the feet, m.
    pub feet: Vec3,
    /// Heading, rad.
    pub yaw: f32,
}

/// The physics of an environment: a simulated world, or a game. NPCs count from 0.
pub trait Physics: Send + std::fmt::Debug {
    /// Number of values of an observation.
    fn observation_len(&self) -> usize;

    /// Puts NPCs at places, ascending and each at most once, at rest and unharmed, without an episode.
    fn place(&mut self, placements: &[Placement]);

    /// Announces placements that will follow the next call of [`advance`](Self::advance), ascending, so that a game
    /// gets both in one message.
    fn announce(&mut self, _placements: &[Placement]) {}

    /// Why the physics failed, in a sentence. After a failure, results are invalid.
    fn failure(&self) -> Option<&str> {
        None
    }

    /// Starts an episode towards `goal`, m; the body keeps its motion.
    fn set_goal(&mut self, npc_idx: usize, goal: Vec3);

    /// Ends the episode of an NPC, which comes to rest.
    fn clear_goal(&mut self, npc_idx: usize);

    /// Runs ten ticks in which these NPCs, ascending, carry out their actions and all others rest. All of these NPCs
    /// have episodes. Returns the outcomes of their decisions, in order.
    fn advance(&mut self, npcs: &[usize], actions: &[Action]) -> Vec<DecisionOutcome>;

    /// Writes the observation of an NPC, which has an episode.
    fn observe(&mut self, npc_idx: usize, row: &mut [f32]);

    /// Where an NPC is, and its last ability.
    fn stand(&self, npc_idx: usize) -> Standing;
}

/// Where an NPC is, and its last ability.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Standing {
    /// Position of the feet, m.
    pub feet: Vec3,
    /// The most demanding ability of its last decision.
    pub ability: Ability,
    /// Whether it came to harm.
    pub is_harmed: bool,
}

/// A simulated world.
#[derive(Debug)]
pub(super) struct WorldPhysics {
    worlds: [World; 1],
    npcs: Vec<DecidingNpc>,
    decisions: DecisionLoop,
    observation_len: usize,
}

impl WorldPhysics {
    pub fn new(map: Arc<Map>, profile: CharacterProfile, solid_npcs: bool, npc_count: usize) -> Self {
        let observation_len = observation_len(solid_npcs);
        let mut world = World::with_config(map, WorldConfig::new(profile, TaskConfig::default(), solid_npcs));
        let npcs = (0..npc_count).map(|_| DecidingNpc::of(world.spawn(Vec3::ZERO, 0.0))).collect();
        Self { worlds: [world], npcs, decisions: DecisionLoop::of_lens(observation_len, 0), observation_len }
    }
}

impl Physics for WorldPhysics {
    fn observation_len(&self) -> usize {
        self.observation_len
    }

    fn place(&mut self, placements: &[Placement]) {
        for Placement { npc_idx, feet, yaw } in placements {
            self.worlds[0].teleport(self.npcs[*npc_idx].slot, *feet, *yaw);
        }
    }

    fn set_goal(&mut self, npc_idx: usize, goal: Vec3) {
        self.worlds[0].set_waypoint(self.npcs[npc_idx].slot, goal);
    }

    fn clear_goal(&mut self, npc_idx: usize) {
        self.worlds[0].clear_waypoint(self.npcs[npc_idx].slot);
    }

    fn advance(&mut self, npcs: &[usize], actions: &[Action]) -> Vec<DecisionOutcome> {
        let npcs: Vec<DecidingNpc> = npcs.iter().map(|npc_idx| self.npcs[*npc_idx]).collect();
        self.decisions.advance(&mut DecisionBatch { worlds: &mut self.worlds, npcs: &npcs }, actions).to_vec()
    }

    fn observe(&mut self, npc_idx: usize, row: &mut [f32]) {
        self.worlds[0].observe(self.npcs[npc_idx].slot, row);
    }

    fn stand(&self, npc_idx: usize) -> Standing {
        let npc = self.worlds[0].npc(self.npcs[npc_idx].slot).expect("every NPC was spawned");
        Standing { feet: npc.body.feet, ability: npc.used_abilities.most_demanding(), is_harmed: npc.harm.is_some() }
    }
}
