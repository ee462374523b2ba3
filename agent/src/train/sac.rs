//! Soft actor-critic with a learned temperature and no state-value network.
//!
//! Equation numbers are those of Haarnoja et al. 2018, "Soft Actor-Critic Algorithms and Applications"
//! (arXiv 1812.05905). Actor and critics have separate encoders, as the GameRLand3D paper found more stable.

use super::adam::adam;
use super::critic::{CRITIC_COUNT, Critics};
use super::replay::Batch;
use burn::module::{Module, Param};
use burn::optim::{GradientsParams, ModuleOptimizer};
use burn::tensor::activation::softplus;
use burn::tensor::{Bytes, Device, Int, Tensor, TensorData};
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::path::Path;
use surefoot_policy::actor::{ActionDistribution, gaussian};
use surefoot_policy::checkpoint::{WEIGHTS_FILE, load_module, module_bytes};
use surefoot_policy::lstm::Recall;
use surefoot_policy::network::{Encoding, Past};
use surefoot_policy::{Actor, ActorConfig, CheckpointError, Manifest};
use surefoot_world::OBSERVATION_LEN;
use surefoot_world::character::ACTION_LEN;

/// Constants of the learner.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SacConfig {
    /// Layer sizes of actor and critics.
    pub network: ActorConfig,
    /// Adam's step size for all networks and the temperature.
    pub learning_rate: f64,
    /// Share by which the target critics follow the critics at each update.
    pub tau: f32,
    /// Entropy that the temperature holds the policy at, in nats.
    pub target_entropy: f32,
    /// Temperature at the start; see docs/adr/0009-low-initial-temperature.md.
    pub initial_alpha: f32,
    /// Smallest temperature.
    pub min_alpha: f32,
    /// Critic updates per actor update.
    pub actor_interval: u64,
    /// Updates over which the step size falls linearly to a tenth; 0 for a constant one.
    #[serde(default)]
    pub decay_updates: u64,
}

impl Default for SacConfig {
    fn default() -> Self {
        Self {
            network: ActorConfig::default(),
            learning_rate: 3.0e-4,
            tau: 0.005,
            target_entropy: -2.0,
            initial_alpha: 0.004,
            min_alpha: 1.0e-4,
            actor_interval: 2,
            decay_updates: 120_000,
        }
    }
}

/// The logarithm of the temperature, as a module so that Adam can hold its moments.
#[derive(Module, Debug)]
struct Temperature {
    log_alpha: Param<Tensor<1>>,
}

/// All learner state.
pub struct Learner {
    config: SacConfig,
    actor: Actor,
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

/// Means over one update, for the log.
#[derive(Debug, Clone, Copy, Default)]
pub struct UpdateStats {
    /// Sum of both critics' squared Bellman errors.
    pub critic_loss: f32,
    /// Mean action value.
    pub q_mean: f32,
    /// Mean of alpha log pi - Q; NaN when the actor was not updated.
    pub actor_loss: f32,
    /// Mean negative log probability of the policy's actions.
    pub entropy: f32,
    /// Temperature.
    pub alpha: f32,
}

/// A learner's state as bytes.
#[derive(Debug, Serialize, Deserialize)]
pub struct LearnerState {
    modules: [Vec<u8>; 4],
    optimizers: [Vec<u8>; 3],
    updates: u64,
    rng: super::run::RngState,
}

impl Learner {
    /// Fresh networks drawn from `rng`, on the CPU.
    pub fn new(config: SacConfig, rng: ChaCha8Rng) -> Self {
        Self::on(Device::flex(), config, rng)
    }

