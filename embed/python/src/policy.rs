//! Policies: actions for batches of observations, and the memory of recurrent policies.

use crate::arrays::readable;
use crate::error::{chain, fixed, value};
use numpy::{IntoPyArray, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyFileNotFoundError;
use pyo3::prelude::*;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use surefoot_policy::{CheckpointError, HiddenStates, Policy as Inner, noise};
use surefoot_world::OBSERVATION_WITH_OTHERS_LEN;
use surefoot_world::character::ACTION_LEN;

/// A trained policy, and the memories of the rows of its batches.
#[pyclass(frozen, module = "surefoot")]
#[derive(Debug)]
pub struct Policy {
    pub inner: Inner,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    memories: HiddenStates,
    /// Number of rows that have a memory.
    rows: usize,
    rng: ChaCha8Rng,
}

impl State {
    /// Gives `rows` rows a memory; new memories are empty.
    fn grow(&mut self, rows: usize) {
        (self.rows..rows).for_each(|row| self.memories.forget(row));
        self.rows = self.rows.max(rows);
    }
}

impl Policy {
    /// Loads a shipped policy by name, or the policy of a model's folder.
    pub fn open(name: &str, seed: u64) -> PyResult<Self> {
        let loaded = match Inner::shipped_named(name) {
            Some(shipped) => shipped,
            None => Inner::load(&PathBuf::from(name)),
        };
        let inner = loaded.map_err(|error| match error {
            CheckpointError::Io { .. } => PyFileNotFoundError::new_err(format!(
                "{}; shipped policies are general-reactive and general-lstm",
                chain(&error)
            )),
            _ => value(format!("{name}: {}", chain(&error))),
        })?;
        let state = State { memories: HiddenStates::new(&inner), rows: 0, rng: ChaCha8Rng::seed_from_u64(seed) };
        Ok(Self { inner, state: Mutex::new(state) })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // A failed call leaves a valid memory.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Policy {
    #[staticmethod]
    #[pyo3(signature = (name = PathBuf::from("general-reactive"), *, seed = 0))]
    fn load(py: Python<'_>, name: PathBuf, seed: u64) -> PyResult<Self> {
        let name = name.to_str().ok_or_else(|| value("the name of the policy is not text"))?;
        py.detach(|| Self::open(name, seed))
    }

    #[pyo3(signature = (observations, *, reset = None, noise = 0.5))]
    fn act<'py>(
        &self,
        py: Python<'py>,
        observations: &Bound<'py, PyArrayDyn<f32>>,
        reset: Option<&Bound<'py, PyArrayDyn<bool>>>,
        noise: f32,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let wanted = self.inner.observation_len();
        let shape = observations.shape().to_vec();
        let [rows, len] = shape[..] else {
            return Err(value(format!("observations has the shape {shape:?}, but must have [n, {wanted}]")));
        };
        if len != wanted && len != OBSERVATION_WITH_OTHERS_LEN {
            return Err(value(format!("observations has the shape {shape:?}, but must have [{rows}, {wanted}]")));
        }
        if !(0.0..=1.0).contains(&noise) {
            return Err(value(format!("noise is {noise}, but must be 0 to 1")));
        }
        let observations = readable(observations, &shape, "observations")?;
        let values = observations.as_slice()?;
        if let Some(idx) = values.iter().position(|value| !value.is_finite()) {
            return Err(value(format!(
                "observations[{}, {}] is {}, but must be finite",
                idx / len,
                idx % len,
                values[idx]
            )));
        }
        let reset = reset.map(|mask| readable(mask, &[rows], "reset")).transpose()?;
        let mask = reset.as_ref().map(|mask| mask.as_slice()).transpose()?;
        let actions = py.detach(|| {
            let mut state = self.state();
            let state = &mut *state;
            state.grow(rows);
            let forgotten = mask.into_iter().flatten().enumerate().filter(|(_, reset)| **reset);
            forgotten.for_each(|(row, _)| state.memories.forget(row));
            // Policies without other bodies get the first part of each row.
            let cut: Vec<f32>;
            let seen = if len == wanted {
                values
            } else {
                cut = values.chunks_exact(len).flat_map(|row| &row[..wanted]).copied().collect();
                &cut
            };
            let mut actions = Vec::with_capacity(rows);
            let noise = noise::for_rows(&mut state.rng, noise, rows);
            state.memories.act(&self.inner, 0..rows, seen, &noise, &mut actions);
            actions.iter().flat_map(|action| action.to_array()).collect::<Vec<f32>>()
        });
        actions.into_pyarray(py).reshape([rows, ACTION_LEN])
    }

    /// Clears the memory of recurrent policies.
    #[pyo3(signature = (*, seed = None))]
    fn reset(&self, seed: Option<u64>) {
        let mut state = self.state();
        (state.memories, state.rows) = (HiddenStates::new(&self.inner), 0);
        if let Some(seed) = seed {
            state.rng = ChaCha8Rng::seed_from_u64(seed);
        }
    }

    #[getter]
    fn name(&self) -> String {
        self.inner.manifest().name.clone()
    }

    #[getter]
    fn observation_len(&self) -> usize {
        self.inner.observation_len()
    }

    #[getter]
    fn is_recurrent(&self) -> bool {
        self.inner.memory_len() > 0
    }

    /// The memory of each row.
    #[getter]
    fn memory<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let state = self.state();
        let rows = state.memories.rows().to_vec();
        rows.into_pyarray(py).reshape([state.rows, self.inner.memory_len()])
    }

    #[setter]
    fn set_memory(&self, memory: &Bound<'_, PyArrayDyn<f32>>) -> PyResult<()> {
        let shape = memory.shape().to_vec();
        let len = self.inner.memory_len();
        if shape.len() != 2 || shape[1] != len {
            return Err(value(format!("memory has the shape {shape:?}, but must have [n, {len}]")));
        }
        let memory = readable(memory, &shape, "memory")?;
        let mut state = self.state();
        state.memories.set_rows(memory.as_slice()?.to_vec());
        state.rows = shape[0];
        Ok(())
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(fixed("policies cannot be copied or pickled: load the policy again, and set its memory"))
    }

    fn __repr__(&self) -> String {
        format!("<Policy {}>", self.inner.label())
    }
}
