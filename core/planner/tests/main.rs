//! Tests of the crate through its public interface, in one program.

mod assets;
mod bounds;
mod build;
mod candidates;
mod links;
mod many;
mod places;
mod ride_stops;
mod search;
