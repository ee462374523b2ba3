//! Tests of the crate through its public interface, in one program.

mod learning;
mod replay;
mod toy;
