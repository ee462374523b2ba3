//! Why a world's thread does not accept a call.

/// Most calls waiting for a world; a further one is refused with [`SimError::Busy`].
pub const INBOX: usize = 4096;

/// Why a world's thread does not accept a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SimError {
    /// Too many calls are waiting for the world.
    #[error("{INBOX} calls are already waiting for this world: try again")]
    Busy,
    /// The world's thread has ended.
    #[error("the world has stopped")]
    Stopped,
}
