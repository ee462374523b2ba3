//! The planner: holds graphs in memory, answers queries, and runs probes on demand. It uses no wire types.
//!
//! All graphs are in the store, recently used ones ([`Hosted`]) also in memory. `builds` makes new graphs; `layers` applies
//! designers' edits. Reported traversals change the costs of their edges at once; a new table of next hops follows within
//! seconds.

use crate::config::PlannerConfig;
use crate::error::PlannerError;
use crate::hosted::Hosted;
use crate::jobs::Jobs;
use crate::locks::{LevelLocks, POISON};
use crate::replicas::{Alone, Replicas, Standing};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use surefoot_net::levels::{LevelArchive, LevelStore, MapSource, SharedMap};
use surefoot_net::serving::Shutdown;
use surefoot_planner::live::{Reporter, Traversal};
use surefoot_planner::probe::{Outcome, Trial};
use surefoot_planner::reachability::{self, Difference};
use surefoot_planner::store::{Call, GraphStore};
use surefoot_planner::{GraphId, Plan, Query, Traffic, VertexId};
use surefoot_policy::Policy;
use surefoot_rollout::probe::{self, ProbeContext};
use surefoot_world::{Map, Seed, Vec3};
use tokio::runtime::Handle;
use tokio::sync::{Semaphore, watch};
use tracing::warn;

/// Delay from a report of traversals to the new table of next hops.
const REFRESH_AFTER: Duration = Duration::from_secs(2);
/// The delay is at least so many times as long as the last refresh took.
const REFRESH_PAUSE: u32 = 10;

/// Maximum number of graphs that are looked up in the store or loaded at a time while a build is running. Each generates its map.
const MAX_LOADS: usize = 2;
/// Number of maps that are kept although no graph needs them just now.
const RECENT_MAPS: usize = 2;
/// Most of the memory budget that these take: a quarter of it.
const RECENT_SHARE: u64 = 4;

/// The stores of a planner, which others may share.
pub struct PlannerStores {
    /// Graphs, layers and evidence.
    pub store: Arc<dyn GraphStore>,
    /// What planners that share it agree on.
    pub replicas: Arc<dyn Replicas>,
    /// Imported levels; `None` if they are kept in memory only.
    pub levels: Option<Arc<dyn LevelArchive>>,
}

impl<S: GraphStore + 'static> From<Box<S>> for PlannerStores {
    fn from(store: Box<S>) -> Self {
        let store: Arc<dyn GraphStore> = Arc::from(store as Box<dyn GraphStore>);
        Self { replicas: Arc::new(Alone(store.clone())), store, levels: None }
    }
}

/// A planner. Clones share all state.
#[derive(Clone)]
pub struct Planner {
    pub(crate) shared: Arc<PlannerInner>,
}

pub(crate) struct PlannerInner {
    pub config: PlannerConfig,
    pub policy: Policy,
    pub store: Arc<dyn GraphStore>,
    pub replicas: Arc<dyn Replicas>,
    /// Where tasks run that threads without a runtime start.
    pub runtime: Handle,
    pub levels: LevelStore,
    /// Graphs in memory, the most recently used last.
    ready: Mutex<VecDeque<Arc<Hosted>>>,
    pub jobs: Jobs,
    /// Permits one build at a time, because each uses all cores.
    pub build_slot: Arc<Semaphore>,
    /// Permits a few graphs at a time to be looked up in the store and loaded while a build is running.
    pub loading: Arc<Semaphore>,
    /// Permits the edits of one call at a time to be probed, because these use all cores as well.
    pub proving: Semaphore,
    pub level_locks: LevelLocks,
    /// Held while hub labels are prepared: one graph at a time.
    labelling: Mutex<()>,
    /// Limits the number of probes on demand that run at a time.
    probing: Arc<Semaphore>,
    /// Permits one graph at a time to follow an edit of its map.
    pub updating: Arc<Semaphore>,
    /// The maps that were needed last, without pieces, the latest last.
    recent_maps: Mutex<VecDeque<Arc<SharedMap>>>,
    /// Notified when another planner has published a graph, or has given up.
    pub graph_news: watch::Sender<()>,
    /// Number of plans answered.
    plans: AtomicU64,
    /// Number of graphs built here.
    pub built: AtomicU64,
    /// Number of reports that this planner has identified.
    own_calls: AtomicU64,
    pub shutdown: Shutdown,
}

