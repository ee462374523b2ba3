//! Tests of the crate through its public interface, in one program.

mod agents;
mod header;
mod plans;
mod rehearsals;
mod stage;
mod worlds;
