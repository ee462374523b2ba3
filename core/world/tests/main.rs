//! Tests of the crate through its public interface, in one program.

mod character;
mod crates;
mod determinism;
mod exchange;
mod geometry;
mod hostile;
mod maps;
mod movers;
mod others;
mod pieces;
mod players;
mod recordings;
