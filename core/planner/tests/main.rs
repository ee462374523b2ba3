//! Tests of the crate through its public interface, in one program.

mod assets;
mod berths;
mod bounds;
mod build;
mod search;
