//! Builds of graphs: one at a time on all cores, shared by all who ask for the same, cancelled when the last of them goes.

use crate::error::PlannerError;
use crate::hosted::{Hosted, Origin};
use crate::jobs::{Interest, Job, Listed};
use crate::locks::POISON;
use crate::planner::{Planner, or_nothing};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;
use surefoot_net::levels::MapSource;
use surefoot_planner::live::LiveEvidence;
use surefoot_planner::{BuildError, BuildSettings, Built, Progress};
use surefoot_rollout::graphs;
use surefoot_rollout::probe::ProbeContext;
use tokio::sync::watch;
use tracing::{info, warn};

impl Planner {
    /// Cancels all builds.
    pub(crate) fn cancel_builds(&self) {
        for job in self.shared.jobs.lock().expect(POISON).values() {
            job.progress.cancel.store(true, Ordering::Relaxed);
        }
    }

    /// Joins the build of this graph, starting it if nobody has.
    ///
    /// # Errors
    /// If too many builds run or wait.
    pub fn join(&self, source: MapSource, settings: BuildSettings) -> Result<Job, PlannerError> {
        let key = format!("{} {settings:?}", source.key());
        let mut jobs = self.shared.jobs.lock().expect(POISON);
        if let Some(Listed { interest, state, .. }) = jobs.get(&key)
            && let Some(interest) = interest.upgrade()
        {
            return Ok(Job { interest, state: state.clone() });
        }
        let limit = self.shared.config.max_builds;
        if jobs.len() >= limit {
            return Err(PlannerError::TooManyBuilds(limit));
        }
        let (sender, state) = watch::channel(None);
        let progress = Arc::new(Progress::default());
        let interest = Arc::new(Interest { progress: progress.clone() });
        // One that everybody has left may still stand here: it is on its way out.
        let listed = Listed { interest: Arc::downgrade(&interest), progress: progress.clone(), state: state.clone() };
        jobs.insert(key.clone(), listed);
        let planner = self.clone();
        tokio::spawn(async move {
            let result = planner.run_build(source, settings, progress.clone()).await;
            let mut jobs = planner.shared.jobs.lock().expect(POISON);
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
    ) -> Result<Arc<Hosted>, PlannerError> {
        let _turn = self.shared.turn.acquire().await.map_err(|_| PlannerError::ShuttingDown)?;
        if progress.cancel.load(Ordering::Relaxed) {
            return Err(BuildError::Cancelled.into());
        }
        let planner = self.clone();
        let task = tokio::task::spawn_blocking(move || planner.build_or_load(&source, &settings, &progress));
        task.await.map_err(PlannerError::lost("the build"))?
    }

    fn build_or_load(
        &self,
        source: &MapSource,
        settings: &BuildSettings,
        progress: &Progress,
    ) -> Result<Arc<Hosted>, PlannerError> {
        let map = source.map();
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
            warn!(%error, "the graph cache cannot be read: building instead");
            None
        });
        let cached = stored.is_some();
        let Built { graph, stats } = match stored {
            Some(built) => built,
            None => {
                let started = Instant::now();
                let built = graphs::build(&context, settings, self.shared.config.threads, progress)?;
                info!(%id, probes = built.stats.probes, edges = built.graph.edge_count(), seconds = started.elapsed().as_secs_f32(), "graph built");
                if let Err(error) = store.put(&id, &built) {
                    warn!(%error, "the graph is not cached");
                }
                built
            }
        };
        // No edit may come between reading the layers and listing the graph that they apply to.
        let _editing = self.shared.editing.blocking_lock();
        let live = if cached { or_nothing(store.live(&id)) } else { LiveEvidence::default() };
        let layers = or_nothing(store.layers(&origin.level()));
        let hosted = Arc::new(Hosted::new(origin, graph, stats, cached, live, layers));
        self.keep_ready(hosted.clone());
        Ok(hosted)
    }
}
