//! The actor network on the CPU: loops over flat arrays, which allocate nothing once their buffers are made.
//!
//! An observation's rays pass through one layer. Its output, the rest of the observation and, in recurrent actors, the
//! output of an LSTM over both pass through two hidden layers to the means and the logarithms of the standard
//! deviations of the action's values.

use crate::activation::{exp, lstm_step, tanh};
use crate::actor::{Actor, Batch, Scratch};
use crate::config::{ActorConfig, GATES, LOG_STD_RANGE, RAY_LEN};
use crate::matrix::{Aligned, Layer};
use crate::weights::Weights;
use pulp::Arch;
use surefoot_world::character::{ACTION_LEN, Action};
use surefoot_world::sense::RAY_COUNT;

/// Most rows of a block: eight tiles of [`Layer::forward`]. Larger blocks are not faster.
const BLOCK: usize = 48;

/// The network of a policy, laid out for this processor.
#[derive(Debug)]
pub struct CpuActor {
    arch: Arch,
    config: ActorConfig,
    proximities: Layer,
    /// Weights of the ray values besides proximities, which are mostly zeros: `[RAY_LEN - RAY_COUNT, outputs of
    /// proximities]`.
    hazards: Aligned,
    gates: Option<Layer>,
    first: Layer,
    second: Layer,
    head: Layer,
}

impl CpuActor {
    /// Lays out the weights of an actor of these sizes.
    pub fn new(config: ActorConfig, mut weights: Weights) -> Self {
        let rays = weights.take("trunk.rays.weight");
        let (proximities, hazards) = rays.split_at(RAY_COUNT * config.ray_features);
        let proximities = Layer::new(proximities, &weights.take("trunk.rays.bias"));
        let gates = config.memory.map(|_| {
            // Both of its factors are inputs of one layer.
            let mut rows = weights.take("trunk.memory.input.weight");
            rows.extend(weights.take("trunk.memory.recurrent"));
            Layer::new(&rows, &weights.take("trunk.memory.input.bias"))
        });
        let mut layer = |name: &str| {
            let rows = weights.take(&format!("{name}.weight"));
            Layer::new(&rows, &weights.take(&format!("{name}.bias")))
        };
        Self {
            arch: Arch::new(),
            config,
            hazards: Aligned::of_rows(hazards, config.ray_features, proximities.stride()),
            proximities,
            gates,
            first: layer("trunk.first"),
            second: layer("trunk.second"),
            head: layer("head"),
        }
    }

    /// Computes the actions of as many rows as `scratch` has room for.
    fn act_block(&self, batch: Batch<'_>, scratch: &mut Scratch, actions: &mut [Action]) {
        let Batch { observations, memory, noise } = batch;
        let rows = actions.len();
        self.sense(observations, rows, scratch);
        self.remember(memory, rows, scratch);
        let Scratch { sensed, first, second, head, .. } = scratch;
        let [first_len, second_len, head_len] = [&self.first, &self.second, &self.head].map(Layer::stride);
        let (first, second) =
            (&mut first.values_mut()[..rows * first_len], &mut second.values_mut()[..rows * second_len]);
        let head = &mut head.values_mut()[..rows * head_len];
        self.first.forward(sensed.values(), self.first.inputs, 0.0, first);
        self.second.forward(first, first_len, 0.0, second);
        self.head.forward(second, second_len, f32::NEG_INFINITY, head);
        for (row, (action, output)) in actions.iter_mut().zip(head.chunks_exact(head_len)).enumerate() {
            *action = sample(&output[..2 * ACTION_LEN], noise.get(row * ACTION_LEN..(row + 1) * ACTION_LEN));
        }
    }

