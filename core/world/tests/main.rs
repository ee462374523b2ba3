//! Tests of the crate through its public interface, in one program.

mod acrobatics;
mod around;
mod arrivals;
mod character;
mod climbing;
mod crates;
mod crouching;
mod dashes;
mod determinism;
mod geometry;
mod hostile;
mod locomotion;
mod movers;
mod others;
mod passing;
mod pieces;
mod players;
mod recordings;
mod stage;
mod surveys;
mod swimming;
