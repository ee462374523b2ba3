//! Toy tasks that both agents must solve from scratch.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::sync::Arc;
use surefoot_policy::config::RAY_LEN;
use surefoot_policy::{ActorConfig, Batch as Rows, Policy, Scratch};
use surefoot_rollout::{Goal, Rollout};
use surefoot_train::CollectorConfig;
use surefoot_train::Run;
use surefoot_train::TrainConfig;
use surefoot_train::replay::Batch;
use surefoot_train::{Learner, SacConfig};
use surefoot_world::map::Features;
use surefoot_world::{CharacterProfile, End, OBSERVATION_LEN, TaskConfig, navigable};

/// Near goals on small maps without features.
fn field(network: ActorConfig) -> TrainConfig {
    let base = if network.memory.is_some() { TrainConfig::recurrent() } else { TrainConfig::default() };
    TrainConfig {
        seed: 5,
        batch: if network.memory.is_some() { 12 } else { 128 },
        burn_in: if network.memory.is_some() { 4 } else { 0 },
        learn: if network.memory.is_some() { 10 } else { 1 },
        steps_per_round: 4,
        updates_per_round: 16,
        replay_capacity: 60_000,
        sac: SacConfig { network, learning_rate: 1.0e-3, actor_interval: 1, ..SacConfig::default() },
        collector: CollectorConfig {
            map_seeds: vec![0, 1],
            map_side: 60,
            map_features: "none".parse::<Features>().unwrap(),
            world_count: 2,
            npcs_per_world: 16,
            rounds_per_map: 1_000_000,
            near_share: 1.0,
            near_goals: (2.0, 10.0),
            give_up_after: 20,
            random_decisions: 2_000,
            ..CollectorConfig::default()
        },
        ..base
    }
}

/// Share of goals reached on a map outside the training set.
fn success(policy: &Policy, config: &CollectorConfig) -> f64 {
    let map = Arc::new(surefoot_generate::generate(&config.spec(1000).unwrap()));
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let points = navigable::sample_many(&map, &CharacterProfile::default(), 400, &mut rng).unwrap();
    let goals = Goal::draw(&points, 2.0..10.0, 100, &mut rng);
    let mut rollout = Rollout::new(map, CharacterProfile::default(), TaskConfig::default());
    rollout.follow.patience = 30;
    let reached = rollout.run(policy, &goals).iter().filter(|attempt| attempt.end == End::Reached).count();
    reached as f64 / goals.len() as f64
}

fn learns_to_reach_goals(network: ActorConfig, updates: u64) {
    let config = field(network);
    let mut run = Run::new(config.clone()).unwrap();
    let before = success(&run.policy(), &config.collector);
    while run.updates() < updates {
        run.round().unwrap();
    }
    let after = success(&run.policy(), &config.collector);
    assert!(before < 0.4, "untrained it reaches {before}");
    assert!(after > 0.85, "trained it reaches {after}");
}

#[test]
fn the_reactive_agent_learns_to_reach_goals_from_scratch() {
    learns_to_reach_goals(ActorConfig { ray_features: 16, hidden: 64, memory: None, sees_others: false }, 2500);
}

#[test]
fn the_recurrent_agent_learns_to_reach_goals_from_scratch() {
    learns_to_reach_goals(
        ActorConfig { ray_features: 16, hidden: 64, memory: std::num::NonZeroUsize::new(16), sees_others: false },
        2500,
    );
}

const SEQUENCES: usize = 16;
const STEPS: usize = 8;

