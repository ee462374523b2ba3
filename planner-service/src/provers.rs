//! What runs the probes of builds: this process alone ([`Embedded`], the default), or processes that share its work.

use std::fmt;
use surefoot_net::levels::MapSource;
use surefoot_planner::probe::ProbeExecutor;
use surefoot_rollout::probe::{InProcess, ProbeContext};

/// Runs the probes of builds.
pub trait Provers: fmt::Debug + Send + Sync {
    /// Prepares the probes of one build. Call this from a thread that may block.
    fn enlist(&self, work: ProbeWork) -> Box<dyn BuildProbes>;

    /// Further metrics of the planner, in Prometheus text format.
    fn metrics(&self) -> String {
        String::new()
    }
}

/// The inputs of the probes of one build.
#[derive(Debug, Clone)]
pub struct ProbeWork {
    /// Source of the map, for processes that have to generate it.
    pub source: MapSource,
    /// Map, character and policy.
    pub context: ProbeContext,
    /// Number of threads of this process.
    pub thread_count: usize,
}

/// Runs the probes of one build. Outcomes do not depend on which process runs them.
pub trait BuildProbes: ProbeExecutor {
    /// Why the build cannot continue, once the executor has given up without being cancelled.
    fn failure(&self) -> Option<String> {
        None
    }
}

/// Runs all probes in this process.
#[derive(Debug, Clone, Copy, Default)]
pub struct Embedded;

impl Provers for Embedded {
    fn enlist(&self, work: ProbeWork) -> Box<dyn BuildProbes> {
        Box::new(InProcess { context: work.context, thread_count: work.thread_count })
    }
}

impl BuildProbes for InProcess {}