impl Planner {
    /// Creates a planner that proves edges with `policy`, on the runtime that calls it.
    pub fn new(config: PlannerConfig, policy: Policy, store: PlannerStores, shutdown: Shutdown) -> Self {
        let PlannerStores { store, replicas, levels: archive } = store;
        let levels = LevelStore::new(config.max_maps, config.maps.memory().clone());
        let shared = PlannerInner {
            policy,
            store,
            runtime: Handle::current(),
            levels: match archive {
                Some(archive) => levels.archived(archive),
                None => levels,
            },
            ready: Mutex::default(),
            jobs: Jobs::new(replicas.site()),
            replicas,
            graph_news: watch::Sender::new(()),
            built: AtomicU64::new(0),
            own_calls: AtomicU64::new(0),
            build_slot: Arc::new(Semaphore::new(1)),
            loading: Arc::new(Semaphore::new(MAX_LOADS)),
            proving: Semaphore::new(1),
            level_locks: LevelLocks::default(),
            labelling: Mutex::default(),
            probing: Arc::new(Semaphore::new(config.threads.max(1))),
            config,
            updating: Arc::new(Semaphore::new(1)),
            recent_maps: Mutex::default(),
            plans: AtomicU64::new(0),
            shutdown,
        };
        Self { shared: Arc::new(shared) }
    }

    /// Returns the planner's limits and sizes.
    pub fn config(&self) -> &PlannerConfig {
        &self.shared.config
    }

    /// Returns the maps that clients imported.
    pub fn levels(&self) -> &LevelStore {
        &self.shared.levels
    }

    /// Returns the signal that is set when the service stops.
    pub fn shutdown(&self) -> &Shutdown {
        &self.shared.shutdown
    }

    /// Returns the metrics in Prometheus text format.
    pub fn metrics(&self) -> String {
        let plans = self.shared.plans.load(Ordering::Relaxed);
        let graphs = self.shared.ready.lock().expect(POISON).len();
        let builds = self.shared.jobs.open_count();
        let built = self.shared.built.load(Ordering::Relaxed);
        let Standing { holds_lease, stale_publishes } = self.shared.replicas.standing();
        let (sure, provers) = (u8::from(holds_lease), self.shared.config.provers.metrics());
        format!(
            "# HELP surefoot_plans_total Plans answered.\n# TYPE surefoot_plans_total counter\nsurefoot_plans_total {plans}\n\
             # HELP surefoot_graphs_in_memory Graphs in memory.\n# TYPE surefoot_graphs_in_memory gauge\nsurefoot_graphs_in_memory {graphs}\n\
             # HELP surefoot_builds Builds that are running or waiting.\n# TYPE surefoot_builds gauge\nsurefoot_builds {builds}\n\
             # HELP surefoot_graphs_built_total Graphs built by this planner.\n# TYPE surefoot_graphs_built_total counter\nsurefoot_graphs_built_total {built}\n\
             # HELP surefoot_lease_held Whether nobody can have taken over what this process has.\n# TYPE surefoot_lease_held gauge\nsurefoot_lease_held {sure}\n\
             # HELP surefoot_stale_publishes_total Graphs not published, because their claims had been lost.\n# TYPE surefoot_stale_publishes_total counter\nsurefoot_stale_publishes_total {stale_publishes}\n\
             {provers}"
        )
    }

    /// Checks that the service proves edges with the policy that a caller requires; an empty hash stands for any.
    ///
    /// # Errors
    /// If it has another policy.
    pub fn check_policy(&self, hash: &str) -> Result<(), PlannerError> {
        let manifest = self.shared.policy.manifest();
        if hash.is_empty() || hash == manifest.weights_hash {
            return Ok(());
        }
        Err(PlannerError::OtherPolicy {
            wanted: hash.chars().take(12).collect(),
            name: manifest.name.clone(),
            hash: manifest.weights_hash.chars().take(12).collect(),
        })
    }

    // --- maps ---

