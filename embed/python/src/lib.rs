//! The native module of the Python package `surefoot`: what is fast, and what is ours. The package around it (`surefoot/`) is Python and
//! brings this into the forms that Gymnasium, PettingZoo and others expect.
//!
//! [`vector`] steps environments on several threads; it knows nothing of Python. [`envs`] lends it the caller's arrays. [`far`] steps
//! those of a server likewise, for which [`remote`] does the same. [`level`] and
//! [`body`] are what environments are made of. [`graph`] builds graphs and answers with a [`plan`]; [`policy`] decides. No panic crosses into Python as anything but an exception, which [`error`] writes.

mod arrays;
mod body;
mod envs;
mod error;
mod far;
mod graph;
mod level;
mod picture;
mod plan;
mod policy;
mod remote;
mod vector;

use pyo3::prelude::*;

/// Everything of the package that is not Python.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::envs::{Alone, Worlds};
    #[pymodule_export]
    use crate::graph::Graph;
    #[pymodule_export]
    use crate::level::Level;
    #[pymodule_export]
    use crate::plan::{Leg, Plan};
    #[pymodule_export]
    use crate::policy::Policy;
    #[pymodule_export]
    use crate::remote::{RemoteWorlds, Server, connect};
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
    #[pymodule_export]
    const OBSERVATION_LEN: usize = surefoot_world::OBSERVATION_LEN;
    #[pymodule_export]
    const OBSERVATION_WITH_OTHERS_LEN: usize = surefoot_world::OBSERVATION_WITH_OTHERS_LEN;
    #[pymodule_export]
    const ACTION_LEN: usize = surefoot_world::character::ACTION_LEN;

    use pyo3::prelude::*;

    /// Names of all bodies.
    #[pyfunction]
    fn body_names() -> Vec<&'static str> {
        crate::body::names()
    }
}
