//! The map and character that a graph is built for, and the identity of the policy that proves it.

use std::sync::Arc;
use surefoot_world::{CharacterProfile, Map};

/// A map and the profile of the character that moves on it.
#[derive(Debug, Clone)]
pub struct Site {
    /// The map.
    pub map: Arc<Map>,
    /// The character's profile.
    pub profile: CharacterProfile,
}

impl Site {
    /// Creates a site of `map` and the default character.
    pub fn new(map: Arc<Map>) -> Self {
        Self { map, profile: CharacterProfile::default() }
    }
}

/// Hash of a policy's weights, in hexadecimal digits, as in the policy's manifest.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PolicyHash(String);

impl PolicyHash {
    /// Wraps the hash from a manifest.
    pub fn new(weights_hash: impl Into<String>) -> Self {
        Self(weights_hash.into())
    }

    /// Returns the hexadecimal digits.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}