    /// The map of a source. What it was made of is kept for a while: edits, loads and probes come one after another. Call this from a thread
    /// that may block.
    pub(crate) fn map_of(&self, source: &MapSource) -> Arc<Map> {
        let maps = self.shared.config.maps.clone();
        let shared = tokio::runtime::Handle::current().block_on(maps.get("graphs", source.base()));
        // Where there is no memory to keep it, it is made for this once.
        let Ok(shared) = shared else { return source.map() };
        let mut recent = self.shared.recent_maps.lock().expect(POISON);
        recent.retain(|other| !Arc::ptr_eq(other.map(), shared.map()));
        recent.push_back(shared.clone());
        let limit = maps.memory().limit_bytes() / RECENT_SHARE;
        let bytes = |recent: &VecDeque<Arc<SharedMap>>| -> u64 {
            recent.iter().map(|shared| shared.map().memory_bytes() as u64).sum()
        };
        while recent.len() > RECENT_MAPS || bytes(&recent) > limit {
            recent.pop_front();
        }
        drop(recent);
        source.finish(shared.map())
    }

    // --- graphs in memory ---

    /// Returns a graph in memory and marks it as used.
    ///
    /// # Errors
    /// If the id is malformed, or the graph is not in memory.
    pub fn in_memory(&self, graph_id: &str) -> Result<Arc<Hosted>, PlannerError> {
        let hosted = self.find(graph_id)?;
        self.note_use(&hosted.origin.id);
        Ok(hosted)
    }

    /// Returns a graph in memory without marking it as used.
    ///
    /// # Errors
    /// If the id is malformed, or the graph is not in memory.
    pub fn find(&self, graph_id: &str) -> Result<Arc<Hosted>, PlannerError> {
        let id = GraphId::parse(graph_id).ok_or(PlannerError::BadGraphId)?;
        let ready = self.shared.ready.lock().expect(POISON);
        let found = ready.iter().find(|entry| entry.origin.id == id).cloned();
        found.ok_or_else(|| PlannerError::UnknownGraph(graph_id.to_owned()))
    }

    /// Returns all graphs in memory, the most recently used first.
    pub fn all_ready(&self) -> Vec<Arc<Hosted>> {
        self.shared.ready.lock().expect(POISON).iter().rev().cloned().collect()
    }

    /// Marks a graph as used, and returns it if it is in memory.
    pub(crate) fn note_use(&self, id: &GraphId) -> Option<Arc<Hosted>> {
        let mut ready = self.shared.ready.lock().expect(POISON);
        let at = ready.iter().position(|entry| entry.origin.id == *id)?;
        let entry = ready.remove(at)?;
        ready.push_back(entry.clone());
        Some(entry)
    }

    /// Adds a graph to those in memory, and drops the least recently used beyond the limit.
    pub(crate) fn keep_ready(&self, entry: Arc<Hosted>) {
        let mut ready = self.shared.ready.lock().expect(POISON);
        ready.retain(|other| other.origin.id != entry.origin.id);
        ready.push_back(entry.clone());
        while ready.len() > self.shared.config.graphs_in_memory {
            ready.pop_front();
        }
        drop(ready);
        self.label_later(&entry);
    }

    /// Prepares hub labels of a graph on a thread of its own, if it is too large for a table and they are missing. Meanwhile, plans are searched.
    pub(crate) fn label_later(&self, hosted: &Arc<Hosted>) {
        if !hosted.wants_labels() || hosted.is_labelling.swap(true, Ordering::Relaxed) {
            return;
        }
        let (planner, labelled) = (self.clone(), hosted.clone());
        // Not one of the runtime's threads, which would keep the service from stopping.
        let started = std::thread::Builder::new().name("labels".to_owned()).spawn(move || {
            let _turn = planner.shared.labelling.lock().expect(POISON);
            let is_due = || labelled.wants_labels() && !planner.shared.shutdown.is_triggered();
            loop {
                while is_due() {
                    labelled.prepare_labels();
                }
                labelled.is_labelling.store(false, Ordering::Relaxed);
                // Edits may have replaced in the last moment what was labelled.
                if !is_due() || labelled.is_labelling.swap(true, Ordering::Relaxed) {
                    return;
                }
            }
        });
        if let Err(error) = started {
            hosted.is_labelling.store(false, Ordering::Relaxed);
            warn!(%error, "no thread to prepare a large graph: plans on it take longer");
        }
    }

    /// Drops an interim graph from memory.
    pub(crate) fn drop_interim(&self, id: &GraphId) {
        let mut ready = self.shared.ready.lock().expect(POISON);
        ready.retain(|hosted| hosted.origin.id != *id || !hosted.is_interim());
    }

    // --- plans and reports ---

