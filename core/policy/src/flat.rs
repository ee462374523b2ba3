//! An actor in flat arrays: decisions without tensors, which allocate nothing once their buffers are made.
//!
//! [`Policy`] goes through burn, whose tensors are allocated anew for every layer. Games decide within a frame, where an allocation is a
//! hazard and a batch is small; this is the same network as loops over vectors. Tests compare the two.
//!
//! A layer's weights are stored in panels of two vectors' width, so that a product reads them once and in order. Several rows share each
//! vector of weights that is loaded.

use crate::actor::LOG_STD_RANGE;
use crate::config::{GATES, RAY_LEN};
use crate::cpu::lstm::{activate, exp, tanh};
use crate::exchange::{Weights, named_weights};
use crate::policy::Policy;
use pulp::{Arch, Simd, WithSimd};
use std::collections::BTreeMap;
use surefoot_world::character::{ACTION_LEN, Action};
use surefoot_world::sense::RAY_COUNT;

/// Rows that share the weights that are loaded: their sums and two vectors of weights fit into the registers.
const TILE: usize = 6;
/// Alignment of arrays, in values: that of the widest vectors.
const ALIGNMENT: usize = 16;

/// An actor's weights, laid out for this processor.
#[derive(Debug)]
pub struct FlatActor {
    arch: Arch,
    observation_len: usize,
    memory_size: usize,
    ray_features: usize,
    proximities: Layer,
    /// Weights of the ray values besides proximities, which are mostly zeros: `[RAY_LEN - RAY_COUNT, outputs of proximities]`.
    hazards: Aligned,
    gates: Option<Layer>,
    first: Layer,
    second: Layer,
    head: Layer,
}

/// Buffers of decisions for a number of rows.
#[derive(Debug)]
pub struct FlatScratch {
    max_rows: usize,
    /// Encoded rays.
    rays: Aligned,
    /// Encoded rays, the rest of the observation, and the hidden state.
    sensed: Aligned,
    gates: Aligned,
    first: Aligned,
    second: Aligned,
    head: Aligned,
}

impl FlatActor {
    /// Lays out the weights of a policy.
    pub fn new(policy: &Policy) -> Self {
        let arch = Arch::new();
        let width = 2 * arch.dispatch(Lanes);
        let config = policy.manifest().actor;
        let mut weights = named_weights(policy.actor());
        let rays = take(&mut weights, "trunk.rays.weight");
        let (proximities, hazards) = rays.split_at(RAY_COUNT * config.ray_features);
        let ray_bias = take(&mut weights, "trunk.rays.bias");
        let proximities = Layer::new(proximities, &ray_bias, width);
        let gates = (config.memory_len() > 0).then(|| {
            // Both of its factors are inputs of one layer.
            let mut rows = take(&mut weights, "trunk.memory.input.weight");
            rows.extend(take(&mut weights, "trunk.memory.recurrent"));
            Layer::new(&rows, &take(&mut weights, "trunk.memory.input.bias"), width)
        });
        let mut layer = |name: &str| {
            let rows = take(&mut weights, &format!("{name}.weight"));
            Layer::new(&rows, &take(&mut weights, &format!("{name}.bias")), width)
        };
        Self {
            arch,
            observation_len: config.observation_len(),
            memory_size: config.memory_len(),
            ray_features: config.ray_features,
            hazards: Aligned::of_rows(hazards, config.ray_features, proximities.stride()),
            proximities,
            gates,
            first: layer("trunk.first"),
            second: layer("trunk.second"),
            head: layer("head"),
        }
    }

    /// Number of values of an observation.
    pub fn observation_len(&self) -> usize {
        self.observation_len
    }

    /// Number of values in a memory row; 0 for a reactive policy.
    pub fn memory_len(&self) -> usize {
        2 * self.memory_size
    }

    /// Allocates the buffers for decisions of up to `max_rows` rows.
    pub fn scratch(&self, max_rows: usize) -> FlatScratch {
        let rows = |stride: usize| Aligned::zeros(max_rows * stride);
        FlatScratch {
            max_rows,
            rays: rows(self.proximities.stride()),
            sensed: rows(self.first.inputs),
            gates: rows(self.gates.as_ref().map_or(0, Layer::stride)),
            first: rows(self.first.stride()),
            second: rows(self.second.stride()),
            head: rows(self.head.stride()),
        }
    }

