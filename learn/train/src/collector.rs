//! Collects experience in this process: many NPCs on a few maps decide together in the [decision loop](DecisionLoop).

use super::arena::Arena;
use super::config::CollectorConfig;
use super::replay::{RowKind, Step};
use super::rng::{RngState, random_action};
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use surefoot_policy::{ActorConfig, Policy};
use surefoot_rollout::goals::random_yaw;
use surefoot_rollout::{DecidingNpc, DecisionBatch, DecisionLoop, Noise};
use surefoot_world::{Action, DecisionOutcome, End, NpcSlot, Vec3, World, WorldState};

/// Statistics since the last call of [`Collector::take_stats`].
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct CollectorStats {
    /// Number of decisions.
    pub decisions: u64,
    /// Number of episodes that ended.
    pub episodes: u64,
    /// Number of episodes that reached their goal.
    pub reached: u64,
    /// Sum of all rewards.
    pub reward: f64,
}

impl CollectorStats {
    /// Adds other statistics.
    pub(super) fn add(&mut self, other: Self) {
        self.decisions += other.decisions;
        self.episodes += other.episodes;
        self.reached += other.reached;
        self.reward += other.reward;
    }
}

/// What follows a boundary row: the last observation of a truncated episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum AfterBoundary {
    /// Respawn with a new goal.
    Respawn,
    /// Continue from the same place with a new goal.
    Redirect,
}

/// The collector with all its state.
#[derive(Debug)]
pub struct Collector {
    config: CollectorConfig,
    arenas: Vec<Arena>,
    /// One world for each arena.
    worlds: Vec<World>,
    /// All lanes, world by world.
    lanes: Vec<DecidingNpc>,
    decisions: DecisionLoop,
    /// For each lane whose next row is a boundary, what follows it.
    boundaries: Vec<Option<AfterBoundary>>,
    /// Whether each lane's hidden state is the initial one.
    is_fresh: Vec<bool>,
    /// Start of each lane's attempt; `None` if the NPC was not grounded.
    starts: Vec<Option<Vec3>>,
    rng: ChaCha8Rng,
    rounds: u64,
    total_decisions: u64,
    stats: CollectorStats,
}

/// An arena's state as plain data.
#[derive(Debug, Serialize, Deserialize)]
struct ArenaState {
    seed: u64,
    world: WorldState,
    failures: Vec<(Vec3, Vec3)>,
}

impl ArenaState {
    /// Restores the arena and its world; `None` if the state is invalid.
    fn restore(self, config: &CollectorConfig) -> Option<(Arena, World)> {
        let (mut arena, mut world) = Arena::new(self.seed, config);
        let is_whole = self.world.fits(1, world.map())
            && self.world.slots().eq((0..config.npcs_per_world as u32).map(NpcSlot))
            && self.failures.iter().flat_map(|(start, goal)| [start, goal]).all(|place| place.is_finite());
        is_whole.then(|| {
            world.restore(self.world);
            arena.failures = self.failures;
            (arena, world)
        })
    }
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

fn lanes_of(config: &CollectorConfig) -> Vec<DecidingNpc> {
    let npcs = config.npcs_per_world;
    let lane = |idx: usize| DecidingNpc {
        world_idx: idx / npcs,
        row_idx: idx,
        ..DecidingNpc::of(NpcSlot((idx % npcs) as u32))
    };
    (0..config.world_count * npcs).map(lane).collect()
}

impl Collector {
    /// Creates worlds with an NPC in every lane, for agents of these sizes.
    pub fn new(config: CollectorConfig, network: &ActorConfig, mut rng: ChaCha8Rng) -> Self {
        let drawn = (0..config.world_count).map(|_| {
            let seed = config.map_seeds[rng.random_range(0..config.map_seeds.len())];
            Arena::new(seed, &config)
        });
        let (arenas, worlds) = drawn.unzip();
        let lanes = lanes_of(&config);
        let mut collector = Self {
            arenas,
            worlds,
            decisions: DecisionLoop::of_lens(network.observation_len(), network.hidden_len()),
            boundaries: vec![None; lanes.len()],
            is_fresh: vec![true; lanes.len()],
            starts: vec![None; lanes.len()],
            lanes,
            rng,
            rounds: 0,
            total_decisions: 0,
            stats: CollectorStats::default(),
            config,
        };
        (0..collector.arenas.len()).for_each(|world_idx| collector.populate(world_idx));
        collector
    }

    /// Total number of NPCs.
    pub fn lane_count(&self) -> usize {
        self.lanes.len()
    }

    /// Number of decisions since the start of the run.
    pub fn total_decisions(&self) -> u64 {
        self.total_decisions
    }

    /// Returns and resets the statistics since the last call.
    pub fn take_stats(&mut self) -> CollectorStats {
        std::mem::take(&mut self.stats)
    }

