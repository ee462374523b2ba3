//! What every lock of the service relies on.

/// Nobody panics while holding one.
pub(crate) const POISON: &str = "no holder of this lock panics";
