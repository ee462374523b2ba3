//! The learner: actor, twin critics, their targets and the temperature, and one update of all of them.
//!
//! Start at [`Learner::update`]; the losses are in [`losses`](super::losses). Actor and critics have separate encoders,
//! which the GameRLand3D paper found to be more stable.

use super::adam::adam;
use super::batch::Rows;
use super::config::SacConfig;
use super::critic::{CRITIC_COUNT, Critics};
use super::losses::{actor_loss, critic_loss, sample_squashed, soft_targets, temperature_loss};
use super::networks::state::HiddenState;
use super::networks::trunk::Encoding;
use super::networks::{ActorNetwork, load_module, module_bytes};
use super::replay::Batch;
use super::rng::RngState;
use burn::module::{Module, Param};
use burn::optim::{GradientsParams, ModuleOptimizer};
use burn::tensor::{Bytes, Device, Tensor, TensorData};
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::path::Path;
use surefoot_policy::noise::gaussian;
use surefoot_policy::{CheckpointError, Manifest, Policy};
use surefoot_world::character::ACTION_LEN;

/// Name of the critics' weights file inside a model's folder.
pub const CRITICS_FILE: &str = "critics.bpk";

/// The logarithm of the temperature, as a module so that Adam can optimize it.
#[derive(Module, Debug)]
struct Temperature {
    log_alpha: Param<Tensor<1>>,
}

/// The learner with all its state.
pub struct Learner {
    config: SacConfig,
    actor: ActorNetwork,
    critics: Critics,
    target: Critics,
    temperature: Temperature,
    actor_optimizer: ModuleOptimizer,
    critic_optimizer: ModuleOptimizer,
    temperature_optimizer: ModuleOptimizer,
    updates: u64,
    rng: ChaCha8Rng,
    device: Device,
}

/// Statistics of one update, for the log.
#[derive(Debug, Clone, Copy, Default)]
pub struct UpdateStats {
    /// Sum of both critics' squared Bellman errors.
    pub critic_loss: f32,
    /// Mean action value over both critics.
    pub q_mean: f32,
    /// Mean of alpha log pi - Q; NaN when the actor was not updated.
    pub actor_loss: f32,
    /// Mean negative log probability of the policy's actions, in nats; NaN when the actor was not updated.
    pub entropy: f32,
    /// Temperature before the update.
    pub alpha: f32,
}

/// A learner's state as bytes.
#[derive(Debug, Serialize, Deserialize)]
pub struct LearnerState {
    modules: [Vec<u8>; 4],
    optimizers: [Vec<u8>; 3],
    updates: u64,
    rng: RngState,
}

impl Learner {
    /// A learner on the CPU, with networks drawn from `rng`.
    pub fn new(config: SacConfig, rng: ChaCha8Rng) -> Self {
        Self::on(Device::flex(), config, rng)
    }

    /// A learner on `device`, with networks drawn from `rng`.
    pub fn on(device: Device, config: SacConfig, mut rng: ChaCha8Rng) -> Self {
        let device = device.autodiff();
        let actor = ActorNetwork::new(&config.network, &device, &mut rng);
        let critics = Critics::new(&config.network, &device, &mut rng);
        let log_alpha = TensorData::new(vec![config.initial_alpha.ln()], [1]);
        Self {
            actor,
            target: critics.valid(),
            critics,
            temperature: Temperature { log_alpha: Param::from_data(log_alpha, &device) },
            actor_optimizer: adam(),
            critic_optimizer: adam(),
            temperature_optimizer: adam(),
            updates: 0,
            config,
            rng,
            device,
        }
    }

    /// Loads the networks of a trained model. A recurrent learner can start from a reactive model and adds the LSTM;
    /// one that sees others can start from one that does not.
    ///
    /// Returns the model's manifest.
    ///
    /// # Errors
    /// If the model cannot be read or does not fit the configured networks.
    pub fn start_from(&mut self, folder: &Path) -> Result<Manifest, CheckpointError> {
        let start = Policy::load(folder)?;
        let manifest = start.manifest();
        let path = folder.join(CRITICS_FILE);
        let critics = std::fs::read(&path).map_err(|source| CheckpointError::Io { path, source })?;
        let actor = load_module(ActorNetwork::new(&manifest.actor, &self.device, &mut self.rng), start.weights())?;
        let critics = load_module(Critics::new(&manifest.actor, &self.device, &mut self.rng), &critics)?;
        let sizes = (&manifest.actor, &self.config.network);
        let actor = actor.grown(sizes.0, sizes.1, &self.device, &mut self.rng);
        let critics = critics.grown(sizes.0, sizes.1, &self.device, &mut self.rng);
        // Loading checks that the shapes match the configuration.
        self.actor = load_module(self.actor.clone(), &module_bytes(&actor)?)?;
        self.critics = load_module(self.critics.clone(), &module_bytes(&critics)?)?;
        self.target = self.critics.valid();
        Ok(manifest.clone())
    }

