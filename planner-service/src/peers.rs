//! Builds as clients of all planners see them. A planner that shares its store posts its builds there, follows those of
//! other planners when a client asks for them, takes over builds of planners that died, and follows changes of layers
//! and evidence. A planner that has its store for itself only runs builds.

use crate::builds::BuildRunner;
use crate::config::PlannerConfig;
use crate::error::PlannerError;
use crate::graphs::GraphCache;
use crate::hosted::Hosted;
use crate::jobs::{BuildId, BuildPhase, BuildResult, Job, Jobs, SERVICE};
use crate::layers::LayerEditor;
use crate::replicas::{BuildStatus, News, Operation, Replicas, Withdrawals};
use crate::reports::Reports;
use crate::stores::PlannerStores;
use crate::wire::{self, Wanted};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use surefoot_net::levels::{LevelStore, MapSource};
use surefoot_net::serving::{Caller, Shutdown};
use surefoot_planner::store::{LevelId, StoreError};
use surefoot_planner::{BuildError, GraphId};
use tokio::sync::Semaphore;
use tokio::task::spawn_blocking;
use tracing::{info, warn};

/// Period at which a planner posts the status of its build, and reads that of another planner's build.
const POST_EVERY: Duration = Duration::from_millis(250);
/// Maximum number of news that are followed at a time. Others wait in the queue; a full queue holds back the database
/// connection.
const MAX_FOLLOWED: usize = 4;

impl Job {
    /// How all planners make the graph.
    pub(crate) fn recipe(&self) -> Vec<u8> {
        wire::recipe((&self.source, &self.body, &self.settings))
    }

    fn status(&self) -> BuildStatus {
        BuildStatus {
            phase: self.phases().pop().unwrap_or(BuildPhase::Queued),
            done: self.progress.done.load(Ordering::Relaxed),
            total: self.progress.total.load(Ordering::Relaxed),
        }
    }

    /// Shows the status of another planner's build of the same graph.
    pub(crate) fn mirror(&self, status: Option<BuildStatus>) {
        let Some(BuildStatus { phase, done, total }) = status.filter(|status| !status.phase.is_end()) else { return };
        if phase >= BuildPhase::Vertices {
            self.reach(BuildPhase::Vertices);
            // Watchers never see an earlier phase again, even if the next planner starts over.
            self.forget_probes();
            self.progress.done.store(done, Ordering::Relaxed);
            self.progress.total.store(total, Ordering::Relaxed);
        }
        self.reach(phase);
    }

    fn operation(&self) -> Operation {
        let end = self.end();
        let failure = end.as_ref().and_then(|end| end.as_ref().err());
        Operation {
            id: self.id,
            recipe: self.recipe(),
            status: self.status(),
            graph: end.as_ref().and_then(|end| end.as_ref().ok()).map(|made| made.graph),
            failure: failure.map(wire::failure_of),
            requesters: self.requesters(),
            withdrawals: Withdrawals::default(),
            started: self.started,
            is_ours: true,
        }
    }
}

/// Calls the shared store on a thread that may block. `what` is what cannot be done if the call fails.
async fn ask<T: Send + 'static>(
    replicas: &Arc<dyn Replicas>,
    what: &'static str,
    call: impl FnOnce(&dyn Replicas) -> Result<T, StoreError> + Send + 'static,
) -> Result<T, PlannerError> {
    let replicas = replicas.clone();
    let task = spawn_blocking(move || call(&*replicas));
    task.await.map_err(PlannerError::lost("the call of the store"))?.map_err(PlannerError::store(what))
}

/// Posts the status of a build of this planner. Returns the withdrawals that other planners have noted.
async fn post(replicas: &Arc<dyn Replicas>, job: &Job) -> Result<Withdrawals, PlannerError> {
    let operation = job.operation();
    ask(replicas, "the build cannot be started", move |replicas| replicas.post(&operation)).await
}

/// All builds: those of this planner, and those of other planners that it follows.
pub(crate) struct Peers {
    pub config: PlannerConfig,
    pub levels: LevelStore,
    pub jobs: Jobs,
    pub stores: PlannerStores,
    pub graphs: Arc<GraphCache>,
    pub layers: Arc<LayerEditor>,
    pub reports: Arc<Reports>,
    pub runner: Arc<BuildRunner>,
    pub shutdown: Shutdown,
}

