//! Bodies by name or by figures.

use crate::error::value;
use pyo3::PyResult;
use surefoot_world::CharacterProfile;
use surefoot_world::character::bodies::{BODIES, NamedBody};

/// The body with a name, or the one whose figures are a JSON object.
pub fn read(text: &str) -> PyResult<CharacterProfile> {
    if text.starts_with('{') {
        return serde_json::from_str(text).map_err(|error| value(format!("body: {error}")));
    }
    NamedBody::find(text).map(|body| body.profile()).ok_or_else(|| {
        let names = BODIES.map(|body| body.name).join(", ");
        value(format!("there is no body `{text}`: there are {names}, or a dict with the fields of a profile"))
    })
}

/// Names of all bodies.
pub fn names() -> Vec<&'static str> {
    BODIES.map(|body| body.name).to_vec()
}