    /// The current policy network.
    pub fn actor(&self) -> &ActorNetwork {
        &self.actor
    }

    /// The current policy.
    pub fn policy(&self, name: &str) -> Policy {
        let weights = module_bytes(&self.actor).expect("a network of plain tensors");
        let manifest = Manifest::new(name, self.config.network, &weights, serde_json::Value::Null);
        Policy::from_bytes(manifest, &weights).expect("weights of the configured sizes")
    }

    /// The current critics.
    pub fn critics(&self) -> &Critics {
        &self.critics
    }

    /// Number of updates so far.
    pub fn updates(&self) -> u64 {
        self.updates
    }

    /// The random generator for drawing batches.
    pub fn rng(&mut self) -> &mut ChaCha8Rng {
        &mut self.rng
    }

    /// Updates the critics and, at every `actor_interval`-th call, the actor and the temperature.
    pub fn update(&mut self, batch: &Batch) -> UpdateStats {
        let rows = Rows::new(batch, &self.device.clone().inner());
        let alpha = self.alpha();
        let targets = self.targets(&rows, alpha);

        let state = self.warm_critics(&rows);
        let past = state.as_ref().map(|state| rows.past(state));
        let (encoding, _) = self.critics.encode(rows.learned.clone().autodiff(), past);
        let values = self.critics.value(encoding.clone(), rows.actions.clone().autodiff());
        let loss = critic_loss(values.clone(), targets.autodiff(), rows.weights.clone().autodiff());
        let mut stats = UpdateStats {
            critic_loss: scalar(loss.clone()),
            q_mean: scalar(values.mean()),
            actor_loss: f32::NAN,
            entropy: f32::NAN,
            alpha,
        };
        let critic_gradients = GradientsParams::from_grads(loss.backward(), &self.critics);
        if self.updates.is_multiple_of(self.config.actor_interval) {
            // The actor's loss reuses the critics' encoding of the observations.
            let mean_log_prob = self.update_actor(&rows, encoding.detach(), alpha, &mut stats);
            self.update_temperature(mean_log_prob);
        }
        self.critics = self.critic_optimizer.step(self.learning_rate(), self.critics.clone(), critic_gradients);
        self.target = self.target.clone().soft_update(&self.critics.valid(), self.config.tau);
        self.updates += 1;
        stats
    }

    /// Targets of the critics' values; see [`soft_targets`].
    fn targets(&mut self, rows: &Rows<'_>, alpha: f32) -> Tensor<2> {
        let noise = self.noise(rows.learned_count(), &rows.device);
        let actor = self.actor.valid();
        let (actor_encoding, encoding) = if actor.memory_size().is_some() {
            // The LSTMs must process every step before the successors can be selected.
            let all = rows.all();
            let state = rows.actor_memory();
            let critic_state = rows.empty_memory(CRITIC_COUNT);
            let (actor_encoding, _) = actor.encode(all.clone(), Some(rows.whole_past(&state)));
            let (encoding, _) = self.target.encode(all, Some(rows.whole_past(&critic_state)));
            (actor_encoding.select(&rows.successors), encoding.select(&rows.successors))
        } else {
            let successors = rows.all().select(0, rows.successors.clone());
            (actor.encode(successors.clone(), None).0, self.target.encode(successors, None).0)
        };
        let distribution = actor.decide(actor_encoding);
        let (actions, log_prob) = sample_squashed(distribution, noise);
        let value = self.target.smaller_value(encoding, actions);
        soft_targets(rows.returns.clone(), rows.bootstrap.clone(), value, log_prob, alpha)
    }

    /// The critics' hidden state after burn-in from the initial state; `None` for a reactive agent.
    fn warm_critics(&self, rows: &Rows<'_>) -> Option<HiddenState> {
        self.actor.memory_size()?;
        let empty = rows.empty_memory(CRITIC_COUNT);
        let Some(observations) = rows.burn_in() else { return Some(empty) };
        self.critics.valid().encode(observations, Some(rows.burn_in_past(&empty))).1
    }

    /// The actor's hidden state after burn-in from the stored state; `None` for a reactive agent.
    fn warm_actor(&self, rows: &Rows<'_>) -> Option<HiddenState> {
        self.actor.memory_size()?;
        let stored = rows.actor_memory();
        let Some(observations) = rows.burn_in() else { return Some(stored) };
        self.actor.valid().encode(observations, Some(rows.burn_in_past(&stored))).1
    }

