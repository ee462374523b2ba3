//! What all endpoints share: accepting and opening connections, access control, statuses, and the levels that clients import.
//!
//! [`serving`] is the server's side of a connection, [`client`] the other end, [`replicas`] that of a service with several addresses. [`status`] makes `google.rpc` details, [`paging`]
//! cuts lists into pages, [`reader`] cuts off readers that do not read, [`idempotency`] lets calls be repeated, [`durable`] writes files that survive a crash, [`memory`] is the budget that large requests are paid from, [`levels`] keeps imported levels and answers `MapService`. No world
//! is stepped and no graph is built here.

pub mod client;
pub mod durable;
pub mod idempotency;
pub mod levels;
pub mod memory;
pub mod paging;
pub mod reader;
pub mod replicas;
pub mod secret;
pub mod serving;
pub mod status;
