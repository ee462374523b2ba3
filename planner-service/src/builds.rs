//! Builds of graphs: one at a time on all cores; requests for the same graph share a build. Graphs that are in memory or in the
//! store do not wait for a build that is running. Where planners share a store, one of them builds a graph, and the others load it.

use crate::error::PlannerError;
use crate::failpoint::failpoint;
use crate::hosted::{CarriedOver, Hosted, Prepared, Provenance};
use crate::jobs::{BuildPhase, BuildResult, Job, Jobs, SERVICE};
use crate::origin::Origin;
use crate::planner::Planner;
use crate::provers::ProbeWork;
use crate::replicas::{ClaimOutcome, Token};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};
use surefoot_net::levels::MapSource;
use surefoot_planner::live::LiveEvidence;
use surefoot_planner::store::StoreErrorKind;
use surefoot_planner::update::{Update, Updated};
use surefoot_planner::{BuildError, BuildSettings, BuildStats, Built, GraphId};
use surefoot_rollout::graphs;
use surefoot_rollout::probe::ProbeContext;
use surefoot_world::CharacterProfile;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tracing::{info, warn};

/// Time from the start of a build to its first interim graph; the pause to the next ones doubles each time.
const FIRST_INTERIM: Duration = Duration::from_millis(300);
/// Pause where too little is known for an interim graph.
const RETRY_INTERIM: Duration = Duration::from_millis(100);
/// Time after which a build looks again whether another planner still builds the graph.
const LOOK_AGAIN: Duration = Duration::from_millis(250);
/// Time for which a graph that was built waits for a store that is away.
const PUBLISH_PATIENCE: Duration = Duration::from_secs(20);
/// Pause between tries to store it.
const PUBLISH_PAUSE: Duration = Duration::from_millis(500);

impl Planner {
    /// Returns the builds of the service.
    pub fn jobs(&self) -> &Jobs {
        &self.shared.jobs
    }

    /// Cancels all builds that are running or waiting.
    pub(crate) fn cancel_builds(&self) {
        self.shared.jobs.all().iter().for_each(|job| job.cancel());
    }

    /// Starts the build of a graph for `client`, or returns the build of the same graph that is already running or waiting.
    ///
    /// # Errors
    /// If too many builds are running or waiting.
    pub fn start_build(
        &self,
        wanted: (MapSource, CharacterProfile, BuildSettings),
        client: &str,
    ) -> Result<Arc<Job>, PlannerError> {
        let (job, is_new) = self.shared.jobs.find_or_add(wanted, client, &self.shared.config)?;
        if is_new {
            self.run_job(job.clone(), Self::run_posted);
        }
        Ok(job)
    }

    /// Runs `run` until it says how a build ended.
    pub(crate) fn run_job<F>(&self, job: Arc<Job>, run: impl FnOnce(Self, Arc<Job>) -> F)
    where
        F: Future<Output = Result<Arc<Hosted>, PlannerError>> + Send + 'static,
    {
        let end = run(self.clone(), job.clone());
        let planner = self.clone();
        tokio::spawn(async move {
            let end = end.await;
            job.finish(end.map(|hosted| BuildResult { graph: hosted.origin.id, figures: hosted.figures() }));
            planner.post_end(&job).await;
            job.note_known();
        });
    }

    pub(crate) async fn run_build(&self, job: Arc<Job>) -> Result<Arc<Hosted>, PlannerError> {
        if let Some(hosted) = self.find_ready(&job) {
            return Ok(hosted);
        }
        if !job.source.pieces().is_empty() {
            return self.follow_edit(job).await;
        }
        let slot = match self.shared.build_slot.clone().try_acquire_owned() {
            Ok(slot) => slot,
            Err(_) => {
                let mut news = self.shared.graph_news.subscribe();
                loop {
                    if let Some(hosted) = self.load_beside_build(&job).await? {
                        return Ok(hosted);
                    }
                    tokio::select! {
                        slot = permit_for(&job, &self.shared.build_slot) => break slot?,
                        // Another planner may have built it. The sender lives as long as the planner.
                        _ = news.changed() => {}
                    }
                }
            }
        };
        let planner = self.clone();
        let task = tokio::task::spawn_blocking(move || planner.load_or_build(&job, slot));
        task.await.map_err(PlannerError::lost("the build"))?
    }

