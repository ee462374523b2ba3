//! Response streams: the progress of a build, and the changes of a graph.

use crate::error::PlannerError;
use crate::jobs::Job;
use crate::planner::Planner;
use crate::wire::{build_to_wire, revision_to_wire, summary_to_wire};
use std::sync::Arc;
use std::time::Duration;
use surefoot_net::serving::{Shutdown, shutting_down};
use surefoot_planner::GraphId;
use surefoot_proto::planner::v1 as wire;
use tokio::sync::{mpsc, watch};
use tonic::Status;

/// Period at which the progress of a build is sent.
const PROGRESS_PERIOD: Duration = Duration::from_millis(250);
/// Period of messages about an unchanged graph. A silent connection would be closed.
const REPEAT_PERIOD: Duration = Duration::from_secs(20);

/// Sends one reader the state of a graph at once, whenever it changes, and every [`REPEAT_PERIOD`].
pub async fn stream_changes(
    planner: Planner,
    id: GraphId,
    mut changes: watch::Receiver<()>,
    queue: mpsc::Sender<Result<wire::WatchGraphResponse, Status>>,
) {
    let stopping = planner.shutdown().wait();
    tokio::pin!(stopping);
    changes.mark_changed();
    let end = loop {
        tokio::select! {
            changed = changes.changed() => if changed.is_err() {
                break PlannerError::Unloaded(id.to_string()).into();
            },
            () = tokio::time::sleep(REPEAT_PERIOD) => {}
            () = &mut stopping => break shutting_down(),
            () = queue.closed() => return,
        }
        let Some(hosted) = planner.graphs.peek(&id) else {
            break PlannerError::Unloaded(id.to_string()).into();
        };
        let message = wire::WatchGraphResponse {
            summary: Some(summary_to_wire(&hosted.figures())),
            revision: revision_to_wire(hosted.revision()),
        };
        tokio::select! {
            sent = queue.send(Ok(message)) => if sent.is_err() { return },
            () = &mut stopping => return,
        }
    };
    // If the queue is full, the reader does not learn why the stream has ended.
    let _ = queue.try_send(Err(end));
}

/// Sends one reader the progress of a build: every phase, counts in between, and the end.
pub async fn stream_progress(
    job: Arc<Job>,
    queue: mpsc::Sender<Result<wire::WatchBuildResponse, Status>>,
    shutdown: Shutdown,
) {
    let stopping = shutdown.wait();
    tokio::pin!(stopping);
    let mut sent_count = 0;
    loop {
        // Subscribe before reading the phases, so that no change is missed.
        let changes = job.changes();
        let phases = job.phases();
        let is_over = phases.last().is_some_and(|phase| phase.is_end());
        let new_phases = &phases[sent_count..];
        // Without a new phase, repeat the current one with its latest counts.
        for &phase in if new_phases.is_empty() { &phases[phases.len() - 1..] } else { new_phases } {
            let message = wire::WatchBuildResponse { build: Some(build_to_wire(&job, phase)) };
            if queue.send(Ok(message)).await.is_err() {
                return;
            }
        }
        if is_over {
            return;
        }
        sent_count = phases.len();
        tokio::select! {
            () = changes => {}
            () = tokio::time::sleep(PROGRESS_PERIOD) => {}
            () = &mut stopping => {
                // If the queue is full, the reader does not learn why the stream has ended.
                let _ = queue.try_send(Err(shutting_down()));
                return;
            }
            () = queue.closed() => return,
        }
    }
}
