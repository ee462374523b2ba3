//! Builds of graphs: one at a time on all cores, shared by all who ask for the same, cancelled when the last of them goes.

use super::hosted::{Hosted, Origin};
use super::{POISON, PlannerApi, or_nothing};
use crate::build::{BuildError, BuildSettings, Built, GraphId, Progress, build};
use crate::live::LiveEvidence;
use crate::probe::ProbeContext;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};
use surefoot_proto::maps::MapSource;
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::serving::{Shutdown, going_away};
use surefoot_proto::status;
use tokio::sync::{mpsc, watch};
use tonic::Status;
use tracing::{info, warn};

/// How often a build's progress is sent.
const PROGRESS_PERIOD: Duration = Duration::from_millis(250);

/// A build that is going on, or its end.
type JobState = Option<Result<Arc<Hosted>, Status>>;

/// A build that several requests may share.
#[derive(Debug, Clone)]
pub(super) struct Job {
    interest: Arc<Interest>,
    state: watch::Receiver<JobState>,
}

/// Held by all who wait for a build; when the last of them leaves, it is cancelled.
#[derive(Debug)]
struct Interest {
    progress: Arc<Progress>,
}

impl Drop for Interest {
    fn drop(&mut self) {
        self.progress.cancel.store(true, Ordering::Relaxed);
    }
}

/// A build that runs or waits for its turn.
#[derive(Debug)]
pub(super) struct Listed {
    interest: Weak<Interest>,
    pub progress: Arc<Progress>,
    state: watch::Receiver<JobState>,
}

impl PlannerApi {
    /// Joins the build of this graph, starting it if nobody has.
    pub(super) fn join(&self, source: MapSource, settings: BuildSettings) -> Result<Job, Status> {
        let key = format!("{} {settings:?}", source.key());
        let mut jobs = self.shared.jobs.lock().expect(POISON);
        if let Some(Listed { interest, state, .. }) = jobs.get(&key)
            && let Some(interest) = interest.upgrade()
        {
            return Ok(Job { interest, state: state.clone() });
        }
        let limit = self.shared.config.max_builds;
        if jobs.len() >= limit {
            return Err(status::exhausted(format!(
                "{limit} builds run or wait already, the most allowed (--max-builds)"
            )));
        }
        let (sender, state) = watch::channel(None);
        let progress = Arc::new(Progress::default());
        let interest = Arc::new(Interest { progress: progress.clone() });
        // One that everybody has left may still stand here: it is on its way out.
        let listed = Listed { interest: Arc::downgrade(&interest), progress: progress.clone(), state: state.clone() };
        jobs.insert(key.clone(), listed);
        let api = self.clone();
        tokio::spawn(async move {
            let result = api.run_build(source, settings, progress.clone()).await;
            let mut jobs = api.shared.jobs.lock().expect(POISON);
            if jobs.get(&key).is_some_and(|listed| Arc::ptr_eq(&listed.progress, &progress)) {
                jobs.remove(&key);
            }
            drop(jobs);
            sender.send_replace(Some(result));
        });
        let job = Job { interest, state };
        Ok(job)
    }

    async fn run_build(
        &self,
        source: MapSource,
        settings: BuildSettings,
        progress: Arc<Progress>,
    ) -> Result<Arc<Hosted>, Status> {
        let _turn = self.shared.turn.acquire().await.map_err(|_| going_away())?;
        if progress.cancel.load(Ordering::Relaxed) {
            return Err(BuildError::Cancelled.into());
        }
        let api = self.clone();
        let task = tokio::task::spawn_blocking(move || api.build_or_load(&source, &settings, &progress));
        task.await.map_err(|error| Status::internal(format!("the build failed: {error}")))?
    }

    fn build_or_load(
        &self,
        source: &MapSource,
        settings: &BuildSettings,
        progress: &Progress,
    ) -> Result<Arc<Hosted>, Status> {
        let map = source.map()?;
        let map_hash = map.hash().to_hex();
        let context = ProbeContext::new(map, self.shared.policy.clone());
        let id = GraphId::of(&context, settings);
        if let Some(ready) = self.recall(&id) {
            return Ok(ready);
        }
        let origin = Origin {
            id,
            source: source.clone(),
            settings: *settings,
            map_hash,
            policy: self.shared.policy.clone(),
            thread_count: self.shared.config.threads,
            table_limit: self.shared.config.table_vertices,
        };
        let store = &self.shared.store;
        let stored = store.get(&id).unwrap_or_else(|error| {
            warn!(%error, "the graph cache cannot be read: building instead");
            None
        });
        let cached = stored.is_some();
        let Built { graph, stats } = match stored {
            Some(built) => built,
            None => {
                let started = Instant::now();
                let built = build(&context, settings, self.shared.config.threads, progress)?;
                info!(%id, probes = built.stats.probes, edges = built.graph.edge_count(), seconds = started.elapsed().as_secs_f32(), "graph built");
                if let Err(error) = store.put(&id, &built) {
                    warn!(%error, "the graph is not cached");
                }
                built
            }
        };
        // No edit may come between reading the layers and listing the graph that they lie over.
        let _editing = self.shared.editing.blocking_lock();
        let live = if cached { or_nothing(store.live(&id)) } else { LiveEvidence::default() };
        let layers = or_nothing(store.layers(&origin.level()));
        let hosted = Arc::new(Hosted::new(origin, graph, stats, cached, live, layers));
        self.remember(hosted.clone());
        Ok(hosted)
    }
}

/// Streams a build's progress, then its end.
pub(super) async fn report(
    mut job: Job,
    queue: mpsc::Sender<Result<wire::BuildGraphResponse, Status>>,
    shutdown: Shutdown,
) {
    let progress = job.interest.progress.clone();
    let stopping = shutdown.wait();
    tokio::pin!(stopping);
    loop {
        let finished = tokio::select! {
            state = job.state.wait_for(Option::is_some) => Some(match state {
                Ok(state) => state.clone().expect("waited for it"),
                Err(_) => Err(Status::internal("the build was lost: ask again")),
            }),
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
                    summary: Some(ready.summary()),
                });
                (true, done)
            }
        };
        if queue.send(message).await.is_err() || last {
            return;
        }
    }
}
