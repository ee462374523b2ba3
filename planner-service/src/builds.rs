//! Makes the graph of a job: one build at a time on all cores. Graphs that are in memory or in the store do not wait
//! for a running build. Where planners share a store, one of them builds a graph, and the others load it.

use crate::config::PlannerConfig;
use crate::error::PlannerError;
use crate::failpoint::failpoint;
use crate::graphs::GraphCache;
use crate::hosted::{CarriedOver, Hosted, Prepared, Provenance};
use crate::jobs::{BuildPhase, Job};
use crate::layers::LayerEditor;
use crate::maps::RecentMaps;
use crate::origin::Origin;
use crate::provers::ProbeWork;
use crate::replicas::{ClaimOutcome, Token};
use crate::reports::Reports;
use crate::stores::PlannerStores;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};
use surefoot_planner::live::LiveEvidence;
use surefoot_planner::store::{StoreError, StoreErrorKind};
use surefoot_planner::update::{Update, Updated};
use surefoot_planner::{BuildError, BuildStats, Built, GraphId};
use surefoot_policy::Policy;
use surefoot_rollout::graphs;
use surefoot_rollout::probe::ProbeContext;
use tokio::runtime::Handle;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::task::spawn_blocking;
use tracing::{info, warn};

/// Maximum number of graphs that are loaded at a time while a build is running. Each generates its map.
const MAX_LOADS: usize = 2;
/// Time from the start of a build to its first interim graph; the pause before each further one doubles.
const FIRST_INTERIM: Duration = Duration::from_millis(300);
/// Pause after which an interim graph is tried again, if too little was known.
const RETRY_INTERIM: Duration = Duration::from_millis(100);
/// Period at which a build checks whether another planner still builds the graph.
const CHECK_CLAIM_EVERY: Duration = Duration::from_millis(250);
/// Longest time for which a finished graph waits for an unavailable store.
const PUBLISH_PATIENCE: Duration = Duration::from_secs(20);
/// Pause between tries to store it.
const PUBLISH_PAUSE: Duration = Duration::from_millis(500);

/// Makes the graphs of jobs.
pub(crate) struct BuildRunner {
    config: PlannerConfig,
    policy: Policy,
    stores: PlannerStores,
    graphs: Arc<GraphCache>,
    layers: Arc<LayerEditor>,
    reports: Arc<Reports>,
    maps: Arc<RecentMaps>,
    /// Permits one build at a time, because each uses all cores.
    build_slot: Arc<Semaphore>,
    /// Permits a few loads at a time while a build is running.
    loading: Arc<Semaphore>,
    /// Permits one graph at a time to follow an edit of its map.
    updating: Arc<Semaphore>,
    /// Notified when another planner has published a graph, or has given up.
    news: watch::Sender<()>,
    built: AtomicU64,
}

impl BuildRunner {
    pub fn new(
        (config, policy): (PlannerConfig, Policy),
        stores: PlannerStores,
        graphs: Arc<GraphCache>,
        (layers, reports): (Arc<LayerEditor>, Arc<Reports>),
        maps: Arc<RecentMaps>,
    ) -> Self {
        Self {
            config,
            policy,
            stores,
            graphs,
            layers,
            reports,
            maps,
            build_slot: Arc::new(Semaphore::new(1)),
            loading: Arc::new(Semaphore::new(MAX_LOADS)),
            updating: Arc::new(Semaphore::new(1)),
            news: watch::Sender::new(()),
            built: AtomicU64::new(0),
        }
    }

    pub fn built_count(&self) -> u64 {
        self.built.load(Ordering::Relaxed)
    }

    /// Wakes builds that wait for graphs of other planners.
    pub fn note_graph_news(&self) {
        self.news.send_replace(());
    }

    /// Loads or builds the graph of a map without pieces.
    pub async fn build(self: Arc<Self>, job: Arc<Job>) -> Result<Arc<Hosted>, PlannerError> {
        let slot = match self.build_slot.clone().try_acquire_owned() {
            Ok(slot) => slot,
            Err(_) => {
                let mut news = self.news.subscribe();
                loop {
                    if let Some(hosted) = self.load_beside_build(&job).await? {
                        return Ok(hosted);
                    }
                    tokio::select! {
                        slot = permit_for(&job, &self.build_slot) => break slot?,
                        // Another planner may have built it. The sender lives as long as the runner.
                        _ = news.changed() => {}
                    }
                }
            }
        };
        let task = spawn_blocking(move || self.load_or_build(&job, slot));
        task.await.map_err(PlannerError::lost("the build"))?
    }

