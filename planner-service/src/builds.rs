//! Builds of graphs: one at a time on all cores; requests for the same graph share a build. Graphs that are in memory or in the
//! store do not wait for a build that is running.

use crate::error::PlannerError;
use crate::hosted::{Hosted, Prepared};
use crate::jobs::{BuildResult, Job, Jobs, Stage};
use crate::origin::Origin;
use crate::planner::Planner;
use crate::proofs::Proofs;
use std::sync::Arc;
use std::time::Instant;
use surefoot_net::levels::MapSource;
use surefoot_planner::live::LiveEvidence;
use surefoot_planner::{BuildError, BuildSettings, Built, GraphId};
use surefoot_rollout::graphs;
use surefoot_rollout::probe::ProbeContext;
use surefoot_world::CharacterProfile;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
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
    pub fn start_build(
        &self,
        source: MapSource,
        body: CharacterProfile,
        settings: BuildSettings,
    ) -> Result<Arc<Job>, PlannerError> {
        let (job, is_new) = self.shared.jobs.find_or_add(source, body, settings, self.shared.config.max_builds)?;
        if is_new {
            let (planner, job) = (self.clone(), job.clone());
            tokio::spawn(async move {
                let end = planner.run_build(job.clone()).await;
                job.finish(end.map(|hosted| BuildResult { graph: hosted.origin.id, figures: hosted.figures() }));
            });
        }
        Ok(job)
    }

    async fn run_build(&self, job: Arc<Job>) -> Result<Arc<Hosted>, PlannerError> {
        if let Some(hosted) = self.find_ready(&job) {
            return Ok(hosted);
        }
        let slot = match self.shared.build_slot.clone().try_acquire_owned() {
            Ok(slot) => slot,
            Err(_) => {
                if let Some(hosted) = self.load_beside_build(&job).await? {
                    return Ok(hosted);
                }
                permit_for(&job, &self.shared.build_slot).await?
            }
        };
        let planner = self.clone();
        let task = tokio::task::spawn_blocking(move || planner.load_or_build(&job, slot));
        task.await.map_err(PlannerError::lost("the build"))?
    }

    /// Returns the graph of a job if it is in memory and may be used for plans, and marks it as used.
    fn find_ready(&self, job: &Job) -> Option<Arc<Hosted>> {
        let source = job.source.key();
        let is_same = |hosted: &Arc<Hosted>| {
            let Origin { settings, body, source: of, .. } = &hosted.origin;
            *settings == job.settings && *body == job.body && of.key() == source
        };
        let found = self.all_ready().into_iter().find(is_same).filter(|hosted| hosted.check_layers().is_ok())?;
        self.note_use(&found.origin.id);
        Some(found)
    }

    /// Loads the graph of a job from the store, if it is there, while a build is running. The job stays queued meanwhile.
    async fn load_beside_build(&self, job: &Arc<Job>) -> Result<Option<Arc<Hosted>>, PlannerError> {
        let permit = permit_for(job, &self.shared.loading).await?;
        let (planner, job) = (self.clone(), job.clone());
        let task = tokio::task::spawn_blocking(move || {
            let _permit = permit;
            let wanted = Wanted::new(&planner, &job);
            planner.load(&wanted, || job.enter(Stage::Map))
        });
        task.await.map_err(PlannerError::lost("the load"))?
    }

    /// Loads the graph of a job from the store or builds it. Only building keeps the slot.
    fn load_or_build(&self, job: &Job, slot: OwnedSemaphorePermit) -> Result<Arc<Hosted>, PlannerError> {
        job.enter(Stage::Map);
        let wanted = Wanted::new(self, job);
        let mut slot = Some(slot);
        if let Some(loaded) = self.load(&wanted, || drop(slot.take()))? {
            return Ok(loaded);
        }
        job.enter(Stage::Vertices);
        let started = Instant::now();
        let threads = self.shared.config.threads;
        let built = graphs::build(&wanted.context, &job.settings, threads, &job.progress)?;
        info!(id = %wanted.id, probes = built.stats.probes, edges = built.graph.edge_count(), seconds = started.elapsed().as_secs_f32(), "graph built");
        job.enter(Stage::Index);
        if let Err(error) = self.shared.store.put(&wanted.id, &built) {
            warn!(%error, "graph could not be stored in the cache");
        }
        self.host(&wanted, built, LiveEvidence::default(), false)
    }

    /// Returns a graph from memory or else from the store; `None` if it is in neither. Calls `found` before a stored graph is loaded.
    fn load(&self, wanted: &Wanted<'_>, found: impl FnOnce()) -> Result<Option<Arc<Hosted>>, PlannerError> {
        let Wanted { job, id, .. } = wanted;
        if job.is_cancelled() {
            return Err(BuildError::Cancelled.into());
        }
        if let Some(ready) = self.note_use(id) {
            if ready.check_layers().is_err() {
                let prepare = |layers| ready.prepare(layers, &job.progress);
                let (level, lock) = (ready.level(), self.shared.level_locks.of(&ready.level()));
                let (prepared, _held) = self.with_layers(&lock, &level, prepare).ok_or(BuildError::Cancelled)?;
                ready.apply(prepared);
            }
            return Ok(Some(ready));
        }
        let store = &self.shared.store;
        let stored = store.get(id).unwrap_or_else(|error| {
            warn!(%error, "graph cache cannot be read; building the graph instead");
            None
        });
        let Some(built) = stored else { return Ok(None) };
        found();
        job.enter(Stage::Index);
        let live = store.live(id).unwrap_or_else(|error| {
            warn!(%error, "live evidence cannot be read; the graph begins without it");
            LiveEvidence::default()
        });
        self.host(wanted, built, live, true).map(Some)
    }

    /// Applies the level's layers to a graph and keeps it in memory. If the layers cannot be read, the graph refuses plans.
    fn host(
        &self,
        Wanted { job, origin, .. }: &Wanted<'_>,
        built: Built,
        live: LiveEvidence,
        cached: bool,
    ) -> Result<Arc<Hosted>, PlannerError> {
        let proofs = Proofs::default();
        let level = origin.level();
        let lock = self.shared.level_locks.of(&level);
        let prepare = |layers| Prepared::new(origin, &built.graph, &proofs, layers, &job.progress);
        // Held until the graph is in memory, where an edit that comes later finds it.
        let (prepared, _held) = self.with_layers(&lock, &level, prepare).ok_or(BuildError::Cancelled)?;
        let hosted = Arc::new(Hosted::new(origin.clone(), built, cached, live, proofs, prepared));
        self.keep_ready(hosted.clone());
        Ok(hosted)
    }
}

