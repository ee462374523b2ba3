//! Who runs the probes of builds: this process by itself ([`Embedded`], the default), or others that share its work.

use std::fmt;
use surefoot_net::levels::MapSource;
use surefoot_planner::probe::ProbeExecutor;
use surefoot_rollout::probe::{InProcess, ProbeContext};

/// Runs the probes of builds.
pub trait Provers: fmt::Debug + Send + Sync {
    /// Prepares the probes of one build. It may wait: call this from a thread that may block.
    fn enlist(&self, work: ProbeWork) -> Box<dyn BuildProbes>;

    /// Further metrics of the planner, in Prometheus text format.
    fn metrics(&self) -> String {
        String::new()
    }
}

/// The probes of one build: what they run with, and where that comes from.
#[derive(Debug, Clone)]
pub struct ProbeWork {
    /// Source of the map, for those who have to make it.
    pub source: MapSource,
    /// Map, character and policy.
    pub context: ProbeContext,
    /// Number of threads of this process.
    pub thread_count: usize,
}

/// Runs the probes of one build. Whoever runs them, the outcomes are the same.
pub trait BuildProbes: ProbeExecutor {
    /// Why the build cannot go on, once the executor has given up without being cancelled.
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