    /// Makes the graph of an edited map from `base`, a graph of the same map with other pieces or with none. It does
    /// not wait for builds.
    pub async fn follow_edit(self: Arc<Self>, job: Arc<Job>, base: Arc<Hosted>) -> Result<Arc<Hosted>, PlannerError> {
        let permit = permit_for(&job, &self.updating).await?;
        let task = spawn_blocking(move || {
            let _permit = permit;
            // Another job may have made it while this one waited.
            if let Some(hosted) = self.graphs.find_for_job(&job) {
                return Ok(hosted);
            }
            // A nearer graph may have come into memory.
            self.update(&job, &self.graphs.nearest(&job).unwrap_or(base))
        });
        task.await.map_err(PlannerError::lost("the update"))?
    }

    /// Makes the graph of a job from `base`, and first publishes the part of `base` that the edit cannot affect.
    fn update(&self, job: &Job, base: &Hosted) -> Result<Arc<Hosted>, PlannerError> {
        job.enter(BuildPhase::Map);
        let started = Instant::now();
        let wanted = Wanted::new(self, job);
        let update = Update::of(base.proved(), &self.maps.get(&base.origin.source), &wanted.context.site());
        job.enter(BuildPhase::Vertices);
        // Clients see interim graphs from this phase on.
        job.enter(BuildPhase::Probes);
        let interims = Interims { runner: self, wanted: &wanted, started };
        let spared = Built { graph: update.without_affected_edges(), stats: BuildStats::default() };
        self.host(&wanted, spared, Provenance::Interim, CarriedOver::default())?;
        job.note_usable(wanted.id);
        let spared_s = started.elapsed().as_secs_f32();
        let threads = self.config.threads;
        let Updated { built, retried, .. } =
            graphs::finish(update, &wanted.context, &job.settings, threads, &job.progress)?;
        let seconds = started.elapsed().as_secs_f32();
        info!(id = %wanted.id, retried, spared_s, seconds, "planner: updated a graph after an edit of its map");
        job.enter(BuildPhase::Index);
        let hosted = self.host(&wanted, built, Provenance::Updated, interims.carried_over())?;
        if let Some(replicas) = &self.stores.replicas
            && let Err(error) = replicas.note_recipe(&wanted.id, &job.recipe())
        {
            warn!(%error, id = %wanted.id, "planner: cannot share an updated graph; other planners do not find it");
        }
        Ok(hosted)
    }

    /// Loads the graph of a job from the store, if it is there, while a build is running. The job stays queued
    /// meanwhile.
    async fn load_beside_build(self: &Arc<Self>, job: &Arc<Job>) -> Result<Option<Arc<Hosted>>, PlannerError> {
        let permit = permit_for(job, &self.loading).await?;
        let (runner, job) = (self.clone(), job.clone());
        let task = spawn_blocking(move || {
            let _permit = permit;
            runner.load(&Wanted::new(&runner, &job), || job.enter(BuildPhase::Map))
        });
        task.await.map_err(PlannerError::lost("the load"))?
    }

    /// Loads the graph of a job from the store, or builds it unless another planner does. Only building keeps the
    /// slot.
    fn load_or_build(&self, job: &Job, slot: OwnedSemaphorePermit) -> Result<Arc<Hosted>, PlannerError> {
        job.enter(BuildPhase::Map);
        let wanted = Wanted::new(self, job);
        let interims = Interims { runner: self, wanted: &wanted, started: Instant::now() };
        let runtime = Handle::current();
        let mut slot = Some(slot);
        let mut built = None;
        loop {
            let mut news = self.news.subscribe();
            if let Some(loaded) = self.load(&wanted, || drop(slot.take()))? {
                return Ok(loaded);
            }
            match self.claim(&wanted)? {
                ClaimOutcome::Ours(token) => {
                    let _claim = HeldClaim { runner: self, id: wanted.id };
                    if slot.is_none() {
                        slot = Some(runtime.block_on(permit_for(job, &self.build_slot))?);
                    }
                    let made = match built.take() {
                        Some(made) => made,
                        None => self.build_here(&interims)?,
                    };
                    if self.publish(&wanted, token, &made)? {
                        return self.host(&wanted, made, Provenance::Built, interims.carried_over());
                    }
                    // The claim was lost. Unless another planner publishes the graph, this one is published next.
                    built = Some(made);
                }
                ClaimOutcome::Published => {}
                ClaimOutcome::Theirs(status) => {
                    slot = None;
                    job.mirror(status);
                    runtime.block_on(wait_for_news(job, &mut news))?;
                }
            }
        }
    }

