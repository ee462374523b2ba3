//! Errors of the database, the blobs and the queue.

use surefoot_planner::store::StoreErrorKind;

/// Name of the database in errors.
pub(crate) const DATABASE: &str = "PostgreSQL";

/// A failure of the database, the blobs or the queue.
#[derive(Debug, Clone, thiserror::Error)]
#[error("{place}: {reason}")]
pub struct FleetError {
    /// Address of what failed, without its password.
    pub place: String,
    /// Why it failed, and what to change.
    pub reason: String,
    /// What may be done about it.
    pub kind: StoreErrorKind,
}

/// Converts a failure of a query.
impl From<sqlx::Error> for FleetError {
    fn from(error: sqlx::Error) -> Self {
        // Lost connections, rollbacks, read-only standbys, want of resources or locks, shutdowns, system failures.
        const PASSING: [&str; 7] = ["08", "25", "40", "53", "55", "57", "58"];
        let is_passing = |code: &str| PASSING.iter().any(|class| code.starts_with(class));
        let kind = match &error {
            sqlx::Error::Database(refusal) if refusal.code().is_some_and(|code| !is_passing(&code)) => {
                StoreErrorKind::Refused
            }
            _ => StoreErrorKind::Unavailable,
        };
        Self { kind, ..Self::new(DATABASE, error) }
    }
}

impl FleetError {
    /// Creates an error of `place` with the chain of its causes.
    pub fn caused(place: impl Into<String>, error: &dyn std::error::Error) -> Self {
        let mut reason = error.to_string();
        let mut source = error.source();
        while let Some(cause) = source {
            let text = cause.to_string();
            // Some errors include their causes.
            if !reason.contains(&text) {
                reason.push_str(": ");
                reason.push_str(&text);
            }
            source = cause.source();
        }
        Self::new(place, reason)
    }

    /// Creates an error of `place` that may be temporary.
    pub fn new(place: impl Into<String>, reason: impl ToString) -> Self {
        Self { place: place.into(), reason: reason.to_string(), kind: StoreErrorKind::Unavailable }
    }

    /// Creates an error about something that is gone or damaged permanently.
    pub fn lost(place: impl Into<String>, reason: impl ToString) -> Self {
        Self { kind: StoreErrorKind::Lost, ..Self::new(place, reason) }
    }
}