    /// Fresh networks drawn from `rng`, on some device.
    pub fn on(device: Device, config: SacConfig, mut rng: ChaCha8Rng) -> Self {
        let device = device.autodiff();
        let actor = Actor::new(&config.network, &device, &mut rng);
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

    /// Takes over the networks of a trained model; a reactive one gives a recurrent one everything but its memory.
    ///
    /// # Errors
    /// If the model cannot be read or does not fit.
    pub fn start_from(&mut self, folder: &Path) -> Result<(), CheckpointError> {
        let manifest = Manifest::load(folder)?;
        let read = |file: &str| {
            let path = folder.join(file);
            std::fs::read(&path).map_err(|source| CheckpointError::Io { path, source })
        };
        let (weights, critics) = (read(WEIGHTS_FILE)?, read(super::run::CRITICS_FILE)?);
        manifest.check(&weights)?;
        let mut actor = load_module(Actor::new(&manifest.actor, &self.device, &mut self.rng), &weights)?;
        let mut critic = load_module(Critics::new(&manifest.actor, &self.device, &mut self.rng), &critics)?;
        if manifest.actor.memory == 0 && self.config.network.memory > 0 {
            actor = actor.with_memory(self.config.network.memory, &self.device, &mut self.rng);
            critic = critic.with_memory(self.config.network.memory, &self.device, &mut self.rng);
        }
        // Loading checks that the shapes are those of the configuration.
        self.actor = load_module(self.actor.clone(), &module_bytes(&actor)?)?;
        self.critics = load_module(self.critics.clone(), &module_bytes(&critic)?)?;
        self.target = self.critics.valid();
        Ok(())
    }

    /// The policy network as it stands.
    pub fn actor(&self) -> &Actor {
        &self.actor
    }

    /// The critics as they stand.
    pub fn critics(&self) -> &Critics {
        &self.critics
    }

    /// Updates made so far.
    pub fn updates(&self) -> u64 {
        self.updates
    }

    /// The generator that batches are drawn with.
    pub fn rng(&mut self) -> &mut ChaCha8Rng {
        &mut self.rng
    }

    /// One update of the critics and, at every `actor_interval`-th, of actor and temperature.
    pub fn update(&mut self, batch: &Batch) -> UpdateStats {
        let rows = Rows::new(batch, &self.device.clone().inner());
        let alpha = self.alpha();
        let targets = self.targets(&rows, alpha);

        // Critic loss, eq. (5), summed over both critics.
        let recall = self.warm_critics(&rows);
        let past = recall.as_ref().map(|recall| rows.past(recall));
        let (encoding, _) = self.critics.encode(rows.learned.clone().autodiff(), past);
        let values = self.critics.value(encoding.clone(), rows.actions.clone().autodiff());
        let errors = (values.clone() - targets.unsqueeze::<3>().autodiff()).square();
        let critic_loss = (errors * rows.weights.clone().unsqueeze::<3>().autodiff()).sum();
        let mut stats = UpdateStats {
            critic_loss: scalar(critic_loss.clone()),
            q_mean: scalar(values.mean()),
            actor_loss: f32::NAN,
            entropy: f32::NAN,
            alpha,
        };
        let critic_gradients = GradientsParams::from_grads(critic_loss.backward(), &self.critics);
        if self.updates.is_multiple_of(self.config.actor_interval) {
            // What the critics made of the observations serves the actor's loss too.
            self.update_actor(&rows, encoding.detach(), alpha, &mut stats);
        }
        self.critics = self.critic_optimizer.step(self.learning_rate(), self.critics.clone(), critic_gradients);
        self.target = self.target.clone().follow(&self.critics.valid(), self.config.tau);
        self.updates += 1;
        stats
    }

    /// What the critics should have said, eq. (3) and (6): the rewards up to the successor, and its value there,
    /// min Q(s', a') - alpha log pi(a'|s').
    fn targets(&mut self, rows: &Rows<'_>, alpha: f32) -> Tensor<2> {
        let noise = self.noise(rows.learned_count(), &rows.device);
        let actor = self.actor.valid();
        let (seen, encoding) = if actor.memory_size().is_some() {
            // Memories need every step; only then can the successors be picked.
            let all = rows.all();
            let recall = rows.actor_memory();
            let critic_recall = rows.empty_memory(CRITIC_COUNT);
            let (seen, _) = actor.encode(all.clone(), Some(rows.whole_past(&recall)));
            let (encoding, _) = self.target.encode(all, Some(rows.whole_past(&critic_recall)));
            (seen.select(&rows.successors), encoding.select(&rows.successors))
        } else {
            let successors = rows.all().select(0, rows.successors.clone());
            (actor.encode(successors.clone(), None).0, self.target.encode(successors, None).0)
        };
        let distribution = actor.decide(seen);
        let (actions, log_prob) = sample_squashed(distribution, noise);
        let value = self.target.smaller_value(encoding, actions) - log_prob * alpha;
        rows.returns.clone() + rows.bootstrap.clone() * value
    }

    /// The critics' memory after burning in, from nothing.
    fn warm_critics(&self, rows: &Rows<'_>) -> Option<Recall> {
        self.actor.memory_size()?;
        let empty = rows.empty_memory(CRITIC_COUNT);
        let Some(observations) = rows.burn_in() else { return Some(empty) };
        self.critics.valid().encode(observations, Some(rows.burn_in_past(&empty))).1
    }

    /// The actor's memory after burning in, from what was stored.
    fn warm_actor(&self, rows: &Rows<'_>) -> Option<Recall> {
        self.actor.memory_size()?;
        let stored = rows.actor_memory();
        let Some(observations) = rows.burn_in() else { return Some(stored) };
        self.actor.valid().encode(observations, Some(rows.burn_in_past(&stored))).1
    }

    fn update_actor(&mut self, rows: &Rows<'_>, encoding: Encoding, alpha: f32, stats: &mut UpdateStats) {
        let noise = self.noise(rows.learned_count(), &rows.device).autodiff();
        let weights = rows.weights.clone().autodiff();
        // Actor loss, eq. (9): alpha log pi - Q, through the critics but without gradients for their weights.
        let recall = self.warm_actor(rows);
        let past = recall.as_ref().map(|recall| rows.past(recall));
        let (distribution, _) = self.actor.forward(rows.learned.clone().autodiff(), past);
        let (actions, log_prob) = sample_squashed(distribution, noise);
        let value = self.critics.clone().no_grad().smaller_value(encoding, actions);
        let actor_loss = ((log_prob.clone() * alpha - value) * weights.clone()).sum();
        stats.actor_loss = scalar(actor_loss.clone());
        let mean_log_prob = scalar((log_prob * weights).sum());
        stats.entropy = -mean_log_prob;
        let gradients = GradientsParams::from_grads(actor_loss.backward(), &self.actor);
        self.actor = self.actor_optimizer.step(self.learning_rate(), self.actor.clone(), gradients);
        // Temperature loss, eq. (18): -alpha (log pi + target entropy), in its usual form on log alpha.
        let gap = mean_log_prob + self.config.target_entropy;
        let loss = self.temperature.log_alpha.val() * -gap;
        let gradients = GradientsParams::from_grads(loss.sum().backward(), &self.temperature);
        self.temperature = self.temperature_optimizer.step(self.learning_rate(), self.temperature.clone(), gradients);
    }

    fn learning_rate(&self) -> f64 {
        let done = match self.config.decay_updates {
            0 => 0.0,
            updates => (self.updates as f64 / updates as f64).min(1.0),
        };
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

    /// All state as bytes.
    ///
    /// # Errors
    /// If a module cannot be encoded.
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
            rng: super::run::RngState::of(&self.rng),
        })
    }

