//! Builds as all planners that share a store see them: each tells the others of its own, follows theirs when a client asks, and takes over
//! those of planners that died.

use crate::error::PlannerError;
use crate::hosted::Hosted;
use crate::jobs::{BuildId, BuildPhase, Job, SERVICE};
use crate::planner::Planner;
use crate::replicas::{BuildStatus, Operation, Replicas, Withdrawals};
use crate::wire;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use surefoot_net::serving::Caller;
use surefoot_planner::BuildError;
use surefoot_planner::store::StoreError;
use tracing::{info, warn};

/// Period at which the others are told how far a build has come, and at which a build of another planner is looked at.
const POST_EVERY: Duration = Duration::from_millis(250);

impl Job {
    /// How all planners make the graph.
    pub(crate) fn recipe(&self) -> Vec<u8> {
        wire::recipe((&self.source, &self.body, &self.settings))
    }

    /// How far the build has come.
    fn posted(&self) -> BuildStatus {
        BuildStatus {
            stage: self.stages().pop().unwrap_or(BuildPhase::Queued),
            done: self.progress.done.load(Ordering::Relaxed),
            total: self.progress.total.load(Ordering::Relaxed),
        }
    }

    /// Shows how far another planner has come with the graph.
    pub(crate) fn mirror(&self, posted: Option<BuildStatus>) {
        let Some(BuildStatus { stage, done, total }) = posted.filter(|posted| !posted.stage.is_end()) else { return };
        if stage >= BuildPhase::Vertices {
            self.reach(BuildPhase::Vertices);
            // A stage that watchers have seen remains, also if the next planner begins anew.
            self.forget_probes();
            self.progress.done.store(done, Ordering::Relaxed);
            self.progress.total.store(total, Ordering::Relaxed);
        }
        self.reach(stage);
    }

    fn operation(&self) -> Operation {
        let end = self.end();
        let failure = end.as_ref().and_then(|end| end.as_ref().err());
        Operation {
            id: self.id,
            recipe: self.recipe(),
            posted: self.posted(),
            graph: end.as_ref().and_then(|end| end.as_ref().ok()).map(|made| made.graph),
            failure: failure.map(wire::failure_of),
            requesters: self.requesters(),
            withdrawals: Withdrawals::default(),
            started: self.started,
            is_ours: true,
        }
    }
}

