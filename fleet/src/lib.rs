//! What several servers and planners share: the [`record`] in PostgreSQL, [`blobs`] in an object store. [`planners`] has what planners
//! share.
//!
//! The crate is empty without its feature `service`.
#![cfg(feature = "service")]

pub mod blobs;
pub mod error;
pub mod member;
pub mod planners;
pub mod record;