    /// Continues from saved state.
    ///
    /// # Errors
    /// If it does not fit the configured networks.
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

/// Draws squashed actions by the reparameterisation trick: actions `[batch, ACTION_LEN]` and their log
/// probabilities `[batch, 1]`, eq. (21) in the numerically stable form of the tanh correction.
pub fn sample_squashed(distribution: ActionDistribution, noise: Tensor<2>) -> (Tensor<2>, Tensor<2>) {
    const HALF_LOG_TWO_PI: f32 = 0.918_938_5;
    const LOG_TWO: f32 = std::f32::consts::LN_2;
    let ActionDistribution { mean, log_std } = distribution;
    let raw = mean + log_std.clone().exp() * noise.clone();
    let gaussian = noise.square() * -0.5 - log_std - HALF_LOG_TWO_PI;
    // log(1 - tanh(u)^2) = 2 (log 2 - u - softplus(-2u))
    let correction = (-(raw.clone()) + LOG_TWO - softplus(raw.clone() * -2.0, 1.0)) * 2.0;
    (raw.tanh(), (gaussian - correction).sum_dim(1))
}

fn scalar<const D: usize>(tensor: Tensor<D>) -> f32 {
    tensor.into_data().as_slice::<f32>().expect("f32 tensors")[0]
}

/// A batch as tensors.
struct Rows<'a> {
    batch: &'a Batch,
    /// The device that tensors without gradients live on.
    device: Device,
    /// Observations to learn from, `[learned, OBSERVATION_LEN]`.
    learned: Tensor<2>,
    /// `[learned, ACTION_LEN]`.
    actions: Tensor<2>,
    /// `[learned, 1]`.
    returns: Tensor<2>,
    /// `[learned, 1]`.
    bootstrap: Tensor<2>,
    /// Share of each row in the losses' means, `[learned, 1]`.
    weights: Tensor<2>,
    /// Row of each successor among all rows, `[learned]`.
    successors: Tensor<1, Int>,
}

