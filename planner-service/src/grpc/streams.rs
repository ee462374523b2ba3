//! Streams to readers: where a build stands, and how a graph changes.

use crate::error::PlannerError;
use crate::jobs::Job;
use crate::planner::Planner;
use crate::wire::{revision_to_wire, summary_to_wire};
use std::sync::atomic::Ordering;
use std::time::Duration;
use surefoot_net::serving::{Shutdown, going_away};
use surefoot_proto::planner::v1 as wire;
use tokio::sync::{mpsc, watch};
use tonic::Status;

/// How often a build's progress is sent.
const PROGRESS_PERIOD: Duration = Duration::from_millis(250);
/// Those who watch a graph that does not change are told so after this: well before their connection counts as silent.
const REMIND_AFTER: Duration = Duration::from_secs(20);

/// Tells one reader what a graph is like now, and again whenever it has changed.
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
                summary: Some(summary_to_wire(&hosted)),
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

/// Streams a build's progress, then its end.
pub async fn report(mut job: Job, queue: mpsc::Sender<Result<wire::BuildGraphResponse, Status>>, shutdown: Shutdown) {
    let progress = job.progress();
    let stopping = shutdown.wait();
    tokio::pin!(stopping);
    loop {
        let finished = tokio::select! {
            finished = job.finished() => Some(finished.map_err(Status::from)),
            () = tokio::time::sleep(PROGRESS_PERIOD) => None,
            () = &mut stopping => Some(Err(going_away())),
            () = queue.closed() => return,
        };
        let (probes_done, probes_total) =
            (progress.done.load(Ordering::Relaxed), progress.total.load(Ordering::Relaxed));
        let (last, message) = match finished {
            None => {
                let stage = if probes_total == 0 { "vertices" } else { "probe" };
                (
                    false,
                    Ok(wire::BuildGraphResponse {
                        stage: stage.to_owned(),
                        probes_done,
                        probes_total,
                        ..Default::default()
                    }),
                )
            }
            Some(result) => {
                let done = result.map(|ready| wire::BuildGraphResponse {
                    graph_id: ready.origin.id.to_string(),
                    stage: "done".to_owned(),
                    probes_done,
                    probes_total,
                    summary: Some(summary_to_wire(&ready)),
                });
                (true, done)
            }
        };
        if queue.send(message).await.is_err() || last {
            return;
        }
    }
}
