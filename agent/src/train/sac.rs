//! Soft actor-critic with a learned temperature and no state-value network.
//!
//! Equation numbers are those of Haarnoja et al. 2018, "Soft Actor-Critic Algorithms and Applications"
//! (arXiv 1812.05905). Actor and critics have separate encoders, as the GameRLand3D paper found more stable.

use super::replay::Batch;
use burn::module::{Module, Param};
use burn::nn::Linear;
use burn::optim::{AdamConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::activation::softplus;
use burn::tensor::{Bytes, Device, Tensor, TensorData};
use rand::Rng;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use surefoot_policy::actor::{ActionDistribution, Trunk, gaussian, linear};
use surefoot_policy::checkpoint::{load_module, module_bytes};
use surefoot_policy::{Actor, ActorConfig, CheckpointError};
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
    /// Temperature at the start.
    pub initial_alpha: f32,
    /// Smallest temperature.
    pub min_alpha: f32,
    /// Critic updates per actor update.
    pub actor_interval: u64,
}

impl Default for SacConfig {
    fn default() -> Self {
        Self {
            network: ActorConfig::default(),
            learning_rate: 3.0e-4,
            tau: 0.005,
            target_entropy: -2.0,
            initial_alpha: 0.05,
            min_alpha: 1.0e-4,
            actor_interval: 2,
        }
    }
}

/// An action-value network: observation and action to one number.
#[derive(Module, Debug)]
pub struct Critic {
    trunk: Trunk,
    head: Linear,
}

impl Critic {
    fn new(config: &ActorConfig, device: &Device, rng: &mut impl Rng) -> Self {
        Self { trunk: Trunk::new(config, ACTION_LEN, device, rng), head: linear(config.hidden, 1, device, rng) }
    }

    /// `[batch, OBSERVATION_LEN]`, `[batch, ACTION_LEN]` to `[batch, 1]`.
    fn forward(&self, observations: Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
        self.head.forward(self.trunk.forward(observations, Some(actions)))
    }
}

/// Two critics; the smaller estimate is believed.
#[derive(Module, Debug)]
pub struct TwinCritic {
    first: Critic,
    second: Critic,
}

