//! What every endpoint shares: how connections are accepted and made, who may call, which statuses are sent, and the levels
//! that clients import.
//!
//! [`serving`] is the server's side of a connection, [`client`] the other end. [`status`] makes `google.rpc` details,
//! [`levels`] keeps imported levels and answers `MapService`. No world is stepped and no graph is built here.

pub mod client;
pub mod levels;
pub mod secret;
pub mod serving;
pub mod status;
