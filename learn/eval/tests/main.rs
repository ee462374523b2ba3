//! Tests of the crate through its public interface, in one program.

mod challenge;
mod following;
mod suite;
