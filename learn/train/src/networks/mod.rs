//! The networks of actor and critics, in burn.
//!
//! These are what is trained, and the reference for inference without burn (`surefoot_policy::CpuActor`); a test
//! compares the two on every shipped model. On the CPU, layers use the fused operations of [`cpu`]. Start at
//! [`ActorNetwork`].

mod actor;
pub mod cpu;
pub mod dense;
mod inference;
pub mod lstm;
mod record;
pub mod state;
pub mod trunk;

pub use actor::{ActionDistribution, ActorNetwork};
pub use inference::with_burn;
pub use record::{load_module, module_bytes};
