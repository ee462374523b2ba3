//! Limits on the use of an endpoint by its peers.

use std::time::Duration;

/// Largest message that a service sends, bytes; clients should accept messages of this size.
pub const MAX_MESSAGE_BYTES: usize = 16 * 1024 * 1024;

/// Limits of one endpoint. A peer that exceeds one is refused or disconnected; other peers are not affected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Largest request message, bytes (`--max-message-bytes`).
    pub max_message_bytes: usize,
    /// Largest request message of services that import levels, bytes (`--max-import-bytes`).
    pub max_import_bytes: usize,
    /// Most open streams of one connection (`--max-streams`); further ones wait at the client.
    pub max_streams: u32,
    /// Most open connections (`--max-connections`). Another connection replaces the oldest one without an authorized
    /// request; if there is none, it is refused.
    pub max_connections: usize,
    /// Longest time from accepting a connection to the first bytes of HTTP, TLS included (`--handshake-timeout`).
    pub handshake_timeout: Duration,
    /// Longest time without a byte in either direction (`--idle-timeout`). Pings are sent more often, so only a dead
    /// peer is silent for that long. HTTP/1 has no pings: only requests and answers keep such a connection open.
    pub idle_timeout: Duration,
    /// Longest time until a call without a deadline of its own is answered (`--default-deadline`). A stream counts as
    /// answered once it begins; its duration is not limited.
    pub default_deadline: Duration,
    /// Longest deadline that a client may set (`--max-deadline`); a longer one counts as this.
    pub max_deadline: Duration,
    /// Time between two pings (`--keepalive-interval`).
    pub keepalive_interval: Duration,
    /// Longest time from a ping to its answer (`--keepalive-timeout`).
    pub keepalive_timeout: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            max_message_bytes: 1024 * 1024,
            max_import_bytes: 16 * 1024 * 1024,
            max_streams: 128,
            max_connections: 256,
            handshake_timeout: Duration::from_secs(10),
            idle_timeout: Duration::from_secs(60),
            default_deadline: Duration::from_secs(30),
            max_deadline: Duration::from_secs(600),
            keepalive_interval: Duration::from_secs(20),
            keepalive_timeout: Duration::from_secs(10),
        }
    }
}
