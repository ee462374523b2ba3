//! What other planners that share the store have changed: graphs in memory follow, and so does everybody who watches them.

use crate::error::PlannerError;
use crate::hosted::{Hosted, Prepared, Provenance, Revision};
use crate::jobs::SERVICE;
use crate::locks::POISON;
use crate::planner::Planner;
use crate::replicas::News;
use crate::wire;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use surefoot_planner::store::LevelId;
use surefoot_planner::{GraphId, Progress};
use tokio::sync::Semaphore;
use tracing::warn;

/// Delay from a report of traversals until other planners are told; what is reported meanwhile goes with it.
const EXCHANGE_AFTER: Duration = Duration::from_millis(20);
/// The same while the store is away.
const EXCHANGE_AGAIN: Duration = Duration::from_secs(1);
/// News that are followed at a time. Others wait in the queue, which holds back the store's connection when it is full.
const FOLLOWED_AT_A_TIME: usize = 4;

impl Planner {
    /// Returns a graph that may be used for plans, and marks it as used. One that is not in memory is loaded if another planner made it.
    ///
    /// # Errors
    /// If the id is malformed, no planner has the graph, its layers could not be read, or the store is away.
    pub async fn usable(&self, graph_id: &str) -> Result<Arc<Hosted>, PlannerError> {
        let hosted = self.ready(graph_id).await?;
        hosted.check_layers()?;
        Ok(hosted)
    }

    /// The same, also if its layers could not be read.
    ///
    /// # Errors
    /// If the id is malformed, no planner has the graph, or the store is away.
    pub async fn ready(&self, graph_id: &str) -> Result<Arc<Hosted>, PlannerError> {
        let found = self.in_memory(graph_id);
        let (Err(PlannerError::UnknownGraph(_)), Some(id)) = (&found, GraphId::parse(graph_id)) else { return found };
        if !self.shared.replicas.are_several() {
            return found;
        }
        let recipe = self.ask("the graph cannot be loaded", move |replicas| replicas.recipe(&id)).await?;
        let Some(recipe) = recipe else { return found };
        let wanted = wire::read_recipe(&recipe, self.levels(), self.config()).await?;
        let job = self.start_build(wanted, SERVICE)?;
        tokio::select! {
            () = job.ended() => {}
            () = self.shared.shutdown.wait() => return Err(PlannerError::ShuttingDown),
        }
        // A planner with another policy makes another graph of the same map.
        job.end().unwrap_or(Err(PlannerError::ShuttingDown))?;
        self.in_memory(graph_id)
    }

    /// Follows news of other planners until the service stops.
    pub(crate) async fn follow_news(self) {
        let Some(mut news) = self.shared.replicas.news() else { return };
        let turns = Arc::new(Semaphore::new(FOLLOWED_AT_A_TIME));
        loop {
            let latest = tokio::select! {
                latest = news.recv() => latest,
                () = self.shared.shutdown.wait() => return,
            };
            let Some(latest) = latest else { return };
            if matches!(latest, News::Graph(_) | News::Everything) {
                self.shared.graph_news.send_replace(());
            }
            // Never closed.
            let Ok(turn) = turns.clone().acquire_owned().await else { return };
            let planner = self.clone();
            tokio::spawn(async move {
                let _turn = turn;
                planner.follow_one(latest).await;
            });
        }
    }

    async fn follow_one(&self, news: News) {
        match news {
            News::Graph(_) => {}
            News::Orphans => self.adopt_orphans().await,
            News::Layers(level) => self.in_background(move |planner| planner.renew_layers(&level)).await,
            News::Evidence(id) => {
                if let Some(hosted) = self.all_ready().into_iter().find(|hosted| hosted.origin.id == id) {
                    self.in_background(move |planner| planner.exchange(&hosted)).await;
                }
            }
            News::Everything => {
                let planner = self.clone();
                self.in_background(move |_| {
                    let all = planner.all_ready();
                    let levels: BTreeSet<LevelId> = all.iter().map(|hosted| hosted.level()).collect();
                    levels.iter().for_each(|level| planner.renew_layers(level));
                    all.iter().for_each(|hosted| planner.exchange(hosted));
                })
                .await;
            }
        }
    }

