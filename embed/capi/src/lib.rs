//! libsurefoot: policies, plans and worlds as a C library. `include/surefoot.h` is its documentation.
//!
//! [`exports`] has one function for each function of the header. It converts pointers ([`memory`]) and numbers
//! ([`checks`]), calls the safe Rust of [`agents`], [`locomotion`], [`graphs`], [`followers`] and [`worlds`], and
//! returns a status ([`error`]). [`abi`] has the structs that both sides share.
//!
//! This crate has no state besides its handles, and writes nothing. Only rehearsals have threads, which end with their
//! handle. It catches all panics.

#![warn(clippy::undocumented_unsafe_blocks)]

pub mod abi;
mod agents;
mod checks;
mod error;
#[expect(unsafe_code, reason = "exported symbols, and arguments that are pointers: docs/adr/0034-c-library.md")]
pub mod exports;
mod followers;
mod graphs;
mod locomotion;
#[expect(unsafe_code, reason = "pointers become references here and nowhere else: docs/adr/0034-c-library.md")]
mod memory;
mod worlds;

pub use agents::{Agents, Policy};
pub use followers::{Follower, Rehearsals};
pub use graphs::Graph;
pub use worlds::{Map, Snapshot, World};
