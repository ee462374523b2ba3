//! Collects experience: many NPCs on a few maps at a time, all deciding together.

use super::replay::{RowKind, Step};
use super::run::RngState;
use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use surefoot_policy::Actor;
use surefoot_policy::actor::gaussian;
use surefoot_world::character::{ACTION_LEN, Action};
use surefoot_world::{
    CharacterProfile, End, Map, MapSpec, NpcSlot, OBSERVATION_LEN, TaskConfig, Vec3, World, WorldState, navigable,
};

/// How experience is collected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CollectorConfig {
    /// Seeds of the maps to train on.
    pub map_seeds: std::ops::Range<u64>,
    /// Side of those maps, m.
    pub map_side: u32,
    /// Maps in use at a time.
    pub world_count: usize,
    /// NPCs on each.
    pub npcs_per_world: usize,
    /// Rounds after which the oldest map is exchanged for another.
    pub rounds_per_map: u64,
    /// Share of goals drawn from `near_goals`; the rest is drawn from `far_goals`.
    pub near_share: f64,
    /// Distance of near goals, m.
    pub near_goals: (f32, f32),
    /// Distance of far goals, m.
    pub far_goals: (f32, f32),
    /// After reaching a goal, chance of heading on to another from the run instead of respawning: a policy
    /// that follows waypoints lives in that switch.
    pub switch_chance: f64,
    /// Decisions without progress after which an attempt is cut off (truncated).
    pub give_up_after: u32,
    /// Decisions made at random at the start of the run.
    pub random_decisions: u64,
}

impl Default for CollectorConfig {
    fn default() -> Self {
        Self {
            map_seeds: 0..128,
            map_side: 250,
            world_count: 8,
            npcs_per_world: 32,
            rounds_per_map: 120,
            near_share: 0.85,
            near_goals: (2.0, 40.0),
            far_goals: (40.0, 120.0),
            switch_chance: 0.6,
            give_up_after: 80,
            random_decisions: 20_000,
        }
    }
}

/// Outcomes since they were last taken.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct CollectorStats {
    /// Decisions taken.
    pub decisions: u64,
    /// Episodes that ended.
    pub episodes: u64,
    /// Episodes that reached their goal.
    pub reached: u64,
    /// Sum of all rewards.
    pub reward: f64,
}

/// Places to stand on one map, with the world that runs on it.
#[derive(Debug)]
struct Arena {
    seed: u64,
    points: Vec<Vec3>,
    world: World,
}

/// Navigable points drawn on each map.
const POINTS_PER_MAP: usize = 1500;
/// Draws for a goal in the wanted band of distances before the nearest miss is taken.
const GOAL_DRAWS: usize = 400;

impl Arena {
    fn new(seed: u64, config: &CollectorConfig) -> Self {
        let map = Arc::new(Map::generate(&MapSpec::with_side(seed, config.map_side)).expect("a valid training spec"));
        let profile = CharacterProfile::default();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(2);
        let points =
            navigable::sample_many(&map, &profile, POINTS_PER_MAP, &mut rng).expect("generated maps have ground");
        Self { seed, points, world: World::new(map, profile, TaskConfig::default()) }
    }

    fn random_point(&self, rng: &mut ChaCha8Rng) -> Vec3 {
        self.points[rng.random_range(0..self.points.len())]
    }

    /// A navigable goal at a distance from `from` inside the band, or the closest miss.
    fn goal(&self, from: Vec3, band: (f32, f32), rng: &mut ChaCha8Rng) -> Vec3 {
        let wanted = rng.random_range(band.0..band.1);
        let mut best = (f32::INFINITY, self.points[0]);
        for _ in 0..GOAL_DRAWS {
            let point = self.random_point(rng);
            let miss = (point.distance(from) - wanted).abs();
            if miss < best.0 {
                best = (miss, point);
            }
            if miss < 1.0 {
                break;
            }
        }
        best.1
    }
}

/// All collecting state.
#[derive(Debug)]
pub struct Collector {
    config: CollectorConfig,
    arenas: Vec<Arena>,
    /// Lanes whose next row is the last observation of a cut-off episode.
    boundary: Vec<bool>,
    rng: ChaCha8Rng,
    rounds: u64,
    total_decisions: u64,
    stats: CollectorStats,
    step: Step,
}

