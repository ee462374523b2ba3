//! Where a graph is built, as whom, and by which policy it is proved.

use std::sync::Arc;
use surefoot_world::{CharacterProfile, Map};

/// A map and the character that moves on it.
#[derive(Debug, Clone)]
pub struct Site {
    /// The map.
    pub map: Arc<Map>,
    /// The character.
    pub profile: CharacterProfile,
}

impl Site {
    /// `map` as the default character sees it.
    pub fn new(map: Arc<Map>) -> Self {
        Self { map, profile: CharacterProfile::default() }
    }
}

/// Hash of a policy's weights: hexadecimal digits, as its manifest names them.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PolicyHash(String);

impl PolicyHash {
    /// The hash that a manifest names.
    pub fn new(weights_hash: impl Into<String>) -> Self {
        Self(weights_hash.into())
    }

    /// The digits.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}
