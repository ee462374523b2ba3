//! What all endpoints share: accepting and opening connections, access control, statuses, and the levels that clients import.
//!
//! [`serving`] is the server's side of a connection, [`client`] the client's. [`status`] builds statuses with `google.rpc`
//! details, [`paging`] cuts lists into pages, [`idempotency`] makes calls repeatable, [`levels`] keeps imported levels and
//! implements `MapService`. This crate neither steps worlds nor builds graphs.

pub mod client;
pub mod idempotency;
pub mod levels;
pub mod paging;
pub mod secret;
pub mod serving;
pub mod status;
