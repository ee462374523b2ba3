//! The planner service: builds, caches, edits and searches graphs for clients over gRPC.
//!
//! `planner` is the service without its transport; start reading there. `grpc` decodes requests, calls the planner
//! and encodes responses. `wire` converts types. Only these two, `peers`, `layers` and `serve` use wire types.
//! `hosted` is one graph in memory. `tactics` answers questions about many places. [`store`] keeps graphs on disk,
//! `layer_files` layers, and `receipts` the answers of calls that may be repeated. [`provers`] run the probes of
//! builds. [`replicas`] is the interface of a store that several planners share. Building and searching are in the
//! library `surefoot-planner`.

mod builds;
mod config;
mod error;
mod failpoint;
mod figures;
mod graphs;
mod grpc;
mod hosted;
mod jobs;
mod layer_files;
mod layers;
mod maps;
mod origin;
mod peers;
mod planner;
mod probe_cache;
pub mod provers;
mod receipts;
pub mod replicas;
mod reports;
mod revision;
mod serve;
pub mod store;
mod stores;
mod tactics;
mod wire;

pub use config::PlannerConfig;
pub use error::Failure;
pub use failpoint::failpoint;
pub use jobs::{BuildId, BuildPhase};
pub use serve::serve;
pub use stores::PlannerStores;
pub use wire::{edits_from_wire, layer_from_wire, layer_to_wire, settings_from_wire};
