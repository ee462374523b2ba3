//! Tests of the crate through its public interface, in one program.

mod hosted;
mod journal;
mod looking;
mod shares;
mod simulation;
mod stuck;
