//! The planner service: graphs that are built, cached, edited and searched for clients over gRPC.
//!
//! [`planner`] is the service without a wire: [`hosted`] one graph in memory, [`builds`] how it gets there, [`layers`] how designers
//! change it. [`store`] keeps graphs and layers on disk. [`grpc`] decodes, calls and encodes, [`wire`] converts; nothing else knows a
//! wire type. Building and searching themselves are the pure library `surefoot-planner`.

pub mod builds;
mod config;
mod error;
pub mod grpc;
pub mod hosted;
pub mod jobs;
pub mod layers;
mod locks;
pub mod planner;
mod serve;
pub mod store;
pub mod wire;

pub use config::PlannerConfig;
pub use error::PlannerError;
pub use planner::Planner;
pub use serve::serve;
