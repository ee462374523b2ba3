//! The planner service: builds, caches, edits and searches graphs for clients over gRPC.
//!
//! [`planner`] is the service without its transport: [`hosted`] is one graph in memory, [`builds`] makes graphs, and
//! [`layers`] applies designers' changes. [`store`] keeps graphs on disk, `layer_files` layers, and [`provers`] run the probes of builds. [`grpc`] decodes requests, calls the
//! planner and encodes responses; [`wire`] converts types. Only these two and `serve` use wire types. Building and searching
//! are in the pure library `surefoot-planner`.

pub mod builds;
mod config;
mod error;
pub mod grpc;
pub mod hosted;
pub mod jobs;
mod layer_files;
pub mod layers;
mod locks;
pub mod origin;
pub mod planner;
mod proofs;
pub mod provers;
mod serve;
pub mod store;
pub mod wire;

pub use config::PlannerConfig;
pub use error::PlannerError;
pub use planner::Planner;
pub use serve::serve;