    /// Makes the graph of an edited map from one of the same map with other pieces, or with none. It does not wait for builds.
    async fn follow_edit(&self, job: Arc<Job>) -> Result<Arc<Hosted>, PlannerError> {
        let found = match self.find_relative(&job) {
            Some(found) => found,
            None => self.plain_graph(&job).await?,
        };
        let permit = permit_for(&job, &self.shared.updating).await?;
        let planner = self.clone();
        let task = tokio::task::spawn_blocking(move || {
            let _permit = permit;
            // Somebody may have asked for it while this one waited.
            if let Some(hosted) = planner.find_ready(&job) {
                return Ok(hosted);
            }
            // By now there may be one that is nearer.
            planner.update(&job, &planner.find_relative(&job).unwrap_or(found))
        });
        task.await.map_err(PlannerError::lost("the update"))?
    }

    /// Builds or loads the graph of the map of a job without pieces.
    async fn plain_graph(&self, job: &Job) -> Result<Arc<Hosted>, PlannerError> {
        let plain = MapSource::from(job.source.base().clone());
        let build = self.start_build((plain, job.body.clone(), job.settings), SERVICE)?;
        tokio::select! {
            () = build.ended() => {}
            () = job.cancelled() => return Err(BuildError::Cancelled.into()),
        }
        let built = build.end().unwrap_or(Err(BuildError::Cancelled.into()))?;
        self.in_memory(&built.graph.to_string())
    }

    /// The graph in memory of the same map, body and settings whose pieces differ in the fewest from those of a job.
    fn find_relative(&self, job: &Job) -> Option<Arc<Hosted>> {
        let made = job.source.base().key();
        let is_relative = |hosted: &Arc<Hosted>| {
            let Origin { settings, body, source, .. } = &hosted.origin;
            *settings == job.settings && *body == job.body && source.base().key() == made && !hosted.is_interim()
        };
        let wanted = job.source.pieces();
        let difference = |hosted: &Arc<Hosted>| {
            let pieces = hosted.origin.source.pieces();
            let shared = pieces.iter().filter(|piece| wanted.contains(piece)).count();
            pieces.len() + wanted.len() - 2 * shared
        };
        self.all_ready().into_iter().filter(is_relative).min_by_key(difference)
    }

    /// Makes the graph of a job from its nearest relative, and publishes what is sure to remain of that one first.
    fn update(&self, job: &Job, relative: &Hosted) -> Result<Arc<Hosted>, PlannerError> {
        job.enter(BuildPhase::Map);
        let started = Instant::now();
        let wanted = Wanted::new(self, job);
        let update = Update::of(relative.proved(), &self.map_of(&relative.origin.source), &wanted.context.site());
        job.enter(BuildPhase::Vertices);
        // From this stage on, interim graphs are told of.
        job.enter(BuildPhase::Probes);
        let interims = Interims { planner: self, wanted: &wanted, started };
        let spared = Built { graph: update.spared(), stats: BuildStats::default() };
        self.host(&wanted, spared, Provenance::Interim, CarriedOver::default())?;
        job.note_usable(wanted.id);
        let spared_s = started.elapsed().as_secs_f32();
        let threads = self.shared.config.threads;
        let Updated { built, retried, .. } =
            graphs::finish(update, &wanted.context, &job.settings, threads, &job.progress)?;
        info!(id = %wanted.id, retried, spared_s, seconds = started.elapsed().as_secs_f32(), "graph follows an edit");
        job.enter(BuildPhase::Index);
        let hosted = self.host(&wanted, built, Provenance::Updated, interims.legacy())?;
        if let Err(error) = self.shared.replicas.note_recipe(&wanted.id, &wanted.recipe()) {
            warn!(%error, "other planners do not know of a graph that follows an edit");
        }
        Ok(hosted)
    }