impl Peers {
    /// Starts the build of a graph for `client`, or returns the build of the same graph that is already open.
    pub fn start(self: &Arc<Self>, wanted: Wanted, client: &str) -> Result<Arc<Job>, PlannerError> {
        let (job, is_new) = self.jobs.find_or_add(wanted, client, &self.config)?;
        if is_new {
            self.spawn(job.clone(), self.clone().run_own(job.clone()));
        }
        Ok(job)
    }

    /// Runs `run` until it returns how the build of `job` ended.
    fn spawn<F>(self: &Arc<Self>, job: Arc<Job>, run: F)
    where
        F: Future<Output = Result<Arc<Hosted>, PlannerError>> + Send + 'static,
    {
        let peers = self.clone();
        tokio::spawn(async move {
            let end = run.await;
            job.finish(end.map(|hosted| BuildResult { graph: hosted.origin.id, figures: hosted.figures() }));
            peers.post_end(&job).await;
            job.note_known();
        });
    }

    /// Runs a build that a client of this planner started, and posts it.
    async fn run_own(self: Arc<Self>, job: Arc<Job>) -> Result<Arc<Hosted>, PlannerError> {
        let Some(replicas) = &self.stores.replicas else {
            job.note_known();
            return self.make(job).await;
        };
        job.is_ours.store(true, Ordering::Relaxed);
        if let Some(hosted) = self.graphs.find_for_job(&job) {
            return Ok(hosted);
        }
        post(replicas, &job).await?;
        job.note_known();
        self.run_posting(replicas, job).await
    }

    /// Runs a build that is posted, and keeps its status up to date.
    async fn run_posting(
        self: &Arc<Self>,
        replicas: &Arc<dyn Replicas>,
        job: Arc<Job>,
    ) -> Result<Arc<Hosted>, PlannerError> {
        job.is_ours.store(true, Ordering::Relaxed);
        let work = self.make(job.clone());
        tokio::pin!(work);
        loop {
            tokio::select! {
                end = &mut work => return end,
                () = tokio::time::sleep(POST_EVERY) => {}
            }
            // While the store is unavailable, other planners show an old status.
            if let Ok(Withdrawals { clients, is_cancelled }) = post(replicas, &job).await {
                job.note_withdrawn(&clients);
                if is_cancelled {
                    job.cancel();
                }
            }
        }
    }

    async fn make(self: &Arc<Self>, job: Arc<Job>) -> Result<Arc<Hosted>, PlannerError> {
        if let Some(hosted) = self.graphs.find_for_job(&job) {
            return Ok(hosted);
        }
        if job.source.pieces().is_empty() {
            return self.runner.clone().build(job).await;
        }
        let base = match self.graphs.nearest(&job) {
            Some(base) => base,
            None => self.make_plain(&job).await?,
        };
        self.runner.clone().follow_edit(job, base).await
    }

    /// Makes the graph of a job's map without its pieces.
    async fn make_plain(self: &Arc<Self>, job: &Job) -> Result<Arc<Hosted>, PlannerError> {
        let plain = MapSource::from(job.source.base().clone());
        let build = self.start((plain, job.body.clone(), job.settings), SERVICE)?;
        tokio::select! {
            () = build.ended() => {}
            () = job.cancelled() => return Err(BuildError::Cancelled.into()),
        }
        let built = build.end().unwrap_or(Err(BuildError::Cancelled.into()))?;
        self.graphs.get(&built.graph).ok_or_else(|| PlannerError::UnknownGraph(built.graph.to_string()))
    }

    /// Returns a graph and marks it as used. A graph of another planner is loaded.
    pub async fn get_or_load(self: &Arc<Self>, id: GraphId) -> Result<Arc<Hosted>, PlannerError> {
        if let Some(found) = self.graphs.get(&id) {
            return Ok(found);
        }
        let unknown = || PlannerError::UnknownGraph(id.to_string());
        let replicas = self.stores.replicas.as_ref().ok_or_else(unknown)?;
        let recipe = ask(replicas, "the graph cannot be loaded", move |replicas| replicas.recipe(&id)).await?;
        let wanted = wire::read_recipe(&recipe.ok_or_else(unknown)?, &self.levels, &self.config).await?;
        let job = self.start(wanted, SERVICE)?;
        tokio::select! {
            () = job.ended() => {}
            () = self.shutdown.wait() => return Err(PlannerError::ShuttingDown),
        }
        job.end().unwrap_or(Err(PlannerError::ShuttingDown))?;
        // A planner with another policy makes another graph of the same map.
        self.graphs.get(&id).ok_or_else(unknown)
    }

