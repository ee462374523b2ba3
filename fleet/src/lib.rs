//! What several servers and planners share: the [`record`] in PostgreSQL, [`blobs`] in an object store, [`work`] in NATS JetStream.
//!
//! The crate is empty without its feature `service`.
#![cfg(feature = "service")]

pub mod blobs;
pub mod error;
pub mod member;
pub mod record;
pub mod work;
