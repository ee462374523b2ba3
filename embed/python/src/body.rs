//! Bodies by name or by the fields of a profile.

use crate::error::value;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use surefoot_world::CharacterProfile;
use surefoot_world::character::bodies::{BODIES, NamedBody};

/// Reads a body: its name, or a JSON object with the fields of its profile.
pub fn read(text: &str) -> PyResult<CharacterProfile> {
    if text.starts_with('{') {
        return serde_json::from_str(text).map_err(|error| value(format!("body: {error}")));
    }
    NamedBody::find(text).map(|body| body.profile()).ok_or_else(|| {
        let names = BODIES.map(|body| body.name).join(", ");
        value(format!("there is no body `{text}`: there are {names}, or a dict with the fields of a profile"))
    })
}

/// A body as a caller gives it.
#[derive(FromPyObject)]
pub enum Figures<'py> {
    /// Its name.
    Name(String),
    /// The fields that differ from the default.
    Fields(Bound<'py, PyDict>),
}

impl Default for Figures<'_> {
    fn default() -> Self {
        Self::Name("surefoot".to_owned())
    }
}

impl Figures<'_> {
    /// The body.
    pub fn profile(&self, py: Python<'_>) -> PyResult<CharacterProfile> {
        match self {
            Self::Name(name) => read(name),
            Self::Fields(fields) => read(&py.import("json")?.call_method1("dumps", (fields,))?.extract::<String>()?),
        }
    }
}

/// Names of all bodies.
pub fn names() -> Vec<&'static str> {
    BODIES.map(|body| body.name).to_vec()
}
