//! Fully connected layers on the CPU.
//!
//! Weights are stored in panels of two vectors' width, so that a product reads them once and in order. Several rows
//! share each vector of weights that is loaded. Every output is one sum in the order of the inputs, so its bits depend
//! neither on the number of rows nor on the width of vectors.

use pulp::{Arch, Simd, WithSimd};

/// Rows that share the weights that are loaded: their sums and two vectors of weights fit into the registers.
const TILE: usize = 6;
/// Alignment of arrays, in values: the length of the widest vectors.
const ALIGNMENT: usize = 16;

/// Values that begin at a cache line, so that no vector spans two lines.
#[derive(Debug, Clone, Default)]
pub(crate) struct Aligned {
    values: Vec<f32>,
    start: usize,
    len: usize,
}

impl Aligned {
    pub fn zeros(len: usize) -> Self {
        let values = vec![0.0; len + ALIGNMENT];
        let start = values.as_ptr().align_offset(ALIGNMENT * size_of::<f32>()).min(ALIGNMENT);
        Self { values, start, len }
    }

    /// Copies rows of `width` values to rows that begin `stride` values apart.
    pub fn of_rows(rows: &[f32], width: usize, stride: usize) -> Self {
        let mut copy = Self::zeros(rows.len() / width * stride);
        for (to, from) in copy.values_mut().chunks_exact_mut(stride).zip(rows.chunks_exact(width)) {
            to[..width].copy_from_slice(from);
        }
        copy
    }

    pub fn values(&self) -> &[f32] {
        &self.values[self.start..][..self.len]
    }

    pub fn values_mut(&mut self) -> &mut [f32] {
        &mut self.values[self.start..][..self.len]
    }
}

/// A fully connected layer.
#[derive(Debug)]
pub(crate) struct Layer {
    arch: Arch,
    /// Number of inputs.
    pub inputs: usize,
    /// Number of outputs of a panel: two vectors.
    width: usize,
    /// `[panels, inputs, width]`, padded with zeros.
    panels: Aligned,
    /// `[panels, width]`.
    bias: Aligned,
}

impl Layer {
    /// Lays out weights `[inputs, outputs]`.
    pub fn new(weights: &[f32], bias: &[f32]) -> Self {
        let arch = Arch::new();
        let (outputs, width) = (bias.len(), 2 * arch.dispatch(LaneCount));
        let (inputs, panel_count) = (weights.len() / outputs, outputs.div_ceil(width));
        let mut panels = Aligned::zeros(panel_count * inputs * width);
        for (idx, panel) in panels.values_mut().chunks_exact_mut(inputs * width).enumerate() {
            let columns = idx * width..outputs.min((idx + 1) * width);
            for (to, from) in panel.chunks_exact_mut(width).zip(weights.chunks_exact(outputs)) {
                to[..columns.len()].copy_from_slice(&from[columns.clone()]);
            }
        }
        Self { arch, inputs, width, panels, bias: Aligned::of_rows(bias, outputs, panel_count * width) }
    }

    /// Distance between rows of outputs, in values: the number of outputs with the padding.
    pub fn stride(&self) -> usize {
        self.bias.len
    }

    /// Applies the layer to rows of inputs that begin `stride` values apart, one for each row of `outputs`. Results
    /// below `floor` are raised to it.
    pub fn forward(&self, inputs: &[f32], stride: usize, floor: f32, outputs: &mut [f32]) {
        let rows = outputs.len() / self.stride();
        self.arch.dispatch(Product { layer: self, inputs, stride, rows, floor, outputs });
    }
}

/// The number of values in a vector.
struct LaneCount;

impl WithSimd for LaneCount {
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
    /// Computes the outputs of a panel for `ROWS` rows from `row` on, and returns `ROWS`.
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
