//! A trained policy: its weights, their manifest, and the actor that evaluates them.

use crate::actor::{Actor, Batch, Scratch};
use crate::cpu_actor::CpuActor;
use crate::manifest::{CheckpointError, Manifest};
use crate::weights::Weights;
use std::fmt;
use std::sync::Arc;
use surefoot_world::Action;
use surefoot_world::character::ACTION_LEN;

/// A trained policy that decides for many NPCs at once. Clones share the weights.
#[derive(Clone)]
pub struct Policy {
    actor: Arc<dyn Actor>,
    manifest: Arc<Manifest>,
    weights: Arc<[u8]>,
    senses_transports: bool,
}

impl fmt::Debug for Policy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Policy").field(&self.label()).finish()
    }
}

impl Policy {
    /// Decodes a policy from the contents of a model's files.
    ///
    /// # Errors
    /// If the weights do not match the manifest, or do not fit this program's network or observation.
    pub fn from_bytes(manifest: Manifest, weights: &[u8]) -> Result<Self, CheckpointError> {
        manifest.check(weights)?;
        let decoded = Weights::from_burnpack(&manifest.actor, weights)?;
        Ok(Self {
            actor: Arc::new(CpuActor::new(manifest.actor, decoded)),
            manifest: Arc::new(manifest),
            weights: weights.into(),
            senses_transports: true,
        })
    }

    /// The same policy, evaluated by another actor.
    #[must_use]
    pub fn with_actor(self, actor: Arc<dyn Actor>) -> Self {
        Self { actor, ..self }
    }

    /// The same policy, but its observations do not show zip lines and teleporters, as those of the paper's agents do
    /// not.
    #[must_use]
    pub fn without_transports(self) -> Self {
        Self { senses_transports: false, ..self }
    }

    /// Whether observations show zip lines and teleporters.
    pub fn senses_transports(&self) -> bool {
        self.senses_transports
    }

    /// The manifest of the weights.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The contents of the weights file.
    pub fn weights(&self) -> &[u8] {
        &self.weights
    }

    /// blake3 of the weights file, hexadecimal; part of every graph's id.
    pub fn weights_hash(&self) -> &str {
        &self.manifest.weights_hash
    }

    /// Name and shortened hash of the weights for display, such as `general-reactive (1a2b3c4d5e6f)`: ASCII, at most 64
    /// bytes.
    pub fn label(&self) -> String {
        let short = |text: &str, most: usize| text.chars().filter(char::is_ascii).take(most).collect::<String>();
        format!("{} ({})", short(&self.manifest.name, 40), short(&self.manifest.weights_hash, 12))
    }

    /// Number of values of an observation: [`OBSERVATION_LEN`](surefoot_world::OBSERVATION_LEN), or
    /// [`OBSERVATION_WITH_OTHERS_LEN`](surefoot_world::OBSERVATION_WITH_OTHERS_LEN) for a policy that sees others.
    pub fn observation_len(&self) -> usize {
        self.manifest.actor.observation_len()
    }

    /// Number of values in an NPC's memory row; 0 for a reactive policy.
    pub fn memory_len(&self) -> usize {
        self.manifest.actor.hidden_len()
    }

    /// Buffers for batches of up to `row_count` rows; [`act`](Self::act) allocates them at need for more.
    pub fn scratch(&self, row_count: usize) -> Scratch {
        let mut scratch = Scratch::default();
        self.actor.fit(&mut scratch, row_count);
        scratch
    }

    /// Computes an action for each observation: the policy's mean plus its standard deviation times the noise,
    /// squashed. `actions` is cleared and gets one entry per row.
    ///
    /// Without noise the action is the most likely one. Some noise frees NPCs from places where the mean alone runs in
    /// circles.
    ///
    /// # Panics
    /// If `observations` is not a whole number of rows, or the numbers of rows differ.
    pub fn act(&self, batch: Batch<'_>, scratch: &mut Scratch, actions: &mut Vec<Action>) {
        let rows = batch.observations.len() / self.observation_len();
        assert_eq!(batch.observations.len(), rows * self.observation_len(), "whole observation rows");
        assert_eq!(batch.memory.len(), rows * self.memory_len(), "a row of memory for each observation");
        assert!(batch.noise.is_empty() || batch.noise.len() == rows * ACTION_LEN, "noise for each action");
        actions.clear();
        actions.resize(rows, Action::default());
        self.actor.act(batch, scratch, actions);
    }
}