/// A collector's state as plain data.
#[derive(Debug, Serialize, Deserialize)]
pub struct CollectorState {
    worlds: Vec<(u64, WorldState)>,
    boundary: Vec<bool>,
    rng: RngState,
    rounds: u64,
    total_decisions: u64,
    stats: CollectorStats,
}

impl Collector {
    /// Fresh worlds with an NPC in every lane.
    pub fn new(config: CollectorConfig, mut rng: ChaCha8Rng) -> Self {
        let mut arenas = Vec::new();
        for _ in 0..config.world_count {
            arenas.push(Arena::new(rng.random_range(config.map_seeds.clone()), &config));
        }
        let lane_count = config.world_count * config.npcs_per_world;
        let mut collector = Self {
            config,
            arenas,
            boundary: vec![false; lane_count],
            rng,
            rounds: 0,
            total_decisions: 0,
            stats: CollectorStats::default(),
            step: Step::default(),
        };
        for arena_idx in 0..collector.arenas.len() {
            collector.populate(arena_idx);
        }
        collector
    }

    /// NPCs in all.
    pub fn lane_count(&self) -> usize {
        self.boundary.len()
    }

    /// Decisions taken since the beginning of the run.
    pub fn total_decisions(&self) -> u64 {
        self.total_decisions
    }

    /// Outcomes since the last call.
    pub fn take_stats(&mut self) -> CollectorStats {
        std::mem::take(&mut self.stats)
    }

    fn populate(&mut self, arena_idx: usize) {
        for npc in 0..self.config.npcs_per_world {
            let arena = &mut self.arenas[arena_idx];
            let slot = arena.world.spawn(Vec3::ZERO, 0.0);
            assert_eq!(slot, NpcSlot(npc as u32), "lanes are slots");
            self.respawn(arena_idx, slot);
        }
    }

    fn respawn(&mut self, arena_idx: usize, slot: NpcSlot) {
        let arena = &mut self.arenas[arena_idx];
        let feet = arena.random_point(&mut self.rng);
        let yaw = self.rng.random_range(-std::f32::consts::PI..std::f32::consts::PI);
        arena.world.teleport(slot, feet, yaw);
        self.new_goal(arena_idx, slot);
    }

    fn new_goal(&mut self, arena_idx: usize, slot: NpcSlot) {
        let near = self.rng.random_bool(self.config.near_share);
        let band = if near { self.config.near_goals } else { self.config.far_goals };
        let arena = &mut self.arenas[arena_idx];
        let from = arena.world.npc(slot).expect("an NPC in every lane").body.feet;
        let goal = arena.goal(from, band, &mut self.rng);
        arena.world.set_goal(slot, goal);
    }

    /// Collects `step_count` decisions of every NPC with `actor` and hands each step to `store`.
    pub fn round(&mut self, actor: &Actor, step_count: usize, mut store: impl FnMut(Step)) {
        self.rounds += 1;
        let exchanged = self
            .rounds
            .is_multiple_of(self.config.rounds_per_map)
            .then(|| (self.rounds / self.config.rounds_per_map) as usize % self.arenas.len());
        for step_idx in 0..step_count {
            let exchange = exchanged.filter(|_| step_idx == 0);
            if let Some(arena_idx) = exchange {
                let npcs = self.config.npcs_per_world;
                self.boundary[arena_idx * npcs..(arena_idx + 1) * npcs].fill(true);
            }
            self.collect_step(actor);
            store(self.step.clone());
            if let Some(arena_idx) = exchange {
                // Its attempts have just ended in boundary rows, so nothing of the old map is continued.
                let seed = self.rng.random_range(self.config.map_seeds.clone());
                self.arenas[arena_idx] = Arena::new(seed, &self.config);
                self.populate(arena_idx);
            }
        }
    }

