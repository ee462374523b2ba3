//! What all endpoints share: accepting and opening connections, access control, statuses, and imported levels.
//!
//! [`serving`] is the server's side of a connection, [`client`] the client's, [`replicas`] the client's side of a
//! service with several addresses. [`status`] adds `google.rpc` details, [`paging`] cuts lists into pages, [`reader`]
//! streams to readers and cuts off those that do not read, [`idempotency`] lets calls be repeated, [`durable`] writes
//! files that survive a crash, [`memory`] is the budget for large requests, [`metrics`] renders figures,
//! [`levels`] keeps imported levels and implements `MapService`. No world is stepped and no graph is built here.

pub mod client;
pub mod durable;
pub mod idempotency;
pub mod levels;
pub mod memory;
pub mod metrics;
pub mod paging;
pub mod reader;
pub mod replicas;
pub mod secret;
pub mod serving;
pub mod status;