    /// Claims the build of a graph. A planner that shares no store always succeeds.
    fn claim(&self, Wanted { job, id, .. }: &Wanted<'_>) -> Result<ClaimOutcome, PlannerError> {
        let Some(replicas) = &self.stores.replicas else { return Ok(ClaimOutcome::Ours(Token(0))) };
        replicas.claim(id, job.id).map_err(PlannerError::store("the graph cannot be built"))
    }

    fn build_here(&self, interims: &Interims<'_>) -> Result<Built, PlannerError> {
        let Wanted { job, id, .. } = interims.wanted;
        job.reach(BuildPhase::Vertices);
        failpoint("claimed");
        job.forget_probes();
        let started = Instant::now();
        let built = interims.publish_while(|| self.prove(interims.wanted))?;
        self.built.fetch_add(1, Ordering::Relaxed);
        let (probes, edges) = (built.stats.probes, built.graph.edge_count());
        info!(%id, probes, edges, seconds = started.elapsed().as_secs_f32(), "planner: built a graph");
        job.reach(BuildPhase::Index);
        failpoint("built");
        Ok(built)
    }

    /// Builds a graph; the provers of this service run its probes.
    fn prove(&self, Wanted { job, context, .. }: &Wanted<'_>) -> Result<Built, PlannerError> {
        let thread_count = self.config.threads;
        let work = ProbeWork { source: job.source.clone(), context: context.clone(), thread_count };
        let probes = self.config.provers.enlist(work);
        let built = graphs::build_by(&*probes, context, &job.settings, thread_count, &job.progress);
        let gave_up = |reason| PlannerError::Lost { what: "the probes of the build", reason };
        built.map_err(|error| probes.failure().map_or_else(|| error.into(), gave_up))
    }

    /// Stores a graph that was built here; waits a while if the shared store is unavailable. Returns whether the claim
    /// of the build still holds; otherwise nothing is stored.
    fn publish(&self, wanted: &Wanted<'_>, token: Token, built: &Built) -> Result<bool, PlannerError> {
        let Some(replicas) = &self.stores.replicas else {
            if let Err(error) = self.stores.store.put(&wanted.id, built) {
                warn!(%error, id = %wanted.id, "planner: cannot store a graph; it is built again after a restart");
            }
            return Ok(true);
        };
        let (recipe, since) = (wanted.job.recipe(), Instant::now());
        loop {
            match replicas.publish(&wanted.id, token, &recipe, built) {
                Err(error)
                    if error.kind == StoreErrorKind::Unavailable
                        && since.elapsed() < PUBLISH_PATIENCE
                        && !wanted.job.is_cancelled() =>
                {
                    warn!(%error, id = %wanted.id, "planner: cannot store a graph yet; trying again");
                    std::thread::park_timeout(PUBLISH_PAUSE);
                }
                published => return published.map_err(PlannerError::store("the graph cannot be stored")),
            }
        }
    }

    /// Returns a graph from memory or else from the store; `None` if it is in neither. Calls `found` before it decodes
    /// a stored graph.
    fn load(&self, wanted: &Wanted<'_>, found: impl FnOnce()) -> Result<Option<Arc<Hosted>>, PlannerError> {
        let Wanted { job, id, .. } = wanted;
        if job.is_cancelled() {
            return Err(BuildError::Cancelled.into());
        }
        if let Some(ready) = self.graphs.get(id).filter(|ready| !ready.is_interim()) {
            if ready.check_layers().is_err() {
                let (level, lock) = (ready.level(), self.layers.lock_of(&ready.level()));
                let prepare = |layers| ready.prepare(layers, &job.progress);
                let (prepared, _held) = self.layers.with_layers(&lock, &level, prepare)?;
                ready.apply(prepared);
                self.graphs.label_later(&ready);
            }
            return Ok(Some(ready));
        }
        // If the shared store is unavailable, it may have the graph: no second one must be built.
        let unless_damaged = |error: StoreError| match error.kind {
            StoreErrorKind::Unavailable => Err(PlannerError::store("the graph cannot be loaded")(error)),
            StoreErrorKind::Lost | StoreErrorKind::Refused => Ok(error),
        };
        let stored = self.stores.store.get(id).or_else(|error| {
            unless_damaged(error).map(|error| {
                warn!(%error, %id, "planner: cannot read a graph from the store; building it again");
                None
            })
        })?;
        let Some(built) = stored else { return Ok(None) };
        found();
        job.reach(BuildPhase::Index);
        let live = self.stores.store.live(id).or_else(|error| {
            unless_damaged(error).map(|error| {
                warn!(%error, %id, "planner: cannot read live evidence; the graph starts without it");
                LiveEvidence::default()
            })
        })?;
        self.host(wanted, built, Provenance::Stored, CarriedOver::of(live)).map(Some)
    }