    /// Returns the graph of a job if it is in memory and may be used for plans, and marks it as used.
    pub(crate) fn find_ready(&self, job: &Job) -> Option<Arc<Hosted>> {
        let source = job.source.key();
        let is_same = |hosted: &Arc<Hosted>| {
            let Origin { settings, body, source: of, .. } = &hosted.origin;
            *settings == job.settings && *body == job.body && of.key() == source
        };
        let is_usable = |hosted: &Arc<Hosted>| !hosted.is_interim() && hosted.check_layers().is_ok();
        let found = self.all_ready().into_iter().find(is_same).filter(is_usable)?;
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
            planner.load(&wanted, || job.enter(BuildPhase::Map))
        });
        task.await.map_err(PlannerError::lost("the load"))?
    }

    /// Loads the graph of a job from the store or builds it, unless another planner does. Only building keeps the slot.
    fn load_or_build(&self, job: &Job, slot: OwnedSemaphorePermit) -> Result<Arc<Hosted>, PlannerError> {
        job.enter(BuildPhase::Map);
        let wanted = Wanted::new(self, job);
        let interims = Interims { planner: self, wanted: &wanted, started: Instant::now() };
        let runtime = tokio::runtime::Handle::current();
        let mut slot = Some(slot);
        let mut built = None;
        loop {
            let mut news = self.shared.graph_news.subscribe();
            if let Some(loaded) = self.load(&wanted, || drop(slot.take()))? {
                return Ok(loaded);
            }
            let away = PlannerError::store("the graph cannot be built");
            match self.shared.replicas.claim(&wanted.id, job.id).map_err(away)? {
                ClaimOutcome::Ours(token) => {
                    let _claimed = Claimed { planner: self, id: wanted.id };
                    if slot.is_none() {
                        slot = Some(runtime.block_on(permit_for(job, &self.shared.build_slot))?);
                    }
                    let made = match built.take() {
                        Some(made) => made,
                        None => self.build(&interims)?,
                    };
                    if self.publish(&wanted, token, &made)? {
                        return self.host(&wanted, made, Provenance::Built, interims.legacy());
                    }
                    // Somebody else may have taken the build over meanwhile. If not, this graph is as good as any.
                    built = Some(made);
                }
                ClaimOutcome::Published => {}
                ClaimOutcome::Theirs(posted) => {
                    slot = None;
                    job.mirror(posted);
                    runtime.block_on(wait_for_news(job, &mut news))?;
                }
            }
        }
    }

    /// Builds the graph of a job here.
    fn build(&self, interims: &Interims<'_>) -> Result<Built, PlannerError> {
        let Wanted { job, id, .. } = interims.wanted;
        job.reach(BuildPhase::Vertices);
        failpoint("claimed");
        job.forget_probes();
        let (started, threads) = (Instant::now(), self.shared.config.threads);
        let built = interims.publish_while(|| self.prove(interims.wanted, threads))?;
        self.shared.built.fetch_add(1, Ordering::Relaxed);
        info!(%id, probes = built.stats.probes, edges = built.graph.edge_count(), seconds = started.elapsed().as_secs_f32(), "graph built");
        job.reach(BuildPhase::Index);
        failpoint("built");
        Ok(built)
    }

    /// Stores a graph that was built here, for which it waits a while if the store is away. Returns whether the claim of the build still
    /// holds; otherwise nothing is stored.
    fn publish(&self, wanted: &Wanted<'_>, token: Token, built: &Built) -> Result<bool, PlannerError> {
        let (recipe, since) = (wanted.recipe(), Instant::now());
        loop {
            match self.shared.replicas.publish(&wanted.id, token, &recipe, built) {
                Err(error)
                    if error.kind == StoreErrorKind::Unavailable
                        && since.elapsed() < PUBLISH_PATIENCE
                        && !wanted.job.is_cancelled() =>
                {
                    warn!(%error, "a graph waits to be stored");
                    std::thread::park_timeout(PUBLISH_PAUSE);
                }
                published => return published.map_err(PlannerError::store("the graph cannot be stored")),
            }
        }
    }

    /// Builds a graph, whose probes the provers of this service run.
    fn prove(&self, Wanted { job, context, .. }: &Wanted<'_>, thread_count: usize) -> Result<Built, PlannerError> {
        let work = ProbeWork { source: job.source.clone(), context: context.clone(), thread_count };
        let probes = self.shared.config.provers.enlist(work);
        let built = graphs::build_by(&*probes, context, &job.settings, thread_count, &job.progress);
        let gave_up = |reason| PlannerError::Lost { what: "the probes of the build", reason };
        built.map_err(|error| probes.failure().map_or_else(|| error.into(), gave_up))
    }

    /// Returns a graph from memory or else from the store; `None` if it is in neither. Calls `found` before a stored graph is loaded.
    fn load(&self, wanted: &Wanted<'_>, found: impl FnOnce()) -> Result<Option<Arc<Hosted>>, PlannerError> {
        let Wanted { job, id, .. } = wanted;
        if job.is_cancelled() {
            return Err(BuildError::Cancelled.into());
        }
        if let Some(ready) = self.note_use(id).filter(|ready| !ready.is_interim()) {
            if ready.check_layers().is_err() {
                let prepare = |layers| ready.prepare(layers, &job.progress);
                let (level, lock) = (ready.level(), self.shared.level_locks.of(&ready.level()));
                let (prepared, _held) = self.with_layers(&lock, &level, prepare)?;
                ready.apply(prepared);
                self.label_later(&ready);
            }
            return Ok(Some(ready));
        }
        let store = &self.shared.store;
        let stored = match store.get(id) {
            Ok(stored) => stored,
            // Others may have the graph: a second one must not be built.
            Err(error) if error.kind == StoreErrorKind::Unavailable => {
                return Err(PlannerError::store("the graph cannot be loaded")(error));
            }
            Err(error) => {
                warn!(%error, "graph cache cannot be read; building the graph instead");
                None
            }
        };
        let Some(built) = stored else { return Ok(None) };
        found();
        job.reach(BuildPhase::Index);
        let live = match store.live(id) {
            Ok(live) => live,
            Err(error) if error.kind == StoreErrorKind::Unavailable => {
                return Err(PlannerError::store("the graph cannot be loaded")(error));
            }
            Err(error) => {
                warn!(%error, "live evidence cannot be read; the graph begins without it");
                LiveEvidence::default()
            }
        };
        self.host(wanted, built, Provenance::Stored, CarriedOver::of(live)).map(Some)
    }

    /// Applies the level's layers to a graph and keeps it in memory. If the layers cannot be read, the graph refuses plans.
    fn host(
        &self,
        Wanted { job, origin, .. }: &Wanted<'_>,
        built: Built,
        provenance: Provenance,
        legacy: CarriedOver,
    ) -> Result<Arc<Hosted>, PlannerError> {
        let level = origin.level();
        let lock = self.shared.level_locks.of(&level);
        let proofs = legacy.proofs.clone();
        let prepare = |layers| Prepared::new(origin, &built.graph, &proofs, layers, &job.progress);
        // Held until the graph is in memory, where an edit that comes later finds it.
        let (prepared, _held) = self.with_layers(&lock, &level, prepare)?;
        // To fill a table of next hops takes longer than an interim graph lasts, and would keep those who edit a map waiting.
        let is_awaited = matches!(provenance, Provenance::Interim | Provenance::Updated);
        let table_limit = if is_awaited { 0 } else { origin.table_limit };
        let origin = Origin { table_limit, ..origin.clone() };
        let hosted = Arc::new(Hosted::new(origin, built, provenance, legacy, prepared));
        self.keep_ready(hosted.clone());
        hosted.announce();
        self.exchange_later(&hosted);
        Ok(hosted)
    }
}

