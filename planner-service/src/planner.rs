//! The planner without its transport: finds plans in graphs and runs single probes. It uses no wire types.
//!
//! Its parts, from the bottom up: [`GraphCache`] has the graphs in memory, [`LayerEditor`] applies designers' edits to
//! them, [`Reports`] live evidence. [`BuildRunner`] makes graphs, and [`Peers`] has the builds of all planners.

use crate::builds::BuildRunner;
use crate::config::PlannerConfig;
use crate::error::PlannerError;
use crate::graphs::GraphCache;
use crate::hosted::Hosted;
use crate::jobs::Jobs;
use crate::layers::LayerEditor;
use crate::maps::RecentMaps;
use crate::peers::Peers;
use crate::replicas::Standing;
use crate::reports::Reports;
use crate::stores::PlannerStores;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use surefoot_net::levels::LevelStore;
use surefoot_net::metrics::family;
use surefoot_net::serving::Shutdown;
use surefoot_planner::probe::{Outcome, Trial};
use surefoot_planner::reachability::{self, Difference};
use surefoot_planner::{GraphId, Plan, Query, Traffic, VertexId};
use surefoot_policy::Policy;
use surefoot_rollout::probe::{self, ProbeContext};
use surefoot_world::map::LevelFrame;
use surefoot_world::{Seed, Vec3};
use tokio::sync::Semaphore;
use tokio::task::spawn_blocking;

/// A planner. Clones share all state.
#[derive(Clone)]
pub struct Planner {
    pub(crate) graphs: Arc<GraphCache>,
    pub(crate) layers: Arc<LayerEditor>,
    pub(crate) reports: Arc<Reports>,
    pub(crate) peers: Arc<Peers>,
    policy: Policy,
    pub(crate) maps: Arc<RecentMaps>,
    /// Limits the number of probes on demand that run at a time.
    probing: Arc<Semaphore>,
    pub(crate) plans: Arc<AtomicU64>,
}

impl Planner {
    /// Creates a planner that proves edges with `policy`, on the runtime that calls it.
    pub fn new(config: PlannerConfig, policy: Policy, stores: PlannerStores, shutdown: Shutdown) -> Self {
        let levels = LevelStore::new(config.max_maps, config.maps.memory().clone());
        let levels = match stores.levels.clone() {
            Some(archive) => levels.archived(archive),
            None => levels,
        };
        let graphs = Arc::new(GraphCache::new(config.graphs_in_memory, shutdown.clone()));
        let layers = Arc::new(LayerEditor::new(stores.clone(), graphs.clone(), shutdown.clone()));
        let reports = Arc::new(Reports::new(stores.clone(), shutdown.clone()));
        let maps = RecentMaps::new(config.maps.clone());
        let changes = (layers.clone(), reports.clone());
        let runner =
            BuildRunner::new((config.clone(), policy.clone()), stores.clone(), graphs.clone(), changes, maps.clone());
        let probing = Arc::new(Semaphore::new(config.threads.max(1)));
        let peers = Peers {
            jobs: Jobs::new(stores.replicas.as_ref().map_or(0, |replicas| replicas.site())),
            config,
            levels,
            stores,
            graphs: graphs.clone(),
            layers: layers.clone(),
            reports: reports.clone(),
            runner: Arc::new(runner),
            shutdown,
        };
        Self { graphs, layers, reports, peers: Arc::new(peers), policy, maps, probing, plans: Arc::default() }
    }

    pub fn config(&self) -> &PlannerConfig {
        &self.peers.config
    }

    pub fn levels(&self) -> &LevelStore {
        &self.peers.levels
    }

    pub fn shutdown(&self) -> &Shutdown {
        &self.peers.shutdown
    }

    /// How this planner stands among those that share its store.
    pub(crate) fn standing(&self) -> Standing {
        let alone = Standing { holds_lease: true, stale_publishes: 0 };
        self.peers.stores.replicas.as_ref().map_or(alone, |replicas| replicas.standing())
    }

    /// Returns the metrics in Prometheus text format.
    pub fn metrics(&self) -> String {
        let Standing { holds_lease, stale_publishes } = self.standing();
        let lease = "Whether this process holds its lease, so that no other can have taken over its work.";
        let stale = "Graphs that were not published because their claims had been lost.";
        let metrics = [
            ("plans_total", "counter", "Plans answered.", self.plans.load(Ordering::Relaxed)),
            ("graphs_in_memory", "gauge", "Graphs in memory.", self.graphs.len() as u64),
            ("builds", "gauge", "Builds that are running or waiting.", self.peers.jobs.open_count() as u64),
            ("graphs_built_total", "counter", "Graphs built by this planner.", self.peers.runner.built_count()),
            ("lease_held", "gauge", lease, u64::from(holds_lease)),
            ("stale_publishes_total", "counter", stale, stale_publishes),
        ];
        let metrics = metrics.map(|(name, kind, help, value)| family(name, kind, help, [("", value as f64)]));
        metrics.concat() + &self.config().provers.metrics()
    }