    fn collect_step(&mut self, actor: &Actor) {
        let lane_count = self.lane_count();
        let npcs = self.config.npcs_per_world;
        self.step.observations.resize(lane_count * OBSERVATION_LEN, 0.0);
        self.step.rewards.clear();
        self.step.kinds.clear();
        for (lane, row) in self.step.observations.chunks_exact_mut(OBSERVATION_LEN).enumerate() {
            self.arenas[lane / npcs].world.observe(NpcSlot((lane % npcs) as u32), row);
        }
        self.choose_actions(actor);
        for (lane, action) in self.step.actions.iter().enumerate() {
            let action = Action::from_array(*action).expect("policy actions are finite");
            if !self.boundary[lane] {
                self.arenas[lane / npcs].world.decide(NpcSlot((lane % npcs) as u32), action);
            }
        }
        for arena in &mut self.arenas {
            arena.world.tick_decision();
        }
        for lane in 0..lane_count {
            let (reward, kind) = self.finish_lane(lane / npcs, NpcSlot((lane % npcs) as u32), lane);
            self.step.rewards.push(reward);
            self.step.kinds.push(kind);
            self.stats.reward += f64::from(reward);
        }
        self.stats.decisions += lane_count as u64;
        self.total_decisions += lane_count as u64;
    }

    /// Settles one lane after its decision and starts what comes next there.
    fn finish_lane(&mut self, arena_idx: usize, slot: NpcSlot, lane: usize) -> (f32, RowKind) {
        if std::mem::take(&mut self.boundary[lane]) {
            self.respawn(arena_idx, slot);
            return (0.0, RowKind::Boundary);
        }
        let world = &mut self.arenas[arena_idx].world;
        let outcome = world.close_decision(slot).expect("an episode in every lane");
        let stalled = world.npc(slot).and_then(|npc| npc.episode).map_or(0, |episode| episode.stalled_decisions);
        match outcome.end {
            Some(end) if !end.is_truncation() => {
                self.stats.episodes += 1;
                if end == End::Reached {
                    self.stats.reached += 1;
                    if self.rng.random_bool(self.config.switch_chance) {
                        self.new_goal(arena_idx, slot);
                        return (outcome.reward, RowKind::Terminated);
                    }
                }
                self.respawn(arena_idx, slot);
                (outcome.reward, RowKind::Terminated)
            }
            None if stalled < self.config.give_up_after => (outcome.reward, RowKind::Continues),
            _ => {
                self.stats.episodes += 1;
                self.boundary[lane] = true;
                (outcome.reward, RowKind::Continues)
            }
        }
    }

    fn choose_actions(&mut self, actor: &Actor) {
        let lane_count = self.lane_count();
        self.step.actions.clear();
        if self.total_decisions < self.config.random_decisions {
            for _ in 0..lane_count {
                self.step.actions.push([(); ACTION_LEN].map(|()| self.rng.random_range(-1.0..1.0)));
            }
            return;
        }
        let device = Device::flex();
        let rows = TensorData::new(self.step.observations.clone(), [lane_count, OBSERVATION_LEN]);
        let distribution = actor.forward(Tensor::<2>::from_data(rows, &device));
        let noise = TensorData::new(gaussian(&mut self.rng, lane_count * ACTION_LEN), [lane_count, ACTION_LEN]);
        let noise = Tensor::<2>::from_data(noise, &device);
        let actions = (distribution.mean + distribution.log_std.exp() * noise).tanh().into_data();
        let values = actions.as_slice::<f32>().expect("f32 tensors");
        self.step.actions.extend(values.as_chunks::<ACTION_LEN>().0);
    }

    /// All state as plain data.
    pub fn save(&self) -> CollectorState {
        CollectorState {
            worlds: self.arenas.iter().map(|arena| (arena.seed, arena.world.save())).collect(),
            boundary: self.boundary.clone(),
            rng: RngState::of(&self.rng),
            rounds: self.rounds,
            total_decisions: self.total_decisions,
            stats: self.stats,
        }
    }

    /// Continues from saved state.
    pub fn restore(config: CollectorConfig, state: CollectorState) -> Self {
        let arenas = state
            .worlds
            .into_iter()
            .map(|(seed, world)| {
                let mut arena = Arena::new(seed, &config);
                arena.world.restore(world);
                arena
            })
            .collect();
        Self {
            config,
            arenas,
            boundary: state.boundary,
            rng: state.rng.generator(),
            rounds: state.rounds,
            total_decisions: state.total_decisions,
            stats: state.stats,
            step: Step::default(),
        }
    }

    /// An inference copy of `actor`.
    pub fn snapshot(actor: &Actor) -> Actor {
        actor.valid()
    }
}