impl TwinCritic {
    fn min(&self, observations: Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
        let first = self.first.forward(observations.clone(), actions.clone());
        first.min_pair(self.second.forward(observations, actions))
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
    critic: TwinCritic,
    target: TwinCritic,
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
    /// Fresh networks drawn from `rng`.
    pub fn new(config: SacConfig, mut rng: ChaCha8Rng) -> Self {
        let device = Device::flex().autodiff();
        let actor = Actor::new(&config.network, &device, &mut rng);
        let critic = TwinCritic {
            first: Critic::new(&config.network, &device, &mut rng),
            second: Critic::new(&config.network, &device, &mut rng),
        };
        let adam = || AdamConfig::new().with_epsilon(1.0e-8).init();
        let log_alpha = TensorData::new(vec![config.initial_alpha.ln()], [1]);
        Self {
            actor,
            target: critic.valid(),
            critic,
            temperature: Temperature { log_alpha: Param::from_data(log_alpha, &device) },
            actor_optimizer: adam(),
            critic_optimizer: adam(),
            temperature_optimizer: adam(),
            updates: 0,
            rng,
            device,
            config,
        }
    }

    /// The policy network being trained.
    pub fn actor(&self) -> &Actor {
        &self.actor
    }

    /// Updates made.
    pub fn updates(&self) -> u64 {
        self.updates
    }

    /// The generator behind the learner's noise and its batches.
    pub fn rng(&mut self) -> &mut ChaCha8Rng {
        &mut self.rng
    }

    /// One update of critics, and every few also of actor and temperature.
    pub fn update(&mut self, batch: &Batch) -> UpdateStats {
        let inner = self.device.clone().inner();
        let size = batch.returns.len();
        let rows = |values: &[f32], width: usize| {
            Tensor::<2>::from_data(TensorData::new(values.to_vec(), [size, width]), &inner)
        };
        let observations = rows(&batch.observations, OBSERVATION_LEN);
        let actions = rows(&batch.actions, ACTION_LEN);
        let returns = rows(&batch.returns, 1);
        let bootstrap = rows(&batch.bootstrap, 1);
        let next_observations = rows(&batch.next_observations, OBSERVATION_LEN);
        let alpha = self.alpha();

        // Targets: r + gamma (min Q'(s', a') - alpha log pi(a'|s')), eq. (7) with the soft value of eq. (3).
        let noise = self.noise(size, &inner);
        let (next_actions, next_log_prob) =
            sample_squashed(self.actor.valid().forward(next_observations.clone()), noise);
        let next_value = self.target.min(next_observations, next_actions) - next_log_prob * alpha;
        let targets = returns + bootstrap * next_value;

        // Critic loss, eq. (5), summed over both critics.
        let (tracked_observations, tracked_actions) = (observations.clone().autodiff(), actions.autodiff());
        let targets = targets.autodiff();
        let q_first = self.critic.first.forward(tracked_observations.clone(), tracked_actions.clone());
        let q_second = self.critic.second.forward(tracked_observations, tracked_actions);
        let squared = |q: &Tensor<2>| (q.clone() - targets.clone()).square().mean();
        let critic_loss = squared(&q_first) + squared(&q_second);
        let mut stats = UpdateStats {
            critic_loss: scalar(critic_loss.clone()),
            q_mean: scalar(q_first.mean()),
            actor_loss: f32::NAN,
            entropy: f32::NAN,
            alpha,
        };
        let gradients = GradientsParams::from_grads(critic_loss.backward(), &self.critic);
        self.critic = self.critic_optimizer.step(self.config.learning_rate, self.critic.clone(), gradients);

        if self.updates.is_multiple_of(self.config.actor_interval) {
            self.update_actor(observations, alpha, &mut stats);
        }
        self.target = follow(self.target.clone(), &self.critic.valid(), self.config.tau);
        self.updates += 1;
        stats
    }

    fn update_actor(&mut self, observations: Tensor<2>, alpha: f32, stats: &mut UpdateStats) {
        let [size, _] = observations.dims();
        let noise = self.noise(size, &self.device.clone().inner()).autodiff();
        let observations = observations.autodiff();
        // Actor loss, eq. (9): alpha log pi - Q, through the critics but without gradients for their weights.
        let (actions, log_prob) = sample_squashed(self.actor.forward(observations.clone()), noise);
        let q = self.critic.clone().no_grad().min(observations, actions);
        let actor_loss = (log_prob.clone() * alpha - q).mean();
        stats.actor_loss = scalar(actor_loss.clone());
        let mean_log_prob = scalar(log_prob.mean());
        stats.entropy = -mean_log_prob;
        let gradients = GradientsParams::from_grads(actor_loss.backward(), &self.actor);
        self.actor = self.actor_optimizer.step(self.config.learning_rate, self.actor.clone(), gradients);
        // Temperature loss, eq. (18): -alpha (log pi + target entropy), in its usual form on log alpha.
        let gap = mean_log_prob + self.config.target_entropy;
        let loss = self.temperature.log_alpha.val() * -gap;
        let gradients = GradientsParams::from_grads(loss.sum().backward(), &self.temperature);
        self.temperature =
            self.temperature_optimizer.step(self.config.learning_rate, self.temperature.clone(), gradients);
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
                module_bytes(&self.critic)?,
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
    pub fn restore(config: SacConfig, state: LearnerState) -> Result<Self, CheckpointError> {
        let mut learner = Self::new(config, state.rng.generator());
        let [actor, critic, target, temperature] = state.modules;
        learner.actor = load_module(learner.actor, &actor)?;
        learner.critic = load_module(learner.critic, &critic)?;
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

/// Moves every parameter of `target` by `tau` towards the same parameter of `source`.
fn follow(target: TwinCritic, source: &TwinCritic, tau: f32) -> TwinCritic {
    let critic = |target: Critic, source: &Critic| Critic {
        trunk: target.trunk.follow(&source.trunk, tau),
        head: surefoot_policy::actor::follow(target.head, &source.head, tau),
    };
    TwinCritic { first: critic(target.first, &source.first), second: critic(target.second, &source.second) }
}
