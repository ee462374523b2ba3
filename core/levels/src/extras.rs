//! Properties that designers attach to nodes.

use crate::faults::ImportError;
use crate::scene::Node;
use glam::DVec3;
use serde_json::Value;

/// Properties that a designer attached to a node.
pub(super) struct Extras<'a> {
    of: &'a str,
    values: serde_json::Map<String, Value>,
}

impl<'a> Extras<'a> {
    pub(super) fn new<P>(node: &Node<P>, of: &'a str) -> Result<Self, ImportError> {
        let json = node.extras.as_ref().map_or("{}", |extras| extras.get());
        match serde_json::from_str(json) {
            Ok(Value::Object(mut values)) => {
                // Null stands for no value.
                values.retain(|_, value| !value.is_null());
                Ok(Self { of, values })
            }
            // Extras that are not an object have no meaning here.
            Ok(_) => Ok(Self { of, values: serde_json::Map::new() }),
            Err(error) => Err(ImportError::Json(format!("extras of {of}: {error}"))),
        }
    }

    /// Whether there is a value.
    pub(super) fn has(&self, key: &str) -> bool {
        self.values.contains_key(key)
    }

    /// A value that is a text; `None` if there is none or it is something else.
    pub(super) fn text(&self, key: &str) -> Option<&str> {
        self.values.get(key).and_then(Value::as_str)
    }

    /// The error that a value is refused.
    pub(super) fn refuse(&self, key: &'static str, value: &str, expected: &'static str) -> ImportError {
        property(self.of, key, value, expected)
    }

    /// A vector in the level's coordinates, if there is one.
    pub(super) fn vector(&self, key: &'static str) -> Result<Option<DVec3>, ImportError> {
        let Some(value) = self.values.get(key) else { return Ok(None) };
        let vector: Option<[f64; 3]> = serde_json::from_value(value.clone()).ok();
        vector.map(|vector| Some(vector.into())).ok_or_else(|| property(self.of, key, value, "give three numbers"))
    }

    /// Vectors in the level's coordinates; none if there is no such value.
    pub(super) fn vectors(&self, key: &'static str) -> Result<Vec<DVec3>, ImportError> {
        let Some(value) = self.values.get(key) else { return Ok(Vec::new()) };
        let vectors: Option<Vec<[f64; 3]>> = serde_json::from_value(value.clone()).ok();
        let vectors =
            vectors.ok_or_else(|| property(self.of, key, value, "give a list of places, three numbers each"))?;
        Ok(vectors.into_iter().map(DVec3::from).collect())
    }

    pub(super) fn number(&self, key: &'static str) -> Result<Option<f64>, ImportError> {
        let Some(value) = self.values.get(key) else { return Ok(None) };
        value.as_f64().map(Some).ok_or_else(|| property(self.of, key, value, "give a number"))
    }

    /// Reads a flag, if there is one; some tools write flags as 0 and 1.
    pub(super) fn flag(&self, key: &'static str) -> Result<Option<bool>, ImportError> {
        match self.values.get(key) {
            None => Ok(None),
            Some(Value::Bool(flag)) => Ok(Some(*flag)),
            Some(value) if value.as_f64() == Some(0.0) => Ok(Some(false)),
            Some(value) if value.as_f64() == Some(1.0) => Ok(Some(true)),
            Some(value) => Err(property(self.of, key, value, "give true or false")),
        }
    }

    /// Radius of a pool that is marked as round, m; `None` for a rectangle.
    pub(super) fn radius(&self) -> Result<Option<f32>, ImportError> {
        let Some(outline) = self.values.get("outline") else { return Ok(None) };
        match (outline.as_str(), self.number("radius")?) {
            (Some("rectangle"), _) => Ok(None),
            (Some("round"), Some(radius)) if radius > 0.0 => Ok(Some(radius as f32)),
            (Some("round"), _) => {
                let radius = self.values.get("radius").unwrap_or(&Value::Null);
                Err(property(self.of, "radius", radius, "a round pool needs a radius above 0"))
            }
            _ => Err(property(self.of, "outline", outline, "must be \"round\" or \"rectangle\"")),
        }
    }
}

/// The error that the property `key` of `of` cannot be used.
pub(super) fn property(of: &str, key: &'static str, value: impl ToString, expected: &'static str) -> ImportError {
    ImportError::Property { of: of.to_owned(), key, value: value.to_string(), expected }
}
