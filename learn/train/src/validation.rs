//! Validation: fixed goals on maps outside the training set, to select the best weights.

use super::config::TrainConfig;
use super::worlds::Connect;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use surefoot_game_client::attempts::{Rules, attempt};
use surefoot_game_client::{GameError, Level};
use surefoot_policy::Policy;
use surefoot_rollout::{AttemptResult, FollowConfig, Goal, Rollout};
use surefoot_world::{CharacterProfile, End, Map, TaskConfig, navigable};

/// Success of a policy on validation maps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Share of goals at 2 to 25 m that were reached.
    pub near: f64,
    /// Share of goals at 25 to 60 m that were reached.
    pub far: f64,
}

/// The fixed goals for the validation of a run.
pub(super) struct ValidationSet {
    maps: Vec<(Arc<Map>, Vec<Goal>, Vec<Goal>)>,
    body: CharacterProfile,
    task: TaskConfig,
}

impl ValidationSet {
    pub fn new(config: &TrainConfig) -> Self {
        let maps = config
            .validation_seeds
            .iter()
            .map(|&seed| {
                let map = Arc::new(config.collector.map(seed).expect("checked before training"));
                let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x5EED);
                let points = navigable::sample_many(&map, &config.collector.body, 800, &mut rng).expect("ground");
                let near = Goal::draw(&points, 2.0..25.0, config.validation_goals, &mut rng);
                let far = Goal::draw(&points, 25.0..60.0, config.validation_goals, &mut rng);
                (map, near, far)
            })
            .collect();
        Self { maps, body: config.collector.body.clone(), task: TaskConfig::default() }
    }

    /// Sends NPCs to the goals, in `worlds` if given, otherwise in this process.
    ///
    /// # Errors
    /// If a world fails.
    pub fn measure(
        &self,
        policy: &Policy,
        noise_share: f32,
        worlds: Option<(&[String], &Connect)>,
    ) -> Result<Validation, GameError> {
        let mut reached = [0usize; 2];
        let mut tried = [0usize; 2];
        for (map_idx, (map, near, far)) in self.maps.iter().enumerate() {
            for (band, goals) in [near, far].into_iter().enumerate() {
                let ends = match worlds {
                    None => self.run_here(map, policy, noise_share, goals),
                    Some((uris, connect)) => {
                        let level = Level { map: map.clone(), body: self.body.clone(), solid_npcs: false };
                        let game = connect(&uris[map_idx % uris.len()])?;
                        let rules = Rules { follow: self.follow(), rehearses: false, noise_share, seed: 0 };
                        attempt(&game, &level, policy, None, (goals, rules))?.0
                    }
                };
                tried[band] += ends.len();
                reached[band] += ends.iter().filter(|attempt| attempt.end == End::Reached).count();
            }
        }
        let share = |band: usize| reached[band] as f64 / tried[band].max(1) as f64;
        Ok(Validation { near: share(0), far: share(1) })
    }

    fn follow(&self) -> FollowConfig {
        // Shorter than the task's patience, which is enough to rank weights.
        FollowConfig { patience: 90, ..FollowConfig::default() }
    }

    fn run_here(&self, map: &Arc<Map>, policy: &Policy, noise_share: f32, goals: &[Goal]) -> Vec<AttemptResult> {
        let mut rollout = Rollout::new(map.clone(), self.body.clone(), self.task.clone());
        rollout.follow = self.follow();
        rollout.noise_share = noise_share;
        rollout.run(policy, goals)
    }
}

impl Validation {
    /// The score that ranks weights; far goals count half.
    pub(super) fn score(&self) -> f64 {
        self.near + 0.5 * self.far
    }
}
