//! The invariant of the service's locks.

/// Panic message for a poisoned lock. Locks are never poisoned, because no code panics while holding one.
pub(crate) const POISON: &str = "no holder of this lock panics";
