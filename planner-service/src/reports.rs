//! Live evidence: traversals that NPCs report change the costs of their edges at once. A new router follows
//! within seconds. Planners that share a store exchange their evidence through it.

use crate::error::PlannerError;
use crate::hosted::Hosted;
use crate::replicas::Replicas;
use crate::stores::PlannerStores;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use surefoot_net::serving::Shutdown;
use surefoot_planner::live::{Reporter, Traversal};
use surefoot_planner::store::Call;
use tokio::runtime::Handle;
use tokio::task::spawn_blocking;
use tracing::warn;

/// Shortest delay from a report of traversals to the new router.
const REFRESH_AFTER: Duration = Duration::from_secs(2);
/// The delay is at least this many times as long as the last refresh took.
const REFRESH_PAUSE: u32 = 10;
/// Delay from a report of traversals to the exchange with other planners, which includes later reports.
const EXCHANGE_AFTER: Duration = Duration::from_millis(20);
/// Pause before the exchange is tried again while the store is unavailable.
const EXCHANGE_AGAIN: Duration = Duration::from_secs(1);

/// Takes in reports of traversals, and stores them.
pub(crate) struct Reports {
    stores: PlannerStores,
    /// Runs tasks that threads outside of the runtime start.
    runtime: Handle,
    /// Number of calls that this planner has given an id.
    own_calls: AtomicU64,
    shutdown: Shutdown,
}

impl Reports {
    /// Creates the reports of a planner on the runtime that calls it.
    pub fn new(stores: PlannerStores, shutdown: Shutdown) -> Self {
        Self { stores, runtime: Handle::current(), own_calls: AtomicU64::new(0), shutdown }
    }

    /// The planners that share the evidence of a graph. Interim and updated graphs are not in the store.
    fn sharers(&self, hosted: &Hosted) -> Option<&Arc<dyn Replicas>> {
        self.stores.replicas.as_ref().filter(|_| hosted.is_stored())
    }

