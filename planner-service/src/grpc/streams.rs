//! Streams to readers: where a build stands, and how a graph changes.

use crate::error::PlannerError;
use crate::jobs::Job;
use crate::planner::Planner;
use crate::wire::{build_to_wire, revision_to_wire, summary_to_wire};
use std::sync::Arc;
use std::time::Duration;
use surefoot_net::serving::{Shutdown, going_away};
use surefoot_proto::planner::v1 as wire;
use tokio::sync::{mpsc, watch};
use tonic::Status;

/// How often a build's progress is sent.
const PROGRESS_PERIOD: Duration = Duration::from_millis(250);
/// Watchers of a graph that does not change get a message after this: well before their connection counts as silent.
const REMIND_AFTER: Duration = Duration::from_secs(20);

/// Sends one reader the state of a graph, at once and whenever it changes.
pub async fn tell_changes(
    planner: Planner,
    graph_id: String,
    mut changes: watch::Receiver<()>,
    queue: mpsc::Sender<Result<wire::WatchGraphResponse, Status>>,
) {
    let stopping = planner.shutdown().wait();
    tokio::pin!(stopping);
    changes.mark_changed();
    let end = loop {
        tokio::select! {
            changed = changes.changed() => if changed.is_err() {
                break PlannerError::Unloaded(graph_id.clone()).into();
            },
            () = tokio::time::sleep(REMIND_AFTER) => {}
            () = &mut stopping => break going_away(),
            () = queue.closed() => return,
        }
        let told = match planner.find(&graph_id) {
            Ok(hosted) => wire::WatchGraphResponse {
                summary: Some(summary_to_wire(&hosted.figures())),
                revision: revision_to_wire(hosted.revision()),
            },
            Err(error) => break error.into(),
        };
        tokio::select! {
            sent = queue.send(Ok(told)) => if sent.is_err() { return },
            () = &mut stopping => return,
        }
    };
    // A reader that does not read does not learn why its stream is over.
    let _ = queue.try_send(Err(end));
}

/// Streams a build's progress: each of its stages, counts in between, and its end.
pub async fn report(job: Arc<Job>, queue: mpsc::Sender<Result<wire::WatchBuildResponse, Status>>, shutdown: Shutdown) {
    let stopping = shutdown.wait();
    tokio::pin!(stopping);
    let mut shown = 0;
    loop {
        // Subscribed before it is read, so that no change is missed.
        let changes = job.changes();
        let stages = job.stages();
        let is_over = stages.last().is_some_and(|stage| stage.is_end());
        let news = &stages[shown..];
        // Without news there are counts.
        for &stage in if news.is_empty() { &stages[stages.len() - 1..] } else { news } {
            let message = wire::WatchBuildResponse { build: Some(build_to_wire(&job, stage)) };
            if queue.send(Ok(message)).await.is_err() {
                return;
            }
        }
        if is_over {
            return;
        }
        shown = stages.len();
        tokio::select! {
            () = changes => {}
            () = tokio::time::sleep(PROGRESS_PERIOD) => {}
            () = &mut stopping => {
                // A reader that does not read does not learn why its stream is over.
                let _ = queue.try_send(Err(going_away()));
                return;
            }
            () = queue.closed() => return,
        }
    }
}
