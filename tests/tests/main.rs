//! Tests of the whole system over real sockets, in one program.

mod architecture;
mod arrivals;
mod bad_input;
mod bodies;
mod clients;
mod coordinates;
mod crowds;
#[path = "../../tools/fuzz/src/lib.rs"]
mod decoders;
mod details;
mod editing;
mod edits;
mod elsewhere;
mod events;
mod games;
mod golden;
mod imports;
mod journeys;
mod json;
mod limits;
mod living;
mod manifests;
mod motion;
mod notices;
mod operations;
mod operators;
mod planning;
mod replicas;
mod round_trips;
mod security;
mod shared;
mod studio;
mod targets;
mod trust;
mod untrusted;
mod void;
