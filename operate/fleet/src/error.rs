//! Errors of what is shared.

use surefoot_planner::store::StoreErrorKind;

/// A failure of the database, the blobs or the queue.
#[derive(Debug, Clone, thiserror::Error)]
#[error("{place}: {reason}")]
pub struct FleetError {
    /// What failed: an address without its password.
    pub place: String,
    /// Why, and what to change.
    pub reason: String,
    /// What may be done about it.
    pub kind: StoreErrorKind,
}

impl FleetError {
    /// An error of `place`, with what caused it.
    pub fn caused(place: impl Into<String>, error: &dyn std::error::Error) -> Self {
        let mut reason = error.to_string();
        let mut source = error.source();
        while let Some(cause) = source {
            let text = cause.to_string();
            // Some errors tell their causes themselves.
            if !reason.contains(&text) {
                reason.push_str(": ");
                reason.push_str(&text);
            }
            source = cause.source();
        }
        Self::new(place, reason)
    }

    /// An error of `place`, which may go away by itself.
    pub fn new(place: impl Into<String>, reason: impl ToString) -> Self {
        Self { place: place.into(), reason: reason.to_string(), kind: StoreErrorKind::Unavailable }
    }

    /// The same, of something that is gone or damaged for good.
    pub fn lost(place: impl Into<String>, reason: impl ToString) -> Self {
        Self { kind: StoreErrorKind::Lost, ..Self::new(place, reason) }
    }
}