    /// Collects `step_count` decisions of every NPC with `policy`, step by step; `version` is the number of updates
    /// behind it.
    pub fn collect(&mut self, policy: &Policy, version: u64, step_count: usize) -> Vec<Step> {
        self.rounds += 1;
        let is_due = self.rounds.is_multiple_of(self.config.rounds_per_map);
        let replaced = is_due.then(|| (self.rounds / self.config.rounds_per_map) as usize % self.arenas.len());
        let mut steps = Vec::with_capacity(step_count);
        for step_idx in 0..step_count {
            let replaced = replaced.filter(|_| step_idx == 0);
            if let Some(world_idx) = replaced {
                let lanes = self.lanes_on(world_idx);
                self.boundaries[lanes].fill(Some(AfterBoundary::Respawn));
            }
            steps.push(Step { version, ..self.step(policy) });
            if let Some(world_idx) = replaced {
                // The old map's attempts have just ended in boundary rows, so none continues on the new map.
                self.replace_map(world_idx);
            }
        }
        steps
    }

    // --- one step ---

    fn step(&mut self, policy: &Policy) -> Step {
        self.decisions.observe(&self.worlds, &self.lanes);
        let observations = self.decisions.observations().to_vec();
        let memory = self.decisions.hidden().to_vec();
        let is_fresh = std::mem::replace(&mut self.is_fresh, vec![false; self.lanes.len()]);
        let actions = self.choose_actions(policy);
        let outcomes = self.advance(&actions);
        let (mut rewards, mut kinds) = (Vec::with_capacity(self.lanes.len()), Vec::with_capacity(self.lanes.len()));
        for (lane_idx, outcome) in outcomes.into_iter().enumerate() {
            let (reward, kind) = match outcome {
                Some(outcome) => self.settle(lane_idx, outcome),
                None => self.pass_boundary(lane_idx),
            };
            rewards.push(reward);
            kinds.push(kind);
            self.stats.reward += f64::from(reward);
        }
        self.stats.decisions += self.lanes.len() as u64;
        self.total_decisions += self.lanes.len() as u64;
        let actions = actions.iter().map(|action| action.to_array()).collect();
        Step { observations, memory, is_fresh, actions, rewards, kinds, version: 0 }
    }

    /// The policy's actions, or random ones at the start of a run.
    fn choose_actions(&mut self, policy: &Policy) -> Vec<Action> {
        if self.total_decisions >= self.config.random_decisions {
            self.decisions.act(&self.lanes, policy, Noise::Shared(1.0, &mut self.rng));
            return self.decisions.actions().to_vec();
        }
        self.lanes.iter().map(|_| random_action(&mut self.rng)).collect()
    }

    /// Runs one decision of every lane that is not at a boundary and returns its outcome, lane by lane.
    fn advance(&mut self, actions: &[Action]) -> Vec<Option<DecisionOutcome>> {
        let is_deciding = |idx: &usize| self.boundaries[*idx].is_none();
        let deciding: Vec<usize> = (0..self.lanes.len()).filter(is_deciding).collect();
        let lanes: Vec<DecidingNpc> = deciding.iter().map(|&idx| self.lanes[idx]).collect();
        let actions: Vec<Action> = deciding.iter().map(|&idx| actions[idx]).collect();
        let mut batch = DecisionBatch { worlds: &mut self.worlds, npcs: &lanes };
        let closed = self.decisions.advance(&mut batch, &actions);
        let mut outcomes = vec![None; self.lanes.len()];
        deciding.iter().zip(closed).for_each(|(&idx, outcome)| outcomes[idx] = Some(*outcome));
        outcomes
    }

    /// Respawns or redirects a lane at its boundary row.
    fn pass_boundary(&mut self, lane_idx: usize) -> (f32, RowKind) {
        match self.boundaries[lane_idx].take().expect("a lane at a boundary") {
            AfterBoundary::Respawn => self.respawn(lane_idx),
            AfterBoundary::Redirect => self.new_goal(lane_idx),
        }
        (0.0, RowKind::Boundary)
    }

    /// Processes the outcome of one lane's decision and prepares its next row.
    fn settle(&mut self, lane_idx: usize, outcome: DecisionOutcome) -> (f32, RowKind) {
        let DecidingNpc { world_idx, slot, .. } = self.lanes[lane_idx];
        let episode = self.worlds[world_idx].npc(slot).and_then(|npc| npc.episode);
        let stalled = episode.map_or(0, |episode| episode.stalled_decisions);
        match outcome.end {
            Some(end) if !end.is_truncation() => {
                self.stats.episodes += 1;
                if end == End::Reached {
                    self.stats.reached += 1;
                    if self.rng.random_bool(self.config.switch_chance) {
                        self.new_goal(lane_idx);
                        return (outcome.reward, RowKind::Terminated);
                    }
                } else {
                    self.note_failure(lane_idx);
                }
                self.respawn(lane_idx);
                (outcome.reward, RowKind::Terminated)
            }
            None if stalled < self.config.give_up_after => {
                if self.config.redirect_chance > 0.0 && self.rng.random_bool(self.config.redirect_chance) {
                    self.boundaries[lane_idx] = Some(AfterBoundary::Redirect);
                }
                (outcome.reward, RowKind::Continues)
            }
            _ => {
                self.stats.episodes += 1;
                self.note_failure(lane_idx);
                self.boundaries[lane_idx] = Some(AfterBoundary::Respawn);
                (outcome.reward, RowKind::Continues)
            }
        }
    }

