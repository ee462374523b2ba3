//! What several servers and planners share: a PostgreSQL database, blobs in an object store, work in NATS JetStream.
//! `planners` has what planners share, `worlds` what servers share, `work` how jobs are sent and done.
//!
//! The crate is empty without its feature `service`.
#![cfg(feature = "service")]

pub mod blobs;
pub mod database;
pub mod error;
pub mod membership;
mod notifications;
pub mod planners;
mod schema;
pub mod work;
pub mod worlds;
