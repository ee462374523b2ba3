//! Errors of what is shared.

/// A failure of the record, the blobs or the queue.
#[derive(Debug, Clone, thiserror::Error)]
#[error("{place}: {reason}")]
pub struct FleetError {
    /// What failed: an address without its password.
    pub place: String,
    /// Why, and what to change.
    pub reason: String,
}

impl FleetError {
    /// An error of `place`.
    pub fn new(place: impl Into<String>, reason: impl ToString) -> Self {
        Self { place: place.into(), reason: reason.to_string() }
    }
}
