//! The hidden state of recurrent networks.

use burn::tensor::{Device, Tensor, TensorData};

/// State of an LSTM between two steps; both tensors are `[members, batch, size]`.
#[derive(Debug, Clone)]
pub struct HiddenState {
    /// The hidden state, which is also the output.
    pub hidden: Tensor<3>,
    /// The cell state.
    pub cell: Tensor<3>,
}

impl HiddenState {
    /// The initial state: zeros.
    pub fn empty([members, batch, size]: [usize; 3], device: &Device) -> Self {
        let zeros = || Tensor::zeros([members, batch, size], device);
        Self { hidden: zeros(), cell: zeros() }
    }

    /// One member's state from rows of a hidden state followed by a cell state, `size` values each.
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

    /// Writes one member's state into rows in the layout that [`from_rows`](Self::from_rows) reads.
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