impl<'a> Rows<'a> {
    fn new(batch: &'a Batch, device: &Device) -> Self {
        let count = batch.returns.len();
        let column = |values: Vec<f32>| Tensor::from_data(TensorData::new(values, [count, 1]), device);
        let total: f32 = batch.weights.iter().sum();
        let skip = batch.burn_in * batch.size * OBSERVATION_LEN;
        let learned = batch.observations[skip..skip + count * OBSERVATION_LEN].to_vec();
        let successors = batch.successors.iter().map(|&row| row as i64).collect::<Vec<_>>();
        Self {
            batch,
            device: device.clone(),
            learned: Tensor::from_data(TensorData::new(learned, [count, OBSERVATION_LEN]), device),
            actions: Tensor::from_data(TensorData::new(batch.actions.clone(), [count, ACTION_LEN]), device),
            returns: column(batch.returns.clone()),
            bootstrap: column(batch.bootstrap.clone()),
            weights: column(batch.weights.iter().map(|weight| weight / total.max(1.0)).collect()),
            successors: Tensor::from_data(TensorData::new(successors, [count]), device),
        }
    }

    fn learned_count(&self) -> usize {
        self.batch.returns.len()
    }

    /// Observations of every step.
    fn all(&self) -> Tensor<2> {
        let rows = self.batch.keep.len();
        Tensor::from_data(TensorData::new(self.batch.observations.clone(), [rows, OBSERVATION_LEN]), &self.device)
    }

    /// Observations that only warm up memories.
    fn burn_in(&self) -> Option<Tensor<2>> {
        let rows = self.batch.burn_in * self.batch.size;
        let values = self.batch.observations[..rows * OBSERVATION_LEN].to_vec();
        (rows > 0).then(|| Tensor::from_data(TensorData::new(values, [rows, OBSERVATION_LEN]), &self.device))
    }

    /// Length of a hidden state.
    fn memory_size(&self) -> usize {
        self.batch.memory.len() / self.batch.size / 2
    }

    /// What the actor remembered before the first step.
    fn actor_memory(&self) -> Recall {
        Recall::from_rows(&self.batch.memory, self.memory_size(), &self.device)
    }

    /// Nothing remembered by some members of the actor's size.
    fn empty_memory(&self, members: usize) -> Recall {
        Recall::empty([members, self.batch.size, self.memory_size()], &self.device)
    }

    fn whole_past<'r>(&'r self, recall: &'r Recall) -> Past<'r> {
        Past { recall, keep: &self.batch.keep }
    }

    fn burn_in_past<'r>(&'r self, recall: &'r Recall) -> Past<'r> {
        Past { recall, keep: &self.batch.keep[..self.batch.burn_in * self.batch.size] }
    }

    /// For the steps to learn from.
    fn past<'r>(&'r self, recall: &'r Recall) -> Past<'r> {
        Past { recall, keep: &self.batch.keep[self.batch.burn_in * self.batch.size..][..self.learned_count()] }
    }
}
