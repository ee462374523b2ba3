//! Policies that agents share.

use crate::error::{SurefootError, chain};
use bevy_ecs::prelude::*;
use std::path::Path;
use std::sync::Arc;
use surefoot_policy::{CheckpointError, Manifest, Policy};

/// The weights by which agents decide, a component of agents that have other weights than the rest. Clones share them.
#[derive(Component, Debug, Clone)]
#[cfg_attr(feature = "asset", derive(bevy_asset::Asset, bevy_reflect::TypePath))]
pub struct SurefootPolicy {
    pub(crate) inner: Policy,
    label: Arc<str>,
}

/// The policy of agents that have none as a component.
#[derive(Resource, Debug, Clone, Default)]
pub struct DefaultPolicy(pub SurefootPolicy);

impl PartialEq for SurefootPolicy {
    fn eq(&self, other: &Self) -> bool {
        self.inner.weights_hash() == other.inner.weights_hash()
    }
}

impl Default for SurefootPolicy {
    /// The shipped `general-reactive`.
    fn default() -> Self {
        Self::of(Policy::shipped().expect("the shipped weights are whole"))
    }
}

impl SurefootPolicy {
    fn of(inner: Policy) -> Self {
        Self { label: inner.label().into(), inner }
    }

    /// The shipped policy of that name: `general-reactive`, or `general-lstm`, which remembers.
    ///
    /// # Errors
    /// If there is none.
    pub fn shipped(name: &str) -> Result<Self, SurefootError> {
        let policy = Policy::shipped_named(name).ok_or_else(|| SurefootError::NoPolicy(name.to_owned()))?;
        policy.map(Self::of).map_err(|error| SurefootError::Policy(chain(&error)))
    }

    /// Reads a model's folder, such as `runs/mine/last`.
    ///
    /// # Errors
    /// If a file is missing or damaged.
    pub fn load(folder: impl AsRef<Path>) -> Result<Self, SurefootError> {
        let rejected = |error: CheckpointError| SurefootError::Policy(chain(&error));
        Policy::load(folder.as_ref()).map(Self::of).map_err(rejected)
    }

    /// Decodes the contents of a model's `manifest.json` and `weights.bpk`.
    ///
    /// # Errors
    /// If they are damaged or do not belong together.
    pub fn from_bytes(manifest: &[u8], weights: &[u8]) -> Result<Self, SurefootError> {
        let manifest: Manifest = serde_json::from_slice(manifest).map_err(SurefootError::Manifest)?;
        let rejected = |error: CheckpointError| SurefootError::Policy(chain(&error));
        Policy::from_bytes(manifest, weights).map(Self::of).map_err(rejected)
    }

    /// Name and shortened hash of the weights, such as `general-reactive (1a2b3c4d5e6f)`.
    pub fn label(&self) -> &str {
        &self.label
    }
}
