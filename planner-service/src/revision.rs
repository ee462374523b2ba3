//! Revisions of layers.

use std::num::NonZeroU64;
use surefoot_planner::edits::Layer;
use surefoot_planner::store::encode_layer;

/// Revision of a level's layers: a hash of their content, so that equal layers have equal revisions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Revision(pub NonZeroU64);

impl Revision {
    /// Returns the revision of these layers.
    pub fn of(layers: &[Layer]) -> Self {
        let mut hasher = blake3::Hasher::new();
        for layer in layers {
            // Each encoded layer begins with its checksum, so different lists of layers have different encodings.
            hasher.update(&encode_layer(layer));
        }
        let first = hasher.finalize().as_bytes().first_chunk().copied().expect("32 bytes");
        Self(NonZeroU64::new(u64::from_le_bytes(first)).unwrap_or(NonZeroU64::MIN))
    }
}