/// A claim that is given up when it is dropped; once the graph is published, there is none.
struct Claimed<'a> {
    planner: &'a Planner,
    id: GraphId,
}

impl Drop for Claimed<'_> {
    fn drop(&mut self) {
        self.planner.shared.replicas.release(&self.id);
    }
}

/// Waits for news of a graph, for a moment at most, since news may be lost.
async fn wait_for_news(job: &Job, news: &mut watch::Receiver<()>) -> Result<(), PlannerError> {
    tokio::select! {
        // The sender lives as long as the planner.
        _ = news.changed() => Ok(()),
        () = tokio::time::sleep(LOOK_AGAIN) => Ok(()),
        () = job.cancelled() => Err(BuildError::Cancelled.into()),
    }
}

/// The interim graphs of a running build. When the build is over, none of them stays in memory.
struct Interims<'a> {
    planner: &'a Planner,
    wanted: &'a Wanted<'a>,
    /// When the build started.
    started: Instant,
}

impl Interims<'_> {
    /// Publishes interim graphs while `build` runs: soon after its start, then at longer and longer intervals, since each takes some time
    /// of the build's.
    fn publish_while<T>(&self, build: impl FnOnce() -> T) -> T {
        let (running, ended) = mpsc::channel::<()>();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                let mut pause = FIRST_INTERIM;
                while ended.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                    if self.publish() {
                        pause *= 2;
                    } else {
                        pause = RETRY_INTERIM;
                    }
                }
            });
            let built = build();
            drop(running);
            built
        })
    }

    /// Publishes what the build has found out so far. Returns whether that was enough for a graph.
    fn publish(&self) -> bool {
        let Self { planner, wanted, started } = self;
        let Wanted { job, context, id, .. } = wanted;
        let Some(graph) = job.progress.interim.graph(&context.map, job.settings.threshold) else { return false };
        let probes = job.progress.done.load(Ordering::Relaxed);
        let stats = BuildStats { probes, seconds: started.elapsed().as_secs_f64(), ..BuildStats::default() };
        let hosted = planner.host(wanted, Built { graph, stats }, Provenance::Interim, self.legacy());
        // It fails only if the build is cancelled.
        if hosted.is_ok() {
            job.note_usable(*id);
        }
        true
    }

    /// What the next graph of the build takes over.
    fn legacy(&self) -> CarriedOver {
        let latest = self.planner.all_ready().into_iter().find(|hosted| hosted.origin.id == self.wanted.id);
        latest.map(|hosted| hosted.legacy()).unwrap_or_default()
    }
}

impl Drop for Interims<'_> {
    fn drop(&mut self) {
        self.planner.drop_interim(&self.wanted.id);
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
    /// How others make the graph.
    fn recipe(&self) -> Vec<u8> {
        self.job.recipe()
    }

    /// Generates the map of the job, which decides the identity of the graph.
    fn new(planner: &Planner, job: &'a Job) -> Self {
        let map = planner.map_of(&job.source);
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
