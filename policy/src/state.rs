//! What a recurrent network carries from step to step.

use burn::tensor::{Device, Tensor, TensorData};

/// What an LSTM carries from step to step, each `[members, batch, size]`.
#[derive(Debug, Clone)]
pub struct HiddenState {
    /// The hidden state: also the output.
    pub hidden: Tensor<3>,
    /// The cell state.
    pub cell: Tensor<3>,
}

impl HiddenState {
    /// Nothing remembered.
    pub fn empty([members, batch, size]: [usize; 3], device: &Device) -> Self {
        let zeros = || Tensor::zeros([members, batch, size], device);
        Self { hidden: zeros(), cell: zeros() }
    }

    /// One member's memory from rows that hold a hidden state and then a cell state of `size` values each.
    pub fn from_rows(rows: &[f32], size: usize, device: &Device) -> Self {
        let batch = rows.len() / (2 * size);
        let part = |which: usize| {
            let mut values = Vec::with_capacity(batch * size);
            for row in rows.chunks_exact(2 * size) {
                values.extend_from_slice(&row[which * size..][..size]);
            }
            Tensor::from_data(TensorData::new::<f32, _>(values, [1, batch, size]), device)
        };
        Self { hidden: part(0), cell: part(1) }
    }

    /// Writes one member's memory into rows as [`from_rows`](Self::from_rows) reads them.
    pub fn write_rows(self, rows: &mut [f32]) {
        let [_, _, size] = self.hidden.dims();
        for (which, tensor) in [self.hidden, self.cell].into_iter().enumerate() {
            let data = tensor.into_data();
            let values = data.as_slice::<f32>().expect("f32 tensors");
            for (row, values) in rows.chunks_exact_mut(2 * size).zip(values.chunks_exact(size)) {
                row[which * size..][..size].copy_from_slice(values);
            }
        }
    }
}
