//! Collects experience: many NPCs on a few maps at a time, all deciding together.

use super::replay::{RowKind, Step};
use super::run::RngState;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use surefoot_policy::Policy;
use surefoot_world::character::{ACTION_LEN, Action};
use surefoot_world::map::Features;
use surefoot_world::{
    CharacterProfile, End, Map, MapSpec, NpcSlot, OBSERVATION_LEN, TaskConfig, Vec3, World, WorldState, navigable,
};

/// How experience is collected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CollectorConfig {
    /// Seeds of the maps to train on.
    pub map_seeds: Vec<u64>,
    /// Side of those maps, m.
    pub map_side: u32,
    /// What stands on them.
    #[serde(default)]
    pub map_features: Features,
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
    /// Share of lives that begin with an attempt that failed before on the same map, where there is one.
    #[serde(default)]
    pub retry_share: f64,
    /// Chance at each decision of being sent elsewhere before the goal is reached, as by a re-plan.
    #[serde(default)]
    pub redirect_chance: f64,
    /// Decisions without progress after which an attempt is cut off (truncated).
    pub give_up_after: u32,
    /// Decisions made at random at the start of the run.
    pub random_decisions: u64,
}

impl Default for CollectorConfig {
    fn default() -> Self {
        Self {
            map_seeds: (0..128).collect(),
            map_side: 250,
            map_features: Features::default(),
            world_count: 8,
            npcs_per_world: 32,
            rounds_per_map: 120,
            near_share: 0.85,
            near_goals: (2.0, 40.0),
            far_goals: (40.0, 120.0),
            switch_chance: 0.6,
            retry_share: 0.3,
            redirect_chance: 0.003,
            give_up_after: 200,
            random_decisions: 20_000,
        }
    }
}

