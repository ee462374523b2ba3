//! Why a world's thread does not accept a call.

/// Why a world's thread does not accept a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SimError {
    /// Too many calls wait for it.
    #[error("too many calls are waiting for this world: try again")]
    Busy,
    /// The world's thread has ended.
    #[error("the world has stopped")]
    Stopped,
}