    /// Adds traversals to the live evidence of a graph, and schedules a new router. Returns the number of
    /// traversals along edges that the graph has. A repeated call gets its first answer.
    pub async fn add(
        self: &Arc<Self>,
        hosted: Arc<Hosted>,
        reporter: &Reporter,
        traversals: &[Traversal],
        call: Option<Call>,
    ) -> Result<u32, PlannerError> {
        if let Some(call) = call.clone() {
            let stores = self.stores.clone();
            let found = spawn_blocking(move || stores.first_answer(Some(&call))).await;
            match found.map_err(PlannerError::lost("the call of the store"))? {
                Ok(Some(answer)) => {
                    return answer.try_into().map(u32::from_le_bytes).map_err(|_| PlannerError::BadReceipt);
                }
                // Storing the report detects repeats again.
                Ok(None) | Err(PlannerError::StoreUnavailable { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        // With an id, a shared store counts each report once, even if its first answer is lost.
        let call = call.or_else(|| self.stores.replicas.as_ref().map(|replicas| self.own_call(replicas.site())));
        let accepted = hosted.report(reporter, traversals, call);
        if accepted > 0 {
            self.exchange_later(&hosted);
            self.refresh_later(hosted);
        }
        Ok(accepted)
    }

    /// Gives an id to a call whose client has not: `site`, which no other planner has, and a number.
    fn own_call(&self, site: u64) -> Call {
        let number = self.own_calls.fetch_add(1, Ordering::Relaxed);
        Call { client: String::new(), id: format!("{site}-{number}"), request: [0; 32] }
    }

    /// Schedules a new router, unless one is already scheduled.
    fn refresh_later(self: &Arc<Self>, hosted: Arc<Hosted>) {
        if hosted.refresh_is_due.swap(true, Ordering::Relaxed) {
            return;
        }
        let reports = self.clone();
        let last = Duration::from_millis(hosted.refresh_took_ms.load(Ordering::Relaxed));
        self.runtime.spawn(async move {
            tokio::select! {
                () = tokio::time::sleep(REFRESH_AFTER.max(last * REFRESH_PAUSE)) => {}
                () = reports.shutdown.wait() => return,
            }
            let task = spawn_blocking(move || {
                hosted.refresh_is_due.store(false, Ordering::Relaxed);
                let started = Instant::now();
                hosted.refresh();
                hosted.refresh_took_ms.store(started.elapsed().as_millis() as u64, Ordering::Relaxed);
                reports.save(&hosted);
            });
            if let Err(error) = task.await {
                warn!(%error, "planner: the refresh of a graph with live evidence failed; its table stays as it was");
            }
        });
    }

    /// Stores the live evidence of a graph, or exchanges it with other planners. Call this from a thread that may
    /// block.
    pub fn save(self: &Arc<Self>, hosted: &Arc<Hosted>) {
        if self.stores.replicas.is_some() {
            return self.exchange(hosted);
        }
        // The next graph of the same build takes over the evidence of an interim one.
        if !hosted.is_stored() {
            return;
        }
        let stored = hosted.store_live(|live, receipts| match live.is_empty() && receipts.is_empty() {
            true => Ok(()),
            false => self.stores.store.put_live(&hosted.origin.id, live, receipts),
        });
        if let Err(error) = stored {
            warn!(%error, id = %hosted.origin.id, "planner: cannot store live evidence; a restart would lose it");
        }
    }

    /// Schedules an exchange of evidence with other planners, if they do not have all of it.
    pub fn exchange_later(self: &Arc<Self>, hosted: &Arc<Hosted>) {
        let is_due = |hosted: &Hosted| hosted.has_unsent() && !hosted.exchange_is_due.swap(true, Ordering::Relaxed);
        if self.sharers(hosted).is_none() || !is_due(hosted) {
            return;
        }
        let (reports, hosted) = (self.clone(), hosted.clone());
        self.runtime.spawn(async move {
            let mut pause = EXCHANGE_AFTER;
            loop {
                tokio::select! {
                    () = tokio::time::sleep(pause) => {}
                    // The service exchanges the rest when it stops.
                    () = reports.shutdown.wait() => return,
                }
                hosted.exchange_is_due.store(false, Ordering::Relaxed);
                let (reports, due) = (reports.clone(), hosted.clone());
                // It panics only if `exchange` does, which the panic hook reports.
                let _ = spawn_blocking(move || reports.exchange(&due)).await;
                if !is_due(&hosted) {
                    return;
                }
                pause = EXCHANGE_AGAIN;
            }
        });
    }

    /// Exchanges the evidence of a graph with other planners. Call this from a thread that may block.
    pub fn exchange(self: &Arc<Self>, hosted: &Arc<Hosted>) {
        let Some(replicas) = self.sharers(hosted) else { return };
        let id = &hosted.origin.id;
        match hosted.exchange(|reports| replicas.add_evidence(id, reports), || self.stores.store.live(id)) {
            Ok(true) => self.refresh_later(hosted.clone()),
            Ok(false) => {}
            Err(error) => warn!(%error, %id, "planner: cannot exchange live evidence with other planners"),
        }
    }

    /// Forgets the traversals that reporters of this name reported, in plans and in the store. Returns their number. If
    /// the store cannot be written, plans ignore the traversals until a restart.
    pub async fn drop_of(&self, hosted: Arc<Hosted>, name: String) -> Result<u64, PlannerError> {
        if name.is_empty() {
            return Err(PlannerError::NoReporter);
        }
        let (stores, sharers) = (self.stores.clone(), self.sharers(&hosted).cloned());
        let task = spawn_blocking(move || {
            let id = &hosted.origin.id;
            if let Some(replicas) = &sharers {
                hosted.drop_unsent(&name);
                let dropped = replicas.drop_evidence(id, &name);
                dropped.map_err(PlannerError::store("the reports cannot be removed"))?;
            }
            let dropped = hosted.drop_reports(&name);
            hosted.refresh();
            if sharers.is_none() {
                let stored = hosted.store_live(|live, receipts| stores.store.put_live(id, live, receipts));
                stored.map_err(PlannerError::store("the remaining reports cannot be stored"))?;
            }
            Ok(dropped)
        });
        task.await.map_err(PlannerError::lost("the removal"))?
    }
}