    /// Computes an action for each observation as [`Policy::act_with_noise`] does, but for rounding: `noise` is empty or has a row of
    /// [`ACTION_LEN`] values for each. Allocates nothing.
    ///
    /// # Panics
    /// If the numbers of rows differ, or exceed those of `scratch`.
    pub fn act(
        &self,
        observations: &[f32],
        memory: &mut [f32],
        noise: &[f32],
        scratch: &mut FlatScratch,
        actions: &mut [Action],
    ) {
        let rows = actions.len();
        assert!(rows <= scratch.max_rows, "at most {} rows", scratch.max_rows);
        assert_eq!(observations.len(), rows * self.observation_len, "an observation for each action");
        assert_eq!(memory.len(), rows * self.memory_len(), "a row of memory for each observation");
        assert!(noise.is_empty() || noise.len() == rows * ACTION_LEN, "noise for each action");
        self.sense(observations, rows, scratch);
        self.remember(memory, rows, scratch);
        let FlatScratch { sensed, first, second, head, .. } = scratch;
        self.forward(&self.first, (sensed.values(), self.first.inputs), first, rows, 0.0);
        self.forward(&self.second, (first.values(), self.first.stride()), second, rows, 0.0);
        self.forward(&self.head, (second.values(), self.second.stride()), head, rows, f32::NEG_INFINITY);
        for (row, action) in actions.iter_mut().enumerate() {
            let output = &head.values()[row * self.head.stride()..][..2 * ACTION_LEN];
            *action = sample(output, noise.get(row * ACTION_LEN..(row + 1) * ACTION_LEN));
        }
    }

    /// Encodes the rays, and puts what is behind them in the observation beside the code.
    fn sense(&self, observations: &[f32], rows: usize, scratch: &mut FlatScratch) {
        let FlatScratch { rays, sensed, .. } = scratch;
        let stride = self.proximities.stride();
        self.forward(&self.proximities, (observations, self.observation_len), rays, rows, f32::NEG_INFINITY);
        let codes = rays.values_mut().chunks_exact_mut(stride);
        let inputs = sensed.values_mut().chunks_exact_mut(self.first.inputs);
        for ((row, code), input) in observations.chunks_exact(self.observation_len).zip(codes).zip(inputs) {
            let hazards = row[RAY_COUNT..RAY_LEN].iter().zip(self.hazards.values().chunks_exact(stride));
            for (value, weights) in hazards.filter(|(value, _)| **value != 0.0) {
                code.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * weight);
            }
            let (features, rest) = input.split_at_mut(self.ray_features);
            features.iter_mut().zip(&*code).for_each(|(feature, sum)| *feature = sum.max(0.0));
            rest[..row.len() - RAY_LEN].copy_from_slice(&row[RAY_LEN..]);
        }
    }

    /// Runs a step of the LSTM, if there is one: overwrites `memory`, and puts the hidden state beside what is sensed.
    fn remember(&self, memory: &mut [f32], rows: usize, scratch: &mut FlatScratch) {
        let Some(layer) = &self.gates else { return };
        let FlatScratch { sensed, gates, .. } = scratch;
        let (size, inputs) = (self.memory_size, self.first.inputs);
        let hidden_at = inputs - size;
        for (input, memory) in sensed.values_mut().chunks_exact_mut(inputs).zip(memory.chunks_exact(2 * size)) {
            input[hidden_at..].copy_from_slice(&memory[..size]);
        }
        self.forward(layer, (sensed.values(), inputs), gates, rows, f32::NEG_INFINITY);
        let steps = memory
            .chunks_exact_mut(2 * size)
            .zip(gates.values_mut().chunks_exact_mut(layer.stride()))
            .zip(sensed.values_mut().chunks_exact_mut(inputs));
        for ((memory, gates), input) in steps {
            let (hidden, cell) = memory.split_at_mut(size);
            let gates = &mut gates[..GATES * size];
            self.arch.dispatch(|| activate(gates, cell, hidden));
            input[hidden_at..].copy_from_slice(hidden);
        }
    }

    /// Applies a layer to rows of `inputs`, which lie `stride` values apart, and cuts the results off at `floor`.
    fn forward(
        &self,
        layer: &Layer,
        (inputs, stride): (&[f32], usize),
        outputs: &mut Aligned,
        rows: usize,
        floor: f32,
    ) {
        self.arch.dispatch(Product { layer, inputs, stride, rows, floor, outputs: outputs.values_mut() });
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

fn take(weights: &mut BTreeMap<String, Weights>, name: &str) -> Vec<f32> {
    weights.remove(name).expect("a parameter of an actor").values
}

/// Values that begin on a line of the cache, so that no vector straddles two.
#[derive(Debug)]
struct Aligned {
    values: Vec<f32>,
    start: usize,
    len: usize,
}

impl Aligned {
    fn zeros(len: usize) -> Self {
        let values = vec![0.0; len + ALIGNMENT];
        let start = values.as_ptr().align_offset(ALIGNMENT * size_of::<f32>()).min(ALIGNMENT);
        Self { values, start, len }
    }

    /// Copies rows of `width` values to rows that lie `stride` values apart.
    fn of_rows(rows: &[f32], width: usize, stride: usize) -> Self {
        let mut copy = Self::zeros(rows.len() / width * stride);
        for (to, from) in copy.values_mut().chunks_exact_mut(stride).zip(rows.chunks_exact(width)) {
            to[..width].copy_from_slice(from);
        }
        copy
    }

    fn values(&self) -> &[f32] {
        &self.values[self.start..][..self.len]
    }

    fn values_mut(&mut self) -> &mut [f32] {
        &mut self.values[self.start..][..self.len]
    }
}

/// A fully connected layer.
#[derive(Debug)]
struct Layer {
    inputs: usize,
    /// Outputs of a panel.
    width: usize,
    /// `[panels, inputs, width]`; what is behind the last output is zero.
    panels: Aligned,
    /// `[panels, width]`.
    bias: Aligned,
}

impl Layer {
    /// Lays out weights `[inputs, outputs]`.
    fn new(weights: &[f32], bias: &[f32], width: usize) -> Self {
        let outputs = bias.len();
        let (inputs, panel_count) = (weights.len() / outputs, outputs.div_ceil(width));
        let mut panels = Aligned::zeros(panel_count * inputs * width);
        for (idx, panel) in panels.values_mut().chunks_exact_mut(inputs * width).enumerate() {
            let columns = idx * width..outputs.min((idx + 1) * width);
            for (to, from) in panel.chunks_exact_mut(width).zip(weights.chunks_exact(outputs)) {
                to[..columns.len()].copy_from_slice(&from[columns.clone()]);
            }
        }
        Self { inputs, width, panels, bias: Aligned::of_rows(bias, outputs, panel_count * width) }
    }

    /// Number of outputs, those behind the last included.
    fn stride(&self) -> usize {
        self.bias.len
    }
}

/// Tells how many values a vector holds.
struct Lanes;

impl WithSimd for Lanes {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        S::F32_LANES
    }
}

