//! Tests of the crate through its public interface, in one program.

mod checkpoints;
mod exchange;
mod flat;
mod layers;
mod lstm;