    /// Applies the level's layers to a graph and keeps it in memory. If the layers cannot be read, the graph refuses
    /// plans.
    fn host(
        &self,
        Wanted { job, origin, .. }: &Wanted<'_>,
        built: Built,
        provenance: Provenance,
        carried: CarriedOver,
    ) -> Result<Arc<Hosted>, PlannerError> {
        let level = origin.level();
        let lock = self.layers.lock_of(&level);
        let probes = carried.probes.clone();
        let prepare = |layers| Prepared::new(origin, &built.graph, &probes, layers, &job.progress);
        // Held until the graph is in memory, where later edits find it.
        let (prepared, _held) = self.layers.with_layers(&lock, &level, prepare)?;
        // Hub labels may take longer than an interim graph lasts, and would delay designers who edit a map.
        let is_awaited = matches!(provenance, Provenance::Interim | Provenance::Updated);
        let label_limit = if is_awaited { 0 } else { origin.label_limit };
        let origin = Origin { label_limit, ..origin.clone() };
        let hosted = Arc::new(Hosted::new(origin, built, provenance, carried, prepared));
        self.graphs.insert(hosted.clone());
        hosted.announce();
        self.reports.exchange_later(&hosted);
        Ok(hosted)
    }
}

/// A claim that is released when it is dropped. Publishing a graph ends its claim before that.
struct HeldClaim<'a> {
    runner: &'a BuildRunner,
    id: GraphId,
}

impl Drop for HeldClaim<'_> {
    fn drop(&mut self) {
        if let Some(replicas) = &self.runner.stores.replicas {
            replicas.release(&self.id);
        }
    }
}

/// Waits for news of a graph, but not for long, since news may be lost.
async fn wait_for_news(job: &Job, news: &mut watch::Receiver<()>) -> Result<(), PlannerError> {
    tokio::select! {
        // The sender lives as long as the runner.
        _ = news.changed() => Ok(()),
        () = tokio::time::sleep(CHECK_CLAIM_EVERY) => Ok(()),
        () = job.cancelled() => Err(BuildError::Cancelled.into()),
    }
}

/// The interim graphs of a running build. When the build is over, none of them stays in memory.
struct Interims<'a> {
    runner: &'a BuildRunner,
    wanted: &'a Wanted<'a>,
    started: Instant,
}

impl Interims<'_> {
    /// Publishes interim graphs while `build` runs: soon after its start, then at growing intervals, since each takes
    /// time from the build.
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

    /// Publishes what the build has proved so far. Returns whether that was enough for a graph.
    fn publish(&self) -> bool {
        let Self { runner, wanted, started } = self;
        let Wanted { job, context, id, .. } = wanted;
        let Some(graph) = job.progress.interim.graph(&context.map, job.settings.threshold) else { return false };
        let graph = graph.with_moves(context.profile.moves.clone());
        let probes = job.progress.done.load(Ordering::Relaxed);
        let stats = BuildStats { probes, seconds: started.elapsed().as_secs_f64(), ..BuildStats::default() };
        let hosted = runner.host(wanted, Built { graph, stats }, Provenance::Interim, self.carried_over());
        // It fails only if the build is cancelled.
        if hosted.is_ok() {
            job.note_usable(*id);
        }
        true
    }

    /// What the next graph of the build takes from the latest one.
    fn carried_over(&self) -> CarriedOver {
        let latest = self.runner.graphs.peek(&self.wanted.id);
        latest.map(|hosted| hosted.carry_over()).unwrap_or_default()
    }
}

impl Drop for Interims<'_> {
    fn drop(&mut self) {
        self.runner.graphs.evict_interim(&self.wanted.id);
    }
}

/// The graph that a job makes.
struct Wanted<'a> {
    job: &'a Job,
    context: ProbeContext,
    id: GraphId,
    origin: Origin,
}

impl<'a> Wanted<'a> {
    /// Generates the map of the job, which the id of the graph depends on.
    fn new(runner: &BuildRunner, job: &'a Job) -> Self {
        let map = runner.maps.get(&job.source);
        let (map_hash, extent) = (map.hash().to_hex(), map.extent());
        let policy = runner.policy.clone();
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
            thread_count: runner.config.threads,
            label_limit: runner.config.label_vertices,
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