    /// Withdraws the requests of a caller for a build. The build is cancelled if no other client waits for it, or the
    /// caller is an admin.
    pub async fn cancel(&self, job: &Job, caller: &Caller) -> Result<(), PlannerError> {
        if job.end().is_some() {
            return Ok(());
        }
        let Some(replicas) = self.stores.replicas.as_ref().filter(|_| !job.is_ours.load(Ordering::Relaxed)) else {
            return job.withdraw(caller);
        };
        let id = job.id;
        let found = ask(replicas, "the build cannot be looked up", move |replicas| replicas.operation(id)).await?;
        let Operation { requesters, withdrawals, .. } = found.ok_or(PlannerError::UnknownBuild(id.to_string()))?;
        let waiting: Vec<String> = requesters.into_iter().filter(|name| !withdrawals.clients.contains(name)).collect();
        let mine: Vec<String> = waiting.iter().filter(|name| caller.may_change(name)).cloned().collect();
        let is_admin = caller.may_change(SERVICE);
        if mine.is_empty() && !is_admin {
            return Err(PlannerError::NotRequester(id.to_string()));
        }
        let is_cancelled = is_admin || mine.len() == waiting.len();
        let withdrawals = Withdrawals { clients: mine, is_cancelled };
        ask(replicas, "the build cannot be cancelled", move |replicas| replicas.withdraw(id, &withdrawals)).await
    }

    /// Posts how a build of this planner has ended, unless it is posted. A build that failed because this planner stops
    /// is left to other planners.
    async fn post_end(&self, job: &Job) {
        let Some(replicas) = &self.stores.replicas else { return };
        let is_left = self.shutdown.is_triggered() && matches!(job.end(), Some(Err(_)));
        if is_left || !job.is_ours.load(Ordering::Relaxed) || job.is_end_posted.load(Ordering::Relaxed) {
            return;
        }
        match post(replicas, job).await {
            Ok(_) => job.is_end_posted.store(true, Ordering::Relaxed),
            Err(error) => warn!(%error, build = %job.id, "planner: cannot post the end of a build; trying again"),
        }
    }

    pub async fn find(self: &Arc<Self>, id: &str) -> Result<Arc<Job>, PlannerError> {
        let found = self.jobs.find(id);
        let (Err(PlannerError::UnknownBuild(_)), Some(wanted)) = (&found, BuildId::parse(id)) else { return found };
        let Some(replicas) = &self.stores.replicas else { return found };
        let operation =
            ask(replicas, "the build cannot be looked up", move |replicas| replicas.operation(wanted)).await?;
        match operation {
            Some(operation) => self.follow(replicas, &operation).await,
            None => found,
        }
    }

    /// Returns the builds of this planner and the open builds of others, the latest first. While the store is
    /// unavailable, builds of others that this planner does not follow yet are missing.
    pub async fn all(self: &Arc<Self>) -> Vec<Arc<Job>> {
        if let Some(replicas) = &self.stores.replicas {
            let open = ask(replicas, "builds cannot be listed", |replicas| replicas.open_operations()).await;
            for operation in open.unwrap_or_default() {
                if let Err(error) = self.follow(replicas, &operation).await {
                    warn!(%error, build = %operation.id, "planner: cannot list a build of another planner");
                }
            }
        }
        self.jobs.all()
    }

    /// Shows a build of another planner as a job of this one.
    async fn follow(
        self: &Arc<Self>,
        replicas: &Arc<dyn Replicas>,
        operation: &Operation,
    ) -> Result<Arc<Job>, PlannerError> {
        let wanted = wire::read_recipe(&operation.recipe, &self.levels, &self.config).await?;
        let (job, is_new) = self.jobs.follow(operation.id, wanted, operation.started);
        if is_new {
            job.take_requesters(&operation.requesters, operation.withdrawals.clients.len());
            job.note_known();
            self.spawn(job.clone(), self.clone().run_remote(replicas.clone(), job.clone()));
        }
        Ok(job)
    }