/// The product of rows with a layer's weights.
struct Product<'a> {
    layer: &'a Layer,
    inputs: &'a [f32],
    /// Distance between rows of inputs, in values.
    stride: usize,
    rows: usize,
    floor: f32,
    outputs: &'a mut [f32],
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let Layer { inputs, width, panels, bias, .. } = self.layer;
        let panels = panels.values().chunks_exact(inputs * width).zip(bias.values().chunks_exact(*width));
        for (panel, (weights, bias)) in panels.enumerate() {
            let (weights, _) = S::as_simd_f32s(weights).0.as_chunks::<2>();
            let bias = [S::as_simd_f32s(bias).0[0], S::as_simd_f32s(bias).0[1]];
            let mut row = 0;
            while row < self.rows {
                row += match self.rows - row {
                    TILE.. => self.tile::<S, TILE>(simd, weights, bias, row, panel),
                    4.. => self.tile::<S, 4>(simd, weights, bias, row, panel),
                    2.. => self.tile::<S, 2>(simd, weights, bias, row, panel),
                    _ => self.tile::<S, 1>(simd, weights, bias, row, panel),
                };
            }
        }
    }
}

impl Product<'_> {
    /// Computes the outputs of a panel for the rows from `row` on, and returns their number.
    #[inline(always)]
    fn tile<S: Simd, const ROWS: usize>(
        &mut self,
        simd: S,
        weights: &[[S::f32s; 2]],
        bias: [S::f32s; 2],
        row: usize,
        panel: usize,
    ) -> usize {
        let inputs: [&[f32]; ROWS] =
            std::array::from_fn(|idx| &self.inputs[(row + idx) * self.stride..][..weights.len()]);
        let mut sums = [bias; ROWS];
        for (idx, weights) in weights.iter().enumerate() {
            for (sums, inputs) in sums.iter_mut().zip(&inputs) {
                let input = simd.splat_f32s(inputs[idx]);
                sums[0] = simd.mul_add_e_f32s(weights[0], input, sums[0]);
                sums[1] = simd.mul_add_e_f32s(weights[1], input, sums[1]);
            }
        }
        let (floor, width, stride) = (simd.splat_f32s(self.floor), self.layer.width, self.layer.stride());
        for (idx, sums) in sums.into_iter().enumerate() {
            let outputs = &mut self.outputs[(row + idx) * stride + panel * width..][..width];
            let (outputs, _) = S::as_mut_simd_f32s(outputs);
            outputs[0] = simd.max_f32s(sums[0], floor);
            outputs[1] = simd.max_f32s(sums[1], floor);
        }
        ROWS
    }
}