impl CollectorConfig {
    /// The map of a seed.
    pub fn spec(&self, seed: u64) -> MapSpec {
        MapSpec { features: self.map_features, ..MapSpec::with_side(seed, self.map_side) }
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
    /// Starts and goals of attempts that failed.
    failures: Vec<(Vec3, Vec3)>,
}

/// Failed attempts remembered per map; beyond them an old one is overwritten.
const MAX_FAILURES: usize = 400;

/// Navigable points drawn on each map.
const POINTS_PER_MAP: usize = 1500;
/// Draws for a goal in the wanted band of distances before the nearest miss is taken.
const GOAL_DRAWS: usize = 400;

impl Arena {
    fn new(seed: u64, config: &CollectorConfig) -> Self {
        let map = Arc::new(Map::generate(&config.spec(seed)).expect("a valid training spec"));
        let profile = CharacterProfile::default();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(2);
        let points =
            navigable::sample_many(&map, &profile, POINTS_PER_MAP, &mut rng).expect("generated maps have ground");
        Self { seed, points, world: World::new(map, profile, TaskConfig::default()), failures: Vec::new() }
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

/// What follows in a lane whose next row is the last observation of a cut-off episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum AfterBoundary {
    /// Another life.
    Respawn,
    /// Another goal.
    Redirect,
}

/// All collecting state.
#[derive(Debug)]
pub struct Collector {
    config: CollectorConfig,
    arenas: Vec<Arena>,
    /// Lanes whose next row is a boundary.
    boundaries: Vec<Option<AfterBoundary>>,
    /// What each NPC remembers, `[lanes, memory]`.
    memory: Vec<f32>,
    /// Whether it remembers nothing.
    is_fresh: Vec<bool>,
    /// Where each attempt began, if the NPC stood there.
    starts: Vec<Option<Vec3>>,
    rng: ChaCha8Rng,
    rounds: u64,
    total_decisions: u64,
    stats: CollectorStats,
    step: Step,
}

/// An arena's state as plain data.
#[derive(Debug, Serialize, Deserialize)]
struct ArenaState {
    seed: u64,
    world: WorldState,
    failures: Vec<(Vec3, Vec3)>,
}

/// A collector's state as plain data.
#[derive(Debug, Serialize, Deserialize)]
pub struct CollectorState {
    worlds: Vec<ArenaState>,
    starts: Vec<Option<Vec3>>,
    boundaries: Vec<Option<AfterBoundary>>,
    memory: Vec<f32>,
    is_fresh: Vec<bool>,
    rng: RngState,
    rounds: u64,
    total_decisions: u64,
    stats: CollectorStats,
}

impl Collector {
    /// Fresh worlds with an NPC in every lane, each with room for `memory_len` values of memory.
    pub fn new(config: CollectorConfig, memory_len: usize, mut rng: ChaCha8Rng) -> Self {
        let mut arenas = Vec::new();
        for _ in 0..config.world_count {
            let seed = config.map_seeds[rng.random_range(0..config.map_seeds.len())];
            arenas.push(Arena::new(seed, &config));
        }
        let lane_count = config.world_count * config.npcs_per_world;
        let mut collector = Self {
            config,
            arenas,
            boundaries: vec![None; lane_count],
            memory: vec![0.0; lane_count * memory_len],
            is_fresh: vec![true; lane_count],
            starts: vec![None; lane_count],
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
        self.boundaries.len()
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

    /// The lane of an NPC.
    fn lane(&self, arena_idx: usize, slot: NpcSlot) -> usize {
        arena_idx * self.config.npcs_per_world + slot.0 as usize
    }

    fn respawn(&mut self, arena_idx: usize, slot: NpcSlot) {
        let lane = self.lane(arena_idx, slot);
        let memory_len = self.memory.len() / self.lane_count();
        self.memory[lane * memory_len..(lane + 1) * memory_len].fill(0.0);
        self.is_fresh[lane] = true;
        let arena = &mut self.arenas[arena_idx];
        let yaw = self.rng.random_range(-std::f32::consts::PI..std::f32::consts::PI);
        let retries = !arena.failures.is_empty() && self.rng.random_bool(self.config.retry_share);
        if retries {
            let (start, goal) = arena.failures.swap_remove(self.rng.random_range(0..arena.failures.len()));
            arena.world.teleport(slot, start, yaw);
            arena.world.set_goal(slot, goal);
            self.starts[lane] = Some(start);
        } else {
            let feet = arena.random_point(&mut self.rng);
            arena.world.teleport(slot, feet, yaw);
            self.new_goal(arena_idx, slot);
            self.starts[lane] = Some(feet);
        }
    }

    fn new_goal(&mut self, arena_idx: usize, slot: NpcSlot) {
        let lane = self.lane(arena_idx, slot);
        let near = self.rng.random_bool(self.config.near_share);
        let band = if near { self.config.near_goals } else { self.config.far_goals };
        let arena = &mut self.arenas[arena_idx];
        let body = &arena.world.npc(slot).expect("an NPC in every lane").body;
        let (from, stands) = (body.feet, body.is_grounded());
        let goal = arena.goal(from, band, &mut self.rng);
        arena.world.set_goal(slot, goal);
        self.starts[lane] = stands.then_some(from);
    }

    /// Remembers the attempt under way as one to be tried again.
    fn note_failure(&mut self, arena_idx: usize, slot: NpcSlot, lane: usize) {
        let arena = &mut self.arenas[arena_idx];
        let goal = arena.world.npc(slot).and_then(|npc| npc.episode).map(|episode| episode.goal);
        if let Some(failure) = self.starts[lane].zip(goal) {
            if arena.failures.len() < MAX_FAILURES {
                arena.failures.push(failure);
            } else {
                arena.failures[self.rng.random_range(0..MAX_FAILURES)] = failure;
            }
        }
    }

    /// Collects `step_count` decisions of every NPC with `policy` and hands each step to `store`.
    pub fn round(&mut self, policy: &Policy, step_count: usize, mut store: impl FnMut(Step)) {
        self.rounds += 1;
        let exchanged = self
            .rounds
            .is_multiple_of(self.config.rounds_per_map)
            .then(|| (self.rounds / self.config.rounds_per_map) as usize % self.arenas.len());
        for step_idx in 0..step_count {
            let exchange = exchanged.filter(|_| step_idx == 0);
            if let Some(arena_idx) = exchange {
                let npcs = self.config.npcs_per_world;
                self.boundaries[arena_idx * npcs..(arena_idx + 1) * npcs].fill(Some(AfterBoundary::Respawn));
            }
            self.collect_step(policy);
            store(self.step.clone());
            if let Some(arena_idx) = exchange {
                // Its attempts have just ended in boundary rows, so nothing of the old map is continued.
                let seeds = &self.config.map_seeds;
                let seed = seeds[self.rng.random_range(0..seeds.len())];
                self.arenas[arena_idx] = Arena::new(seed, &self.config);
                self.populate(arena_idx);
            }
        }
    }

    fn collect_step(&mut self, policy: &Policy) {
        let lane_count = self.lane_count();
        let npcs = self.config.npcs_per_world;
        self.step.observations.resize(lane_count * OBSERVATION_LEN, 0.0);
        self.step.rewards.clear();
        self.step.kinds.clear();
        for (lane, row) in self.step.observations.chunks_exact_mut(OBSERVATION_LEN).enumerate() {
            self.arenas[lane / npcs].world.observe(NpcSlot((lane % npcs) as u32), row);
        }
        self.step.memory.clone_from(&self.memory);
        self.step.is_fresh.clone_from(&self.is_fresh);
        self.choose_actions(policy);
        self.is_fresh.fill(false);
        for (lane, action) in self.step.actions.iter().enumerate() {
            let action = Action::from_array(*action).expect("policy actions are finite");
            if self.boundaries[lane].is_none() {
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
        match self.boundaries[lane].take() {
            Some(AfterBoundary::Respawn) => {
                self.respawn(arena_idx, slot);
                return (0.0, RowKind::Boundary);
            }
            Some(AfterBoundary::Redirect) => {
                self.new_goal(arena_idx, slot);
                return (0.0, RowKind::Boundary);
            }
            None => {}
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
                } else {
                    self.note_failure(arena_idx, slot, lane);
                }
                self.respawn(arena_idx, slot);
                (outcome.reward, RowKind::Terminated)
            }
            None if stalled < self.config.give_up_after => {
                if self.config.redirect_chance > 0.0 && self.rng.random_bool(self.config.redirect_chance) {
                    self.boundaries[lane] = Some(AfterBoundary::Redirect);
                }
                (outcome.reward, RowKind::Continues)
            }
            _ => {
                self.stats.episodes += 1;
                self.note_failure(arena_idx, slot, lane);
                self.boundaries[lane] = Some(AfterBoundary::Respawn);
                (outcome.reward, RowKind::Continues)
            }
        }
    }

    fn choose_actions(&mut self, policy: &Policy) {
        self.step.actions.clear();
        if self.total_decisions < self.config.random_decisions {
            for _ in 0..self.lane_count() {
                self.step.actions.push([(); ACTION_LEN].map(|()| self.rng.random_range(-1.0..1.0)));
            }
            return;
        }
        let mut actions = Vec::new();
        policy.act(&self.step.observations, &mut self.memory, 1.0, &mut self.rng, &mut actions);
        self.step.actions.extend(actions.iter().map(|action| action.to_array()));
    }

    /// All state as plain data.
    pub fn save(&self) -> CollectorState {
        CollectorState {
            worlds: self
                .arenas
                .iter()
                .map(|arena| ArenaState {
                    seed: arena.seed,
                    world: arena.world.save(),
                    failures: arena.failures.clone(),
                })
                .collect(),
            starts: self.starts.clone(),
            boundaries: self.boundaries.clone(),
            memory: self.memory.clone(),
            is_fresh: self.is_fresh.clone(),
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
            .map(|ArenaState { seed, world, failures }| {
                let mut arena = Arena::new(seed, &config);
                arena.world.restore(world);
                Arena { failures, ..arena }
            })
            .collect();
        Self {
            config,
            arenas,
            boundaries: state.boundaries,
            memory: state.memory,
            is_fresh: state.is_fresh,
            starts: state.starts,
            rng: state.rng.generator(),
            rounds: state.rounds,
            total_decisions: state.total_decisions,
            stats: state.stats,
            step: Step::default(),
        }
    }
}