    async fn in_background(&self, work: impl FnOnce(&Self) + Send + 'static) {
        let planner = self.clone();
        if let Err(error) = tokio::task::spawn_blocking(move || work(&planner)).await {
            warn!(%error, "news of other planners were not followed");
        }
    }

    /// Applies the layers of a level as they are now to its graphs in memory. If they cannot be read, the graphs stay as they are: the news
    /// come again when the store is back.
    fn renew_layers(&self, level: &LevelId) {
        let progress = Arc::new(Progress::default());
        let lock = self.shared.level_locks.of(level);
        loop {
            let stored = match self.shared.store.layers(level) {
                Ok(stored) => stored,
                Err(error) => return warn!(%error, "layers that others have changed cannot be read"),
            };
            // A graph that is being loaded with older layers is in memory once the lock is free.
            drop(lock.lock().expect(POISON));
            let graphs: Vec<_> = self.all_ready().into_iter().filter(|hosted| hosted.level() == *level).collect();
            let layers = crate::layers::readable(stored.clone());
            let revision = layers.as_ref().ok().map(|layers| Revision::of(layers));
            let is_old = |hosted: &&Arc<Hosted>| {
                revision.is_none_or(|now| now != hosted.revision()) || hosted.check_layers().is_err()
            };
            let prepare = |hosted: &Arc<Hosted>| Some((hosted.clone(), hosted.prepare(layers.clone(), &progress)?));
            let prepared: Vec<(Arc<Hosted>, Prepared)> = graphs.iter().filter(is_old).filter_map(prepare).collect();
            let _held = lock.lock().expect(POISON);
            match self.shared.store.layers(level) {
                Ok(now) if now == stored => {}
                Ok(_) => continue,
                Err(error) => return warn!(%error, "layers that others have changed cannot be read"),
            }
            for (hosted, prepared) in prepared {
                hosted.apply(prepared);
                self.label_later(&hosted);
            }
            return;
        }
    }

    /// Schedules an exchange of evidence with the other planners, unless one is scheduled or there is nothing to tell.
    pub(crate) fn exchange_later(&self, hosted: &Arc<Hosted>) {
        let is_shared = self.shared.replicas.are_several() && Self::has_row(hosted);
        if !is_shared || !hosted.has_unsent() || hosted.exchange_is_due.swap(true, Ordering::Relaxed) {
            return;
        }
        let (planner, hosted) = (self.clone(), hosted.clone());
        self.shared.runtime.spawn(async move {
            let mut pause = EXCHANGE_AFTER;
            loop {
                tokio::select! {
                    () = tokio::time::sleep(pause) => {}
                    // What has been reported is sent at the end of the service.
                    () = planner.shared.shutdown.wait() => return,
                }
                hosted.exchange_is_due.store(false, Ordering::Relaxed);
                let due = hosted.clone();
                planner.in_background(move |planner| planner.exchange(&due)).await;
                if !hosted.has_unsent() || hosted.exchange_is_due.swap(true, Ordering::Relaxed) {
                    return;
                }
                pause = EXCHANGE_AGAIN;
            }
        });
    }

    /// Exchanges the evidence of a graph with the other planners. Call this from a thread that may block.
    pub(crate) fn exchange(&self, hosted: &Arc<Hosted>) {
        if !Self::has_row(hosted) {
            return;
        }
        let (id, shared) = (&hosted.origin.id, &self.shared);
        match hosted.exchange(|counts| shared.replicas.add_evidence(id, counts), || shared.store.live(id)) {
            Ok(true) => self.refresh_later(hosted.clone()),
            Ok(false) => {}
            Err(error) => warn!(%error, "live evidence was not exchanged with other planners"),
        }
    }

    /// Whether the evidence of a graph is stored.
    pub(crate) fn has_row(hosted: &Hosted) -> bool {
        !matches!(hosted.provenance, Provenance::Interim | Provenance::Updated)
    }
}
