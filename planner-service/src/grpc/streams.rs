//! Response streams: the progress of a build, and the changes of a graph.

use crate::error::PlannerError;
use crate::hosted::Hosted;
use crate::jobs::{Job, State};
use crate::planner::Planner;
use crate::wire::{build_to_wire, revision_to_wire, summary_to_wire};
use std::sync::Arc;
use std::time::Duration;
use surefoot_net::reader::Source;
use surefoot_planner::GraphId;
use surefoot_proto::planner::v1 as wire;
use tokio::sync::watch;
use tokio::time::timeout;
use tonic::Status;

/// Period at which the progress of a build is sent.
const PROGRESS_PERIOD: Duration = Duration::from_millis(250);
/// Period of messages about an unchanged graph. A silent connection would be closed.
const REPEAT_PERIOD: Duration = Duration::from_secs(20);

/// The state of a graph: at once, whenever it changes, and every [`REPEAT_PERIOD`].
pub struct GraphChanges {
    planner: Planner,
    id: GraphId,
    changes: watch::Receiver<()>,
}

impl GraphChanges {
    pub fn new(planner: Planner, hosted: &Hosted) -> Self {
        let mut changes = hosted.changes();
        changes.mark_changed();
        Self { planner, id: hosted.origin.id, changes }
    }
}

impl Source for GraphChanges {
    type Message = wire::WatchGraphResponse;

    async fn next(&mut self) -> Option<Result<Vec<Self::Message>, Status>> {
        // Closed when the graph is dropped.
        let is_closed = matches!(timeout(REPEAT_PERIOD, self.changes.changed()).await, Ok(Err(_)));
        let Some(hosted) = self.planner.graphs.peek(&self.id).filter(|_| !is_closed) else {
            return Some(Err(PlannerError::Unloaded(self.id.to_string()).into()));
        };
        Some(Ok(vec![wire::WatchGraphResponse {
            summary: Some(summary_to_wire(&hosted.figures())),
            revision: revision_to_wire(hosted.revision()),
        }]))
    }
}

/// The progress of a build: every phase, counts in between, and the end.
pub struct BuildProgress {
    job: Arc<Job>,
    changes: watch::Receiver<State>,
    /// Number of phases that were sent.
    sent_count: usize,
    is_over: bool,
}

impl BuildProgress {
    pub fn new(job: Arc<Job>) -> Self {
        Self { changes: job.changes(), job, sent_count: 0, is_over: false }
    }
}

impl Source for BuildProgress {
    type Message = wire::WatchBuildResponse;

    async fn next(&mut self) -> Option<Result<Vec<Self::Message>, Status>> {
        if self.is_over {
            return None;
        }
        if self.sent_count > 0 {
            // The job lives as long as this.
            let _ = timeout(PROGRESS_PERIOD, self.changes.changed()).await;
        }
        let phases = self.job.phases();
        self.is_over = phases.last().is_some_and(|phase| phase.is_end());
        // Without a new phase, repeat the current one with its latest counts.
        let new_phases = &phases[self.sent_count.min(phases.len() - 1)..];
        self.sent_count = phases.len();
        let message = |&phase| wire::WatchBuildResponse { build: Some(build_to_wire(&self.job, phase)) };
        Some(Ok(new_phases.iter().map(message).collect()))
    }
}
