//! Tests of the crate through its public interface, in one program.

mod build;
mod chase;
mod crowd;
mod edits;
mod env;
mod gaits;
mod leaps;
mod motion;
mod moves;
mod rehearsals;
mod reviews;
mod shapes;
mod stage;