    /// Follows a build of another planner to its end, or runs it once this planner has taken it over.
    async fn run_remote(
        self: Arc<Self>,
        replicas: Arc<dyn Replicas>,
        job: Arc<Job>,
    ) -> Result<Arc<Hosted>, PlannerError> {
        let id = job.id;
        loop {
            // While the store is unavailable, the job keeps its latest known status.
            let found = ask(&replicas, "the build cannot be looked up", move |replicas| replicas.operation(id)).await;
            match found {
                Ok(Some(Operation { status, graph: Some(graph), .. })) if status.phase == BuildPhase::Done => {
                    return self.get_or_load(graph).await;
                }
                Ok(Some(Operation { failure: Some(failure), status, .. })) if status.phase == BuildPhase::Failed => {
                    return Err(PlannerError::RemoteBuildFailed(failure));
                }
                Ok(Some(Operation { status, .. })) if status.phase.is_end() => {
                    return Err(BuildError::Cancelled.into());
                }
                Ok(Some(Operation { is_ours: true, requesters, withdrawals, .. })) => {
                    job.take_requesters(&requesters, withdrawals.clients.len());
                    return self.run_posting(&replicas, job).await;
                }
                Ok(Some(Operation { status, .. })) => job.mirror(Some(status)),
                Ok(None) => return Err(PlannerError::UnknownBuild(id.to_string())),
                Err(_) => {}
            }
            tokio::select! {
                () = tokio::time::sleep(POST_EVERY) => {}
                () = self.shutdown.wait() => return Err(PlannerError::ShuttingDown),
            }
        }
    }

    /// Posts ends that could not be posted before, and takes over builds of planners that have died.
    async fn adopt_orphans(self: &Arc<Self>, replicas: &Arc<dyn Replicas>) {
        for job in self.jobs.all().iter().filter(|job| job.end().is_some()) {
            self.post_end(job).await;
        }
        let adopted = match ask(replicas, "builds cannot be taken over", |replicas| replicas.adopt()).await {
            Ok(adopted) => adopted,
            Err(error) => return warn!(%error, "planner: cannot query for orphaned builds"),
        };
        for operation in adopted {
            info!(build = %operation.id, "planner: took over a build of a planner that died");
            if let Err(error) = self.follow(replicas, &operation).await {
                warn!(%error, build = %operation.id, "planner: cannot take over an orphaned build");
                // Other planners leave it alone as long as this planner lives.
                let status = BuildStatus { phase: BuildPhase::Failed, ..operation.status };
                let failed = Operation { status, failure: Some(wire::failure_of(&error)), ..operation };
                let posted = ask(replicas, "the end cannot be posted", move |replicas| replicas.post(&failed)).await;
                if let Err(error) = posted {
                    warn!(%error, "planner: an orphaned build was left alone");
                }
            }
        }
    }

    /// Follows changes by other planners until the service stops.
    pub async fn follow_news(self: Arc<Self>) {
        let Some(replicas) = &self.stores.replicas else { return };
        let Some(mut news) = replicas.news() else { return };
        let turns = Arc::new(Semaphore::new(MAX_FOLLOWED));
        loop {
            let latest = tokio::select! {
                latest = news.recv() => latest,
                () = self.shutdown.wait() => return,
            };
            let Some(latest) = latest else { return };
            if matches!(latest, News::Graph(_) | News::Everything) {
                self.runner.note_graph_news();
            }
            // Never closed.
            let Ok(turn) = turns.clone().acquire_owned().await else { return };
            let (peers, replicas) = (self.clone(), replicas.clone());
            tokio::spawn(async move {
                let _turn = turn;
                if latest == News::Orphans {
                    return peers.adopt_orphans(&replicas).await;
                }
                // It panics only if `follow_change` does, which the panic hook reports.
                let _ = spawn_blocking(move || peers.follow_change(latest)).await;
            });
        }
    }

    fn follow_change(&self, news: News) {
        match news {
            News::Graph(_) | News::Orphans => {}
            News::Layers(level) => self.layers.renew(&level),
            News::Evidence(id) => {
                if let Some(hosted) = self.graphs.peek(&id) {
                    self.reports.exchange(&hosted);
                }
            }
            News::Everything => {
                let all = self.graphs.all();
                let levels: BTreeSet<LevelId> = all.iter().map(|hosted| hosted.level()).collect();
                levels.iter().for_each(|level| self.layers.renew(level));
                all.iter().for_each(|hosted| self.reports.exchange(hosted));
            }
        }
    }
}
