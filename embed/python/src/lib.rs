//! The native module of the Python package `surefoot`. The package around it (`surefoot/`) is Python and adapts this
//! module to Gymnasium, PettingZoo and others.
//!
//! [`environments`] is what all environments have in common; [`local`] steps those of this process on several threads,
//! [`remote`] those of a server, and [`draws`] has their starts and goals. None of the four knows Python. [`envs`]
//! passes the caller's arrays to them. [`level`] and [`body`] describe environments. [`graph`] builds graphs and
//! answers with a [`plan`]; [`zone`] has the zones of queries; [`policy`] decides. [`error`] turns every failure into
//! an exception.

mod arrays;
mod body;
mod draws;
mod environments;
mod envs;
mod error;
mod graph;
mod level;
mod local;
mod picture;
mod plan;
mod policy;
mod remote;
mod server;
mod threads;
mod zone;

use pyo3::prelude::*;

/// Everything of the package that is not Python.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::envs::{RustOnly, Worlds};
    #[pymodule_export]
    use crate::graph::Graph;
    #[pymodule_export]
    use crate::level::Level;
    #[pymodule_export]
    use crate::plan::{Arrival, Leg, Plan};
    #[pymodule_export]
    use crate::policy::Policy;
    #[pymodule_export]
    use crate::server::{Server, connect};
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
    #[pymodule_export]
    const OBSERVATION_LEN: usize = surefoot_world::OBSERVATION_LEN;
    #[pymodule_export]
    const OBSERVATION_WITH_OTHERS_LEN: usize = surefoot_world::OBSERVATION_WITH_OTHERS_LEN;
    #[pymodule_export]
    const ACTION_LEN: usize = surefoot_world::character::ACTION_LEN;

    use pyo3::prelude::*;

    /// The values of the state vector of an observation: for each its index, name, meaning, scale, and whether
    /// mirroring flips it.
    #[pyfunction]
    fn state_fields() -> Vec<(usize, &'static str, &'static str, f32, bool)> {
        let fields = (surefoot_world::sense::STATE_BEGIN..).zip(&surefoot_world::sense::FIELDS);
        fields.map(|(idx, it)| (idx, it.name, it.meaning, it.scale, it.flips)).collect()
    }

    /// Names of all bodies.
    #[pyfunction]
    fn body_names() -> Vec<&'static str> {
        crate::body::names()
    }
}