    /// Updates the actor and returns the mean log probability of its actions.
    fn update_actor(&mut self, rows: &Rows<'_>, encoding: Encoding, alpha: f32, stats: &mut UpdateStats) -> f32 {
        let noise = self.noise(rows.learned_count(), &rows.device).autodiff();
        let weights = rows.weights.clone().autodiff();
        let state = self.warm_actor(rows);
        let past = state.as_ref().map(|state| rows.past(state));
        let (distribution, _) = self.actor.forward(rows.learned.clone().autodiff(), past);
        let (actions, log_prob) = sample_squashed(distribution, noise);
        let value = self.critics.clone().no_grad().smaller_value(encoding, actions);
        let loss = actor_loss(log_prob.clone(), value, weights.clone(), alpha);
        stats.actor_loss = scalar(loss.clone());
        let mean_log_prob = scalar((log_prob * weights).sum());
        stats.entropy = -mean_log_prob;
        let gradients = GradientsParams::from_grads(loss.backward(), &self.actor);
        self.actor = self.actor_optimizer.step(self.learning_rate(), self.actor.clone(), gradients);
        mean_log_prob
    }

    fn update_temperature(&mut self, mean_log_prob: f32) {
        let loss = temperature_loss(self.temperature.log_alpha.val(), mean_log_prob, self.config.target_entropy);
        let gradients = GradientsParams::from_grads(loss.backward(), &self.temperature);
        self.temperature = self.temperature_optimizer.step(self.learning_rate(), self.temperature.clone(), gradients);
    }

    fn learning_rate(&self) -> f64 {
        let done =
            self.config.decay_updates.map_or(0.0, |updates| (self.updates as f64 / updates.get() as f64).min(1.0));
        self.config.learning_rate * (1.0 - 0.9 * done)
    }

    fn alpha(&self) -> f32 {
        scalar(self.temperature.log_alpha.val()).exp().max(self.config.min_alpha)
    }

    /// Standard normal values `[size, ACTION_LEN]` from the learner's own generator.
    fn noise(&mut self, size: usize, device: &Device) -> Tensor<2> {
        let values = gaussian(&mut self.rng, size * ACTION_LEN);
        Tensor::from_data(TensorData::new(values, [size, ACTION_LEN]), device)
    }

    /// Serializes the whole state.
    pub fn save(&self) -> Result<LearnerState, CheckpointError> {
        let optimizer = |optimizer: &ModuleOptimizer| {
            optimizer
                .into_bytes()
                .map(|bytes| bytes.to_vec())
                .map_err(|error| CheckpointError::Decode(error.to_string()))
        };
        Ok(LearnerState {
            modules: [
                module_bytes(&self.actor)?,
                module_bytes(&self.critics)?,
                module_bytes(&self.target)?,
                module_bytes(&self.temperature)?,
            ],
            optimizers: [
                optimizer(&self.actor_optimizer)?,
                optimizer(&self.critic_optimizer)?,
                optimizer(&self.temperature_optimizer)?,
            ],
            updates: self.updates,
            rng: RngState::of(&self.rng),
        })
    }

    /// Restores a learner from saved state.
    ///
    /// # Errors
    /// If the state does not fit the configured networks.
    pub fn restore(device: Device, config: SacConfig, state: LearnerState) -> Result<Self, CheckpointError> {
        let mut learner = Self::on(device, config, state.rng.generator());
        let [actor, critic, target, temperature] = state.modules;
        learner.actor = load_module(learner.actor, &actor)?;
        learner.critics = load_module(learner.critics, &critic)?;
        learner.target = load_module(learner.target, &target)?;
        learner.temperature = load_module(learner.temperature, &temperature)?;
        let load = |optimizer: ModuleOptimizer, bytes: Vec<u8>| {
            optimizer
                .from_bytes(Bytes::from_bytes_vec(bytes))
                .map_err(|error| CheckpointError::Decode(error.to_string()))
        };
        let [actor, critic, temperature] = state.optimizers;
        learner.actor_optimizer = load(learner.actor_optimizer, actor)?;
        learner.critic_optimizer = load(learner.critic_optimizer, critic)?;
        learner.temperature_optimizer = load(learner.temperature_optimizer, temperature)?;
        learner.updates = state.updates;
        learner.rng = state.rng.generator();
        Ok(learner)
    }
}

fn scalar<const D: usize>(tensor: Tensor<D>) -> f32 {
    tensor.into_data().as_slice::<f32>().expect("f32 tensors")[0]
}
