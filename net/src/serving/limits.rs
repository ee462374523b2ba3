//! What peers may take from an endpoint.

use std::time::Duration;

/// Largest message that a service sends and that clients should take.
pub const MAX_MESSAGE_BYTES: usize = 16 * 1024 * 1024;

/// Bounds of one endpoint; a peer beyond one of them is refused or cut off, the others go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Largest request message, bytes (`--max-message-bytes`).
    pub max_message_bytes: usize,
    /// Largest request message of services that take whole levels, bytes (`--max-import-bytes`).
    pub max_import_bytes: usize,
    /// Streams that one connection may have open (`--max-streams`); further ones wait at the client.
    pub max_streams: u32,
    /// Connections at a time (`--max-connections`); a further one is closed at once and counted.
    pub max_connections: usize,
    /// From accepting a connection to the first bytes of HTTP, TLS included (`--handshake-timeout`).
    pub handshake_timeout: Duration,
    /// Longest time without a byte in either direction (`--idle-timeout`). Pings go both ways more often than that,
    /// so only a dead peer is silent that long; HTTP/1, which has no pings, is kept by what is sent to it.
    pub idle_timeout: Duration,
    /// Longest time until a call without `grpc-timeout` is answered (`--default-deadline`). A stream is answered once it
    /// begins; how long it then lasts is not bounded.
    pub default_deadline: Duration,
    /// Between two pings (`--keepalive-interval`).
    pub keepalive_interval: Duration,
    /// From a ping to its answer (`--keepalive-timeout`).
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
            keepalive_interval: Duration::from_secs(20),
            keepalive_timeout: Duration::from_secs(10),
        }
    }
}
