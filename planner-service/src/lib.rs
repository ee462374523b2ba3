//! The planner service: builds, caches, edits and searches graphs for clients over gRPC.
//!
//! [`planner`] is the service without its transport: [`hosted`] is one graph in memory, [`builds`] makes graphs, and
//! [`layers`] applies designers' changes. [`store`] keeps graphs on disk, `layer_files` layers, `receipts` the answers of calls that may be repeated, and [`provers`] run the probes of builds.
//! [`grpc`] decodes requests, calls the planner and encodes responses; [`replicas`] is what planners that share a store agree on:
//! `operations` has their builds, `sharing` what they change. [`wire`] converts types. Only these two and `serve` use wire types. Building
//! and searching
//! are in the pure library `surefoot-planner`.

pub mod builds;
mod config;
mod error;
mod failpoint;
pub mod figures;
pub mod grpc;
pub mod hosted;
pub mod jobs;
mod layer_files;
pub mod layers;
mod locks;
mod operations;
pub mod origin;
pub mod planner;
mod probe_cache;
pub mod provers;
mod receipts;
pub mod replicas;
mod serve;
mod sharing;
pub mod store;
pub mod wire;

pub use config::PlannerConfig;
pub use error::{Failure, PlannerError};
pub use failpoint::failpoint;
pub use planner::{Planner, PlannerStores};
pub use serve::serve;