    /// Encodes the rays, and copies the rest of the observation beside them.
    fn sense(&self, observations: &[f32], rows: usize, scratch: &mut Scratch) {
        let Scratch { rays, sensed, .. } = scratch;
        let (stride, observation_len) = (self.proximities.stride(), self.config.observation_len());
        let codes = &mut rays.values_mut()[..rows * stride];
        self.proximities.forward(observations, observation_len, f32::NEG_INFINITY, codes);
        let inputs = sensed.values_mut().chunks_exact_mut(self.first.inputs);
        for ((row, code), input) in
            observations.chunks_exact(observation_len).zip(codes.chunks_exact_mut(stride)).zip(inputs)
        {
            let hazards = row[RAY_COUNT..RAY_LEN].iter().zip(self.hazards.values().chunks_exact(stride));
            for (value, weights) in hazards.filter(|(value, _)| **value != 0.0) {
                code.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * weight);
            }
            let (features, rest) = input.split_at_mut(self.config.ray_features);
            features.iter_mut().zip(&*code).for_each(|(feature, sum)| *feature = sum.max(0.0));
            rest[..row.len() - RAY_LEN].copy_from_slice(&row[RAY_LEN..]);
        }
    }

    /// Runs a step of the LSTM, if there is one: overwrites `memory`, and copies the hidden state beside the encoded
    /// observation.
    fn remember(&self, memory: &mut [f32], rows: usize, scratch: &mut Scratch) {
        let Some(layer) = &self.gates else { return };
        let Scratch { sensed, gates, .. } = scratch;
        let (size, inputs) = (self.config.memory_len(), self.first.inputs);
        let hidden_at = inputs - size;
        for (input, memory) in sensed.values_mut().chunks_exact_mut(inputs).zip(memory.chunks_exact(2 * size)) {
            input[hidden_at..].copy_from_slice(&memory[..size]);
        }
        let gates = &mut gates.values_mut()[..rows * layer.stride()];
        layer.forward(sensed.values(), inputs, f32::NEG_INFINITY, gates);
        let steps = memory
            .chunks_exact_mut(2 * size)
            .zip(gates.chunks_exact_mut(layer.stride()))
            .zip(sensed.values_mut().chunks_exact_mut(inputs));
        for ((memory, gates), input) in steps {
            let (hidden, cell) = memory.split_at_mut(size);
            let gates = &mut gates[..GATES * size];
            self.arch.dispatch(|| lstm_step(gates, cell, hidden));
            input[hidden_at..].copy_from_slice(hidden);
        }
    }
}

impl Actor for CpuActor {
    fn fit(&self, scratch: &mut Scratch, row_count: usize) {
        let block = row_count.min(BLOCK);
        if scratch.sizes == Some(self.config) && scratch.block >= block {
            return;
        }
        let rows = |stride: usize| Aligned::zeros(block * stride);
        *scratch = Scratch {
            sizes: Some(self.config),
            block,
            rays: rows(self.proximities.stride()),
            sensed: rows(self.first.inputs),
            gates: rows(self.gates.as_ref().map_or(0, Layer::stride)),
            first: rows(self.first.stride()),
            second: rows(self.second.stride()),
            head: rows(self.head.stride()),
        };
    }

    fn act(&self, batch: Batch<'_>, scratch: &mut Scratch, actions: &mut [Action]) {
        self.fit(scratch, actions.len());
        let block = scratch.block;
        let Batch { observations, memory, noise } = batch;
        let (observation_len, memory_len) = (self.config.observation_len(), self.config.hidden_len());
        let mut memory = memory;
        for (idx, actions) in actions.chunks_mut(block.max(1)).enumerate() {
            let (rows, begin) = (actions.len(), idx * block);
            let (own, rest) = memory.split_at_mut(rows * memory_len);
            memory = rest;
            let noise = noise.get(begin * ACTION_LEN..(begin + rows) * ACTION_LEN).unwrap_or_default();
            let observations = &observations[begin * observation_len..(begin + rows) * observation_len];
            self.act_block(Batch { observations, memory: own, noise }, scratch, actions);
        }
    }
}

/// Draws the action from the head's output: four means, and four logarithms of standard deviations.
fn sample(output: &[f32], noise: Option<&[f32]>) -> Action {
    let (mean, log_std) = output.split_at(ACTION_LEN);
    let mut raw = [0.0; ACTION_LEN];
    raw.copy_from_slice(mean);
    if let Some(noise) = noise {
        for ((raw, log_std), noise) in raw.iter_mut().zip(log_std).zip(noise) {
            *raw += exp(log_std.clamp(LOG_STD_RANGE.0, LOG_STD_RANGE.1)) * noise;
        }
    }
    Action::from_array(raw.map(tanh)).unwrap_or_default()
}
