//! Who runs the probes of builds: this process by itself ([`Embedded`], the default), or others that share its work.

use std::fmt;
use surefoot_net::levels::MapSource;
use surefoot_planner::probe::{Outcome, ProbeExecutor, ProbeWatch, Trial};
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
    fn failure(&self) -> Option<String>;
}

/// Runs all probes in this process.
#[derive(Debug, Clone, Copy, Default)]
pub struct Embedded;

impl Provers for Embedded {
    fn enlist(&self, work: ProbeWork) -> Box<dyn BuildProbes> {
        Box::new(Own(InProcess { context: work.context, thread_count: work.thread_count }))
    }
}

struct Own(InProcess);

impl ProbeExecutor for Own {
    fn run(&self, trials: &[Trial], seed: u64, watch: &dyn ProbeWatch) -> Option<Vec<Outcome>> {
        self.0.run(trials, seed, watch)
    }
}

impl BuildProbes for Own {
    fn failure(&self) -> Option<String> {
        None
    }
}