impl Planner {
    /// Calls the other planners' store on a thread that may block.
    pub(crate) async fn ask<T: Send + 'static>(
        &self,
        what: &'static str,
        call: impl FnOnce(&dyn Replicas) -> Result<T, StoreError> + Send + 'static,
    ) -> Result<T, PlannerError> {
        let planner = self.clone();
        let task = tokio::task::spawn_blocking(move || call(&*planner.shared.replicas));
        task.await.map_err(PlannerError::lost("the call of the store"))?.map_err(PlannerError::store(what))
    }

    /// Runs a build of this planner, and tells the others of it.
    pub(crate) async fn run_posted(self, job: Arc<Job>) -> Result<Arc<Hosted>, PlannerError> {
        if !self.shared.replicas.are_several() {
            job.note_known();
            return self.run_build(job).await;
        }
        job.is_ours.store(true, Ordering::Relaxed);
        if let Some(hosted) = self.find_ready(&job) {
            return Ok(hosted);
        }
        self.post(&job).await?;
        job.note_known();
        self.run_posting(job).await
    }

    /// Runs a build of which the others know.
    async fn run_posting(&self, job: Arc<Job>) -> Result<Arc<Hosted>, PlannerError> {
        job.is_ours.store(true, Ordering::Relaxed);
        let work = self.run_build(job.clone());
        tokio::pin!(work);
        loop {
            tokio::select! {
                end = &mut work => return end,
                () = tokio::time::sleep(POST_EVERY) => {}
            }
            // While the store is away, the others do not learn how far it has come.
            if let Ok(Withdrawals { clients, is_cancelled }) = self.post(&job).await {
                job.note_withdrawn(&clients);
                if is_cancelled {
                    job.cancel();
                }
            }
        }
    }

    async fn post(&self, job: &Job) -> Result<Withdrawals, PlannerError> {
        let operation = job.operation();
        self.ask("the build cannot be started", move |replicas| replicas.post(&operation)).await
    }

    /// Withdraws the requests of a caller for a build, which is cancelled if nobody else waits for it. An admin cancels it for everybody.
    ///
    /// # Errors
    /// If the caller has not asked for the build, or the store is away.
    pub(crate) async fn cancel_build(&self, job: &Job, caller: &Caller) -> Result<(), PlannerError> {
        if !self.shared.replicas.are_several() || job.is_ours.load(Ordering::Relaxed) || job.end().is_some() {
            return if job.end().is_some() { Ok(()) } else { job.withdraw(caller) };
        }
        let id = job.id;
        let found = self.ask("the build cannot be looked up", move |replicas| replicas.operation(id)).await?;
        let Operation { requesters, withdrawals, .. } = found.ok_or(PlannerError::UnknownBuild(id.to_string()))?;
        let waiting: Vec<String> = requesters.into_iter().filter(|name| !withdrawals.clients.contains(name)).collect();
        let mine: Vec<String> = waiting.iter().filter(|name| caller.may_change(name)).cloned().collect();
        let is_admin = caller.may_change(SERVICE);
        if mine.is_empty() && !is_admin {
            return Err(PlannerError::NotRequester(id.to_string()));
        }
        let is_cancelled = is_admin || mine.len() == waiting.len();
        let withdrawals = Withdrawals { clients: mine, is_cancelled };
        self.ask("the build cannot be cancelled", move |replicas| replicas.withdraw(id, &withdrawals)).await
    }

    /// Tells the others how a build of this planner has ended, unless they know. One that ended because this planner stops is left to them.
    pub(crate) async fn post_end(&self, job: &Job) {
        let is_left = self.shutdown().is_triggered() && matches!(job.end(), Some(Err(_)));
        if is_left || !job.is_ours.load(Ordering::Relaxed) || job.is_end_posted.load(Ordering::Relaxed) {
            return;
        }
        match self.post(job).await {
            Ok(_) => job.is_end_posted.store(true, Ordering::Relaxed),
            Err(error) => warn!(%error, build = %job.id, "other planners do not know yet how a build has ended"),
        }
    }

    /// Returns a build of this planner, or of another one, which it follows from then on.
    ///
    /// # Errors
    /// If there is no such build, it ended too long ago, or the store is away.
    pub async fn job(&self, id: &str) -> Result<Arc<Job>, PlannerError> {
        let found = self.jobs().find(id);
        let (Err(PlannerError::UnknownBuild(_)), Some(wanted)) = (&found, BuildId::parse(id)) else { return found };
        if !self.shared.replicas.are_several() {
            return found;
        }
        let operation = self.ask("the build cannot be looked up", move |replicas| replicas.operation(wanted)).await?;
        match operation {
            Some(operation) => self.follow(&operation).await,
            None => found,
        }
    }

    /// Returns the builds of this planner and those of others that have not ended, the latest first. While the store is away, only those
    /// that this one knows.
    pub async fn all_jobs(&self) -> Vec<Arc<Job>> {
        if self.shared.replicas.are_several() {
            let open = self.ask("builds cannot be listed", |replicas| replicas.open_operations()).await;
            for operation in open.unwrap_or_default() {
                if let Err(error) = self.follow(&operation).await {
                    warn!(%error, build = %operation.id, "a build of another planner is not listed");
                }
            }
        }
        self.jobs().all()
    }

    /// Shows a build of another planner as one of this one.
    async fn follow(&self, operation: &Operation) -> Result<Arc<Job>, PlannerError> {
        let wanted = wire::read_recipe(&operation.recipe, self.levels(), self.config()).await?;
        let (job, is_new) = self.jobs().follow(operation.id, wanted, operation.started);
        if is_new {
            job.take_requesters(&operation.requesters, operation.withdrawals.clients.len());
            job.note_known();
            self.run_job(job.clone(), Self::run_elsewhere);
        }
        Ok(job)
    }

    /// Follows a build of another planner to its end, or runs it once this one has taken it over.
    async fn run_elsewhere(self, job: Arc<Job>) -> Result<Arc<Hosted>, PlannerError> {
        let id = job.id;
        loop {
            // While the store is away, nothing is known of the build.
            let found = self.ask("the build cannot be looked up", move |replicas| replicas.operation(id)).await;
            match found {
                Ok(Some(Operation { posted, graph: Some(graph), .. })) if posted.stage == BuildPhase::Done => {
                    return self.ready(&graph.to_string()).await;
                }
                Ok(Some(Operation { failure: Some(failure), posted, .. })) if posted.stage == BuildPhase::Failed => {
                    return Err(PlannerError::RemoteBuildFailed(failure));
                }
                Ok(Some(Operation { posted, .. })) if posted.stage.is_end() => {
                    return Err(BuildError::Cancelled.into());
                }
                Ok(Some(Operation { is_ours: true, requesters, withdrawals, .. })) => {
                    job.take_requesters(&requesters, withdrawals.clients.len());
                    return self.run_posting(job).await;
                }
                Ok(Some(Operation { posted, .. })) => job.mirror(Some(posted)),
                Ok(None) => return Err(PlannerError::UnknownBuild(id.to_string())),
                Err(_) => {}
            }
            tokio::select! {
                () = tokio::time::sleep(POST_EVERY) => {}
                () = self.shutdown().wait() => return Err(PlannerError::ShuttingDown),
            }
        }
    }

    /// Takes over builds of planners that have died, and tells the others what they could not be told before.
    pub(crate) async fn adopt_orphans(&self) {
        for job in self.jobs().all().iter().filter(|job| job.end().is_some()) {
            self.post_end(job).await;
        }
        let adopted = match self.ask("builds cannot be taken over", |replicas| replicas.adopt()).await {
            Ok(adopted) => adopted,
            Err(error) => return warn!(%error, "no look for builds of planners that have died"),
        };
        for operation in adopted {
            info!(build = %operation.id, "takes over a build of a planner that has died");
            if let Err(error) = self.follow(&operation).await {
                warn!(%error, build = %operation.id, "a build cannot be taken over");
                // Nobody else would look at it, since this planner lives.
                let posted = BuildStatus { stage: BuildPhase::Failed, ..operation.posted };
                let failed = Operation { posted, failure: Some(wire::failure_of(&error)), ..operation };
                let told = self.ask("the end cannot be told", move |replicas| replicas.post(&failed)).await;
                told.map(drop).unwrap_or_else(|error| warn!(%error, "a build stays without a planner"));
            }
        }
    }
}
