//! What several servers and planners share: a record in PostgreSQL, blobs in an object store.
//!
//! The crate is empty without its feature `service`.
#![cfg(feature = "service")]

pub mod blobs;
pub mod error;
pub mod member;
pub mod record;