/// A cue is shown at the first step; every later action is best where it matches the cue.
fn cued_batch(rng: &mut ChaCha8Rng, memory: usize) -> Batch {
    let rows = (STEPS + 1) * SEQUENCES;
    let cues: Vec<f32> = (0..SEQUENCES).map(|_| if rng.random_bool(0.5) { 1.0 } else { -1.0 }).collect();
    let mut observations = vec![0.0; rows * OBSERVATION_LEN];
    for (sequence, cue) in cues.iter().enumerate() {
        observations[sequence * OBSERVATION_LEN + RAY_LEN] = *cue;
    }
    let learned = STEPS * SEQUENCES;
    let actions: Vec<f32> = (0..learned * 4).map(|_| rng.random_range(-1.0..1.0)).collect();
    let returns = actions.chunks_exact(4).enumerate().map(|(row, action)| {
        let best = 0.3 * cues[row % SEQUENCES];
        2.0 - 4.0 * (action[0] - best).powi(2)
    });
    Batch {
        size: SEQUENCES,
        burn_in: 0,
        learn: STEPS,
        keep: (0..rows).map(|row| if row < SEQUENCES { 0.0 } else { 1.0 }).collect(),
        memory: vec![0.0; SEQUENCES * 2 * memory],
        returns: returns.collect(),
        bootstrap: vec![0.0; learned],
        weights: vec![1.0; learned],
        successors: vec![0; learned],
        observations,
        actions,
    }
}

#[test]
fn the_recurrent_agent_acts_on_what_it_saw_before() {
    let network =
        ActorConfig { ray_features: 8, hidden: 32, memory: std::num::NonZeroUsize::new(16), sees_others: false };
    let config = SacConfig { network, learning_rate: 2.0e-3, ..SacConfig::default() };
    let mut learner = Learner::new(config, ChaCha8Rng::seed_from_u64(1));
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for _ in 0..1500 {
        let batch = cued_batch(&mut rng, network.memory_len());
        learner.update(&batch);
    }
    let policy = learner.policy("cued");
    let mut memory = vec![0.0; 2 * policy.memory_len()];
    let mut actions = Vec::new();
    for step in 0..STEPS {
        let mut observations = vec![0.0; 2 * OBSERVATION_LEN];
        if step == 0 {
            observations[RAY_LEN] = 1.0;
            observations[OBSERVATION_LEN + RAY_LEN] = -1.0;
        }
        let rows = Rows { observations: &observations, memory: &mut memory, noise: &[] };
        policy.act(rows, &mut Scratch::default(), &mut actions);
    }
    let last = [actions[0].forward, actions[1].forward];
    assert!((last[0] - 0.3).abs() < 0.15 && (last[1] + 0.3).abs() < 0.15, "{last:?}");
}

#[test]
fn the_reactive_agent_finds_the_better_action_of_a_bandit() {
    let network = ActorConfig { ray_features: 8, hidden: 32, memory: None, sees_others: false };
    let config = SacConfig { network, learning_rate: 1.0e-3, ..SacConfig::default() };
    let mut learner = Learner::new(config, ChaCha8Rng::seed_from_u64(1));
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    // Reward is highest where `forward` is -0.3, and every step is terminal.
    for _ in 0..1500 {
        let actions: Vec<f32> = (0..64 * 4).map(|_| rng.random_range(-1.0..1.0)).collect();
        let returns = actions.chunks_exact(4).map(|action| 2.0 - 4.0 * (action[0] + 0.3).powi(2)).collect();
        let mut observations = vec![0.1; 2 * 64 * OBSERVATION_LEN];
        observations[64 * OBSERVATION_LEN..].fill(0.0);
        learner.update(&Batch {
            size: 64,
            burn_in: 0,
            learn: 1,
            observations,
            keep: vec![1.0; 2 * 64],
            memory: Vec::new(),
            bootstrap: vec![0.0; 64],
            weights: vec![1.0; 64],
            successors: (64..128).collect(),
            actions,
            returns,
        });
    }
    let policy = learner.policy("bandit");
    let mut actions = Vec::new();
    let rows = Rows { observations: &[0.1; OBSERVATION_LEN], memory: &mut [], noise: &[] };
    policy.act(rows, &mut Scratch::default(), &mut actions);
    assert!((actions[0].forward + 0.3).abs() < 0.15, "{}", actions[0].forward);
}