    /// Finds the cheapest plan at current costs.
    pub fn plan(&self, hosted: &Hosted, query: &Query) -> Plan {
        self.shared.plans.fetch_add(1, Ordering::Relaxed);
        hosted.plan(query)
    }

    /// Finds plans at current costs for NPCs that get in each other's way; each counts as traffic for those after it.
    pub fn plans_in(&self, hosted: &Hosted, traffic: &mut Traffic, queries: &[Query]) -> Vec<Plan> {
        self.shared.plans.fetch_add(queries.len() as u64, Ordering::Relaxed);
        hosted.plans_in(traffic, queries)
    }

    /// Adds traversals to the live evidence of a graph, and schedules a new table of next hops. Returns the number of traversals
    /// along edges that the graph has. A call that has been carried out before gets its first answer.
    ///
    /// # Errors
    /// If the id of the call was used for another one.
    pub async fn report(
        &self,
        hosted: Arc<Hosted>,
        reporter: Reporter,
        traversals: Vec<Traversal>,
        call: Option<Call>,
    ) -> Result<u32, PlannerError> {
        if let Some(call) = call.clone() {
            match self.in_store(move |planner| planner.first_answer(Some(&call))).await {
                Ok(Some(answer)) => {
                    return answer.try_into().map(u32::from_le_bytes).map_err(|_| PlannerError::BadReceipt);
                }
                // Whether it is a repeat is decided when it is stored.
                Ok(None) | Err(PlannerError::StoreUnavailable { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        let are_several = self.shared.replicas.are_several();
        // Each report is announced once, even if the first answer of the store is lost.
        let call = call.or_else(|| are_several.then(|| self.own_call()));
        let accepted = hosted.report(&reporter, &traversals, call);
        if accepted > 0 {
            if are_several {
                self.exchange_later(&hosted);
            }
            self.refresh_later(hosted);
        }
        Ok(accepted)
    }

    /// Identifies a call whose client has not: by this planner, which has an id that no other has, and a number.
    fn own_call(&self) -> Call {
        let number = self.shared.own_calls.fetch_add(1, Ordering::Relaxed);
        Call { client: String::new(), id: format!("{}-{number}", self.shared.replicas.site()), request: [0; 32] }
    }

    /// Returns the answer that a call got when it was carried out; `None` if it has not been. Call this from a thread that may block.
    ///
    /// # Errors
    /// If the id of the call was used for another one, or the store cannot be read.
    pub(crate) fn first_answer(&self, call: Option<&Call>) -> Result<Option<Vec<u8>>, PlannerError> {
        let Some(call) = call else { return Ok(None) };
        let found = self.shared.store.receipt(&call.client, &call.id);
        match found.map_err(PlannerError::store("the call cannot be looked up"))? {
            Some(receipt) if receipt.call.request != call.request => {
                Err(PlannerError::RequestIdReused(call.id.clone()))
            }
            found => Ok(found.map(|receipt| receipt.answer)),
        }
    }

    /// Calls the store on a thread that may block.
    async fn in_store<T: Send + 'static>(
        &self,
        call: impl FnOnce(&Self) -> Result<T, PlannerError> + Send + 'static,
    ) -> Result<T, PlannerError> {
        let planner = self.clone();
        tokio::task::spawn_blocking(move || call(&planner))
            .await
            .map_err(PlannerError::lost("the call of the store"))?
    }

    /// Schedules a new table of next hops, unless one is already scheduled.
    pub(crate) fn refresh_later(&self, hosted: Arc<Hosted>) {
        if hosted.refresh_is_due.swap(true, Ordering::Relaxed) {
            return;
        }
        let planner = self.clone();
        let last = Duration::from_millis(hosted.refresh_took_ms.load(Ordering::Relaxed));
        self.shared.runtime.spawn(async move {
            tokio::select! {
                () = tokio::time::sleep(REFRESH_AFTER.max(last * REFRESH_PAUSE)) => {}
                () = planner.shared.shutdown.wait() => return,
            }
            let task = tokio::task::spawn_blocking(move || {
                hosted.refresh_is_due.store(false, Ordering::Relaxed);
                let started = Instant::now();
                hosted.refresh();
                hosted.refresh_took_ms.store(started.elapsed().as_millis() as u64, Ordering::Relaxed);
                planner.store_report(&hosted);
            });
            if let Err(error) = task.await {
                warn!(%error, "graph could not be refreshed with live evidence");
            }
        });
    }

    /// Stores the live evidence of all graphs in memory, and leaves builds to other planners.
    pub(crate) fn leave(&self) {
        for hosted in self.all_ready() {
            self.store_report(&hosted);
        }
        self.shared.replicas.leave();
    }

    fn store_report(&self, hosted: &Arc<Hosted>) {
        if self.shared.replicas.are_several() {
            return self.exchange(hosted);
        }
        // These are not in the store. The next graph of an interim one's build takes its live evidence over.
        if !Self::has_row(hosted) {
            return;
        }
        let stored = hosted.store_live(|live, receipts| match live.is_empty() && receipts.is_empty() {
            true => Ok(()),
            false => self.shared.store.put_live(&hosted.origin.id, live, receipts),
        });
        if let Err(error) = stored {
            warn!(%error, "live evidence could not be stored");
        }
    }

    /// Forgets the traversals that reporters of this name reported, in plans and in the store. Returns their number.
    ///
    /// # Errors
    /// If the name is empty, or the store cannot be written; plans do not use the traversals any more, but after a restart they would.
    pub async fn drop_reports(&self, hosted: Arc<Hosted>, name: String) -> Result<u64, PlannerError> {
        if name.is_empty() {
            return Err(PlannerError::NoReporter);
        }
        let planner = self.clone();
        let task = tokio::task::spawn_blocking(move || {
            let is_shared = planner.shared.replicas.are_several() && Self::has_row(&hosted);
            if is_shared {
                hosted.drop_unsent(&name);
                let dropped = planner.shared.replicas.drop_evidence(&hosted.origin.id, &name);
                dropped.map_err(PlannerError::store("the reports cannot be removed"))?;
            }
            let dropped = hosted.drop_reports(&name);
            hosted.refresh();
            if is_shared {
                return Ok(dropped);
            }
            let put = |live: &_, receipts: &[_]| planner.shared.store.put_live(&hosted.origin.id, live, receipts);
            let stored = hosted.store_live(put);
            stored.map_err(PlannerError::store("the remaining reports cannot be stored"))?;
            Ok(dropped)
        });
        task.await.map_err(PlannerError::lost("the removal"))?
    }

    /// Compares two graphs.
    ///
    /// # Errors
    /// If the comparison panics.
    pub async fn compare(&self, before: Arc<Hosted>, after: Arc<Hosted>) -> Result<Difference, PlannerError> {
        let task = tokio::task::spawn_blocking(move || {
            before.with_graph(|before| after.with_graph(|after| reachability::compare(before, after)))
        });
        task.await.map_err(PlannerError::lost("the comparison"))
    }

    // --- probes on demand ---

    /// Runs the policy once between two vertices. Returns the outcome, and the positions of the feet at the start and after every
    /// tick, m.
    ///
    /// # Errors
    /// If the graph has no such vertex, or the probe does not complete.
    pub async fn probe(
        &self,
        hosted: Arc<Hosted>,
        from: VertexId,
        to: VertexId,
        Seed(seed): Seed,
    ) -> Result<(Outcome, Vec<Vec3>), PlannerError> {
        let position = |vertex: VertexId, field| {
            hosted.with_graph(|graph| {
                let count = graph.vertex_count();
                let found = graph.has_vertex(vertex).then(|| graph.position(vertex));
                found.ok_or(PlannerError::UnknownVertex { field, vertex, count })
            })
        };
        let trial = Trial {
            start: position(from, "from")?,
            via: None,
            goal: position(to, "to")?,
            stream: 0,
            on_foot: false,
            keep_track: false,
            held: None,
            ride: None,
        };
        let Ok(permit) = self.shared.probing.clone().acquire_owned().await else {
            return Err(PlannerError::ShuttingDown);
        };
        let planner = self.clone();
        let task = tokio::task::spawn_blocking(move || {
            // Held until the probe is complete, even if the caller is gone.
            let _permit = permit;
            let context = planner.context_of(&hosted);
            Ok(probe::replay(&context, &trial, seed))
        });
        task.await.map_err(PlannerError::lost("the probe"))?
    }

    /// Returns the context of probes on a graph's map.
    fn context_of(&self, hosted: &Hosted) -> ProbeContext {
        let map = self.map_of(&hosted.origin.source);
        ProbeContext { map, profile: hosted.origin.body.clone(), policy: self.shared.policy.clone() }
    }
}