    // --- spawns and goals ---

    /// Indices of one world's lanes.
    fn lanes_on(&self, world_idx: usize) -> std::ops::Range<usize> {
        let npcs = self.config.npcs_per_world;
        world_idx * npcs..(world_idx + 1) * npcs
    }

    /// Replaces the map of one world by another.
    fn replace_map(&mut self, world_idx: usize) {
        let seeds = &self.config.map_seeds;
        let seed = seeds[self.rng.random_range(0..seeds.len())];
        (self.arenas[world_idx], self.worlds[world_idx]) = Arena::new(seed, &self.config);
        self.populate(world_idx);
    }

    fn populate(&mut self, world_idx: usize) {
        for lane_idx in self.lanes_on(world_idx) {
            let slot = self.worlds[world_idx].spawn(Vec3::ZERO, 0.0);
            assert_eq!(slot, self.lanes[lane_idx].slot, "lanes are slots");
            self.respawn(lane_idx);
        }
    }

    fn respawn(&mut self, lane_idx: usize) {
        let DecidingNpc { world_idx, slot, row_idx, .. } = self.lanes[lane_idx];
        self.decisions.begin(row_idx);
        self.is_fresh[lane_idx] = true;
        let yaw = random_yaw(&mut self.rng);
        let arena = &mut self.arenas[world_idx];
        if let Some((start, goal)) = arena.draw_retry(&self.config, &mut self.rng) {
            self.worlds[world_idx].teleport(slot, start, yaw);
            self.worlds[world_idx].set_waypoint(slot, goal);
            self.starts[lane_idx] = Some(start);
        } else {
            let feet = arena.random_point(&mut self.rng);
            self.worlds[world_idx].teleport(slot, feet, yaw);
            self.new_goal(lane_idx);
            self.starts[lane_idx] = Some(feet);
        }
    }

    fn new_goal(&mut self, lane_idx: usize) {
        let DecidingNpc { world_idx, slot, .. } = self.lanes[lane_idx];
        let world = &mut self.worlds[world_idx];
        let body = &world.npc(slot).expect("an NPC in every lane").body;
        let (from, is_grounded) = (body.feet, body.is_grounded());
        let goal = self.arenas[world_idx].goal(from, &self.config, &mut self.rng);
        world.set_waypoint(slot, goal);
        self.starts[lane_idx] = is_grounded.then_some(from);
    }

    /// Stores the running attempt for a retry, if it has a grounded start.
    fn note_failure(&mut self, lane_idx: usize) {
        let DecidingNpc { world_idx, slot, .. } = self.lanes[lane_idx];
        let episode = self.worlds[world_idx].npc(slot).and_then(|npc| npc.episode);
        if let Some(failure) = self.starts[lane_idx].zip(episode.map(|episode| episode.goal)) {
            self.arenas[world_idx].note_failure(failure, &mut self.rng);
        }
    }

    // --- state ---

    /// Returns the whole state as plain data.
    pub fn save(&self) -> CollectorState {
        let arena = |(arena, world): (&Arena, &World)| ArenaState {
            seed: arena.seed,
            world: world.save(),
            failures: arena.failures.clone(),
        };
        CollectorState {
            worlds: self.arenas.iter().zip(&self.worlds).map(arena).collect(),
            starts: self.starts.clone(),
            boundaries: self.boundaries.clone(),
            memory: self.decisions.hidden().to_vec(),
            is_fresh: self.is_fresh.clone(),
            rng: RngState::of(&self.rng),
            rounds: self.rounds,
            total_decisions: self.total_decisions,
            stats: self.stats,
        }
    }

    /// Restores a collector from saved state; `None` if it cannot be the state of a collector with `config` for agents
    /// of these sizes.
    pub fn restore(config: CollectorConfig, network: &ActorConfig, state: CollectorState) -> Option<Self> {
        let lanes = lanes_of(&config);
        let lens = [state.starts.len(), state.boundaries.len(), state.is_fresh.len()];
        let is_whole = lens.into_iter().all(|len| len == lanes.len())
            && state.memory.len() == lanes.len() * network.hidden_len()
            && state.worlds.len() == config.world_count
            && state.starts.iter().flatten().all(|start| start.is_finite());
        if !is_whole {
            return None;
        }
        let restored = state.worlds.into_iter().map(|state| state.restore(&config)).collect::<Option<Vec<_>>>()?;
        let (arenas, worlds) = restored.into_iter().unzip();
        let mut decisions = DecisionLoop::of_lens(network.observation_len(), network.hidden_len());
        decisions.set_hidden(state.memory);
        Some(Self {
            arenas,
            worlds,
            lanes,
            decisions,
            boundaries: state.boundaries,
            is_fresh: state.is_fresh,
            starts: state.starts,
            rng: state.rng.generator(),
            rounds: state.rounds,
            total_decisions: state.total_decisions,
            stats: state.stats,
            config,
        })
    }
}
