//! Builds of graphs: one at a time on all cores; requests for the same graph share a build.

use crate::error::PlannerError;
use crate::hosted::{Hosted, Origin};
use crate::jobs::{Job, Jobs, Made, Stage};
use crate::planner::{Planner, or_empty};
use std::sync::Arc;
use std::time::Instant;
use surefoot_net::levels::MapSource;
use surefoot_planner::live::LiveEvidence;
use surefoot_planner::{BuildError, BuildSettings, Built};
use surefoot_rollout::graphs;
use surefoot_rollout::probe::ProbeContext;
use tracing::{info, warn};

impl Planner {
    /// Returns the builds of the service.
    pub fn jobs(&self) -> &Jobs {
        &self.shared.jobs
    }

    /// Cancels all builds that are running or waiting.
    pub(crate) fn cancel_builds(&self) {
        self.shared.jobs.all().iter().for_each(|job| job.cancel());
    }

    /// Starts the build of a graph, or returns the build of the same graph that is already running or waiting.
    ///
    /// # Errors
    /// If too many builds are running or waiting.
    pub fn start_build(&self, source: MapSource, settings: BuildSettings) -> Result<Arc<Job>, PlannerError> {
        let (job, is_new) = self.shared.jobs.find_or_add(source, settings, self.shared.config.max_builds)?;
        if is_new {
            let (planner, job) = (self.clone(), job.clone());
            tokio::spawn(async move {
                let end = planner.run_build(job.clone()).await;
                job.finish(end.map(|hosted| Made { graph: hosted.origin.id, figures: hosted.figures() }));
            });
        }
        Ok(job)
    }

    async fn run_build(&self, job: Arc<Job>) -> Result<Arc<Hosted>, PlannerError> {
        let _permit = tokio::select! {
            permit = self.shared.build_slot.acquire() => permit.map_err(|_| PlannerError::ShuttingDown)?,
            () = job.cancelled() => return Err(BuildError::Cancelled.into()),
        };
        let planner = self.clone();
        let task = tokio::task::spawn_blocking(move || planner.build_or_load(&job));
        task.await.map_err(PlannerError::lost("the build"))?
    }

    fn build_or_load(&self, job: &Job) -> Result<Arc<Hosted>, PlannerError> {
        let Job { source, settings, progress, .. } = job;
        job.enter(Stage::Map);
        let map = source.map();
        if job.is_cancelled() {
            return Err(BuildError::Cancelled.into());
        }
        let map_hash = map.hash().to_hex();
        let context = ProbeContext::new(map, self.shared.policy.clone());
        let id = graphs::id_of(&context, settings);
        if let Some(ready) = self.note_use(&id) {
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
            warn!(%error, "graph cache cannot be read; building the graph instead");
            None
        });
        let cached = stored.is_some();
        let Built { graph, stats } = match stored {
            Some(built) => {
                job.enter(Stage::Index);
                built
            }
            None => {
                job.enter(Stage::Vertices);
                let started = Instant::now();
                let built = graphs::build(&context, settings, self.shared.config.threads, progress)?;
                info!(%id, probes = built.stats.probes, edges = built.graph.edge_count(), seconds = started.elapsed().as_secs_f32(), "graph built");
                job.enter(Stage::Index);
                if let Err(error) = store.put(&id, &built) {
                    warn!(%error, "graph could not be stored in the cache");
                }
                built
            }
        };
        // Lock out edits until the graph is in memory: they would miss it after its layers have been read.
        let _editing = self.shared.editing.blocking_lock();
        let live = if cached { or_empty(store.live(&id)) } else { LiveEvidence::default() };
        let layers = or_empty(store.layers(&origin.level()));
        let hosted = Arc::new(Hosted::new(origin, graph, stats, cached, live, layers));
        self.keep_ready(hosted.clone());
        Ok(hosted)
    }
}