    /// Checks that the service proves edges with the policy that a caller requires; an empty hash stands for any.
    pub fn check_policy(&self, hash: &str) -> Result<(), PlannerError> {
        let manifest = self.policy.manifest();
        if hash.is_empty() || hash == manifest.weights_hash {
            return Ok(());
        }
        Err(PlannerError::OtherPolicy {
            wanted: hash.chars().take(12).collect(),
            name: manifest.name.clone(),
            hash: manifest.weights_hash.chars().take(12).collect(),
        })
    }

    /// Returns a graph that may be used for plans, and marks it as used. A graph of another planner is loaded.
    pub async fn get_usable(&self, graph_id: &str) -> Result<Arc<Hosted>, PlannerError> {
        let hosted = self.get_or_load(graph_id).await?;
        hosted.check_layers()?;
        Ok(hosted)
    }

    /// Like [`get_usable`](Self::get_usable), but also returns a graph whose layers could not be read.
    pub async fn get_or_load(&self, graph_id: &str) -> Result<Arc<Hosted>, PlannerError> {
        self.peers.get_or_load(GraphId::parse(graph_id).ok_or(PlannerError::BadGraphId)?).await
    }

    /// Finds the cheapest plan at current costs.
    pub fn plan(&self, hosted: &Arc<Hosted>, query: &Query) -> Plan {
        self.plans.fetch_add(1, Ordering::Relaxed);
        let plan = hosted.plan(query);
        self.label_zones(hosted, std::slice::from_ref(query));
        plan
    }

    /// Prepares hub labels in the background if queries use their zones often.
    fn label_zones(&self, hosted: &Arc<Hosted>, queries: &[Query]) {
        if queries.iter().any(|query| !query.zones.is_empty()) {
            self.graphs.label_later(hosted);
        }
    }

    /// Finds plans at current costs for NPCs that obstruct each other; each counts as traffic for those after it.
    pub fn plans_in(&self, hosted: &Arc<Hosted>, traffic: &mut Traffic, queries: &[Query]) -> Vec<Plan> {
        self.plans.fetch_add(queries.len() as u64, Ordering::Relaxed);
        let plans = hosted.plans_in(traffic, queries);
        self.label_zones(hosted, queries);
        plans
    }

    /// How the coordinates of a graph's level relate to its map's.
    pub fn frame_of(&self, hosted: &Hosted) -> LevelFrame {
        self.levels().frame_of(hosted.origin.source.base())
    }

    pub async fn compare(&self, before: Arc<Hosted>, after: Arc<Hosted>) -> Result<Difference, PlannerError> {
        let frames = [self.frame_of(&before), self.frame_of(&after)];
        let task = spawn_blocking(move || {
            before.with_graph(|before| {
                after.with_graph(|after| reachability::compare_levels((before, &frames[0]), (after, &frames[1])))
            })
        });
        task.await.map_err(PlannerError::lost("the comparison"))
    }

    /// Runs the policy once between two vertices. Returns the outcome, and the positions of the feet at the start and
    /// after every tick, m.
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
        let trial = Trial::walk(position(from, "from")?, position(to, "to")?, 0);
        let Ok(permit) = self.probing.clone().acquire_owned().await else {
            return Err(PlannerError::ShuttingDown);
        };
        let planner = self.clone();
        let task = spawn_blocking(move || {
            // Held until the probe is complete, even if the caller is gone.
            let _permit = permit;
            let map = planner.maps.get(&hosted.origin.source);
            let context = ProbeContext { map, profile: hosted.origin.body.clone(), policy: planner.policy.clone() };
            Ok(probe::replay(&context, &trial, seed))
        });
        task.await.map_err(PlannerError::lost("the probe"))?
    }

    /// Cancels all builds, stores the live evidence of all graphs in memory, and leaves its builds to other planners.
    pub(crate) async fn leave(self) {
        self.peers.jobs.all().iter().for_each(|job| job.cancel());
        let leaving = spawn_blocking(move || {
            self.graphs.all().iter().for_each(|hosted| self.reports.save(hosted));
            if let Some(replicas) = &self.peers.stores.replicas {
                replicas.leave();
            }
        });
        // It fails only by a panic, which the panic hook reports.
        let _ = leaving.await;
    }
}