/// The graph that a job is about.
struct Wanted<'a> {
    job: &'a Job,
    context: ProbeContext,
    id: GraphId,
    origin: Origin,
}

impl<'a> Wanted<'a> {
    /// Generates the map of the job, which decides the identity of the graph.
    fn new(planner: &Planner, job: &'a Job) -> Self {
        let map = job.source.map();
        let (map_hash, extent) = (map.hash().to_hex(), map.extent());
        let policy = planner.shared.policy.clone();
        let context = ProbeContext { map, profile: job.body.clone(), policy: policy.clone() };
        let id = graphs::id_of(&context, &job.settings);
        let origin = Origin {
            id,
            source: job.source.clone(),
            body: job.body.clone(),
            settings: job.settings,
            map_hash,
            extent,
            policy,
            thread_count: planner.shared.config.threads,
            table_limit: planner.shared.config.table_vertices,
        };
        Self { job, context, id, origin }
    }
}

/// Waits for a permit until the job is cancelled.
async fn permit_for(job: &Job, permits: &Arc<Semaphore>) -> Result<OwnedSemaphorePermit, PlannerError> {
    tokio::select! {
        permit = permits.clone().acquire_owned() => permit.map_err(|_| PlannerError::ShuttingDown),
        () = job.cancelled() => Err(BuildError::Cancelled.into()),
    }
}
