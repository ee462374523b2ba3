//! The caller's numpy arrays, borrowed for the duration of a call, and new ones.

use crate::environments::Outputs;
use crate::error::value;
use numpy::{
    Element, IntoPyArray, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyReadwriteArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use surefoot_world::character::ACTION_LEN;

/// Borrows an array for writing, which must be laid out like `shape` in C order.
pub fn writable<'py, T: Element>(
    array: &Bound<'py, PyArrayDyn<T>>,
    shape: &[usize],
    name: &str,
) -> PyResult<PyReadwriteArrayDyn<'py, T>> {
    check(array, shape, name)?;
    array.try_readwrite().map_err(|error| value(format!("{name}: {error}")))
}

/// Borrows an array for reading, which must be laid out like `shape` in C order.
pub fn readable<'py, T: Element>(
    array: &Bound<'py, PyArrayDyn<T>>,
    shape: &[usize],
    name: &str,
) -> PyResult<PyReadonlyArrayDyn<'py, T>> {
    check(array, shape, name)?;
    array.try_readonly().map_err(|error| value(format!("{name}: {error}")))
}

fn check<T>(array: &Bound<'_, PyArrayDyn<T>>, shape: &[usize], name: &str) -> PyResult<()> {
    if array.shape() != shape {
        return Err(value(format!("{name} has the shape {:?}, but must have {shape:?}", array.shape())));
    }
    if !array.is_c_contiguous() {
        return Err(value(format!("{name} must be contiguous, in C order")));
    }
    Ok(())
}

/// Makes an array with a row for each place.
pub fn rows<'py, T: Element>(
    py: Python<'py>,
    places: impl Iterator<Item = [T; 3]>,
) -> PyResult<Bound<'py, PyArray2<T>>> {
    let values: Vec<T> = places.flatten().collect();
    let count = values.len() / 3;
    values.into_pyarray(py).reshape([count, 3])
}

/// The arrays of a step.
pub struct StepArrays<'a, 'py> {
    /// Holds a row for each environment.
    pub actions: &'a Bound<'py, PyArrayDyn<f32>>,
    /// Receives a row for each environment.
    pub observations: &'a Bound<'py, PyArrayDyn<f32>>,
    /// Receives a value for each environment, as the next two do.
    pub rewards: &'a Bound<'py, PyArrayDyn<f32>>,
    /// Whether the episode terminated.
    pub terminated: &'a Bound<'py, PyArrayDyn<bool>>,
    /// Whether the episode was truncated.
    pub truncated: &'a Bound<'py, PyArrayDyn<bool>>,
}

impl StepArrays<'_, '_> {
    /// Calls `step` with the arrays of so many environments and values of an observation.
    ///
    /// # Errors
    /// If an array has another shape, is not laid out in C order, or is borrowed already.
    pub fn lend<T>(self, [count, len]: [usize; 2], step: impl FnOnce(&[f32], Outputs<'_>) -> T) -> PyResult<T> {
        let actions = readable(self.actions, &[count, ACTION_LEN], "actions")?;
        let mut observations = writable(self.observations, &[count, len], "observations")?;
        let mut rewards = writable(self.rewards, &[count], "rewards")?;
        let mut terminated = writable(self.terminated, &[count], "terminated")?;
        let mut truncated = writable(self.truncated, &[count], "truncated")?;
        let outputs = Outputs {
            observations: observations.as_slice_mut()?,
            rewards: rewards.as_slice_mut()?,
            terminated: terminated.as_slice_mut()?,
            truncated: truncated.as_slice_mut()?,
        };
        Ok(step(actions.as_slice()?, outputs))
    }
}
