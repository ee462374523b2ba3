//! Tests of the crate through its public interface, in one program.

mod cpu_actor;
mod layers;
mod learning;
mod losses;
mod lstm;
mod replay;
mod toy;
