//! Why a world's thread does not take a call.

/// Calls waiting for a world; one more is refused with [`SimError::Busy`].
pub const INBOX: usize = 4096;

/// Why a world's thread does not take a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SimError {
    /// Too many calls wait for it.
    #[error("{INBOX} calls are waiting for this world already: try again")]
    Busy,
    /// It has ended.
    #[error("the world has stopped")]
    Stopped,
}
