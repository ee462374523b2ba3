//! One graph in memory: the proved graph, the layers and live evidence that apply to it, and the router that results.

use crate::error::PlannerError;
use crate::figures::{Figures, Summary};
use crate::origin::{MARGIN_M, Origin};
use crate::probe_cache::ProbeCache;
use crate::replicas::Report;
use crate::revision::Revision;
use parking_lot::{Mutex, RwLock};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64};
use surefoot_planner::EdgeCosts;
use surefoot_planner::edits::{Edited, Layer, Unapplied, apply_layers};
use surefoot_planner::live::{Counts, LiveEvidence, Reported, Reporter, Traversal};
use surefoot_planner::store::{Call, LevelId, Receipt};
use surefoot_planner::{BuildStats, Built, EdgeKey, NavGraph, Plan, Progress, Query, Router, Traffic, VertexId};
use surefoot_world::Vec3;
use surefoot_world::map::LevelFrame;
use tokio::sync::watch;

/// Largest number of traversals that wait to be stored. Further ones count only in this process.
const MAX_UNSENT: usize = 1 << 16;

/// Origin of a graph in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Provenance {
    /// A build that has ended.
    Built,
    /// A build that is still running.
    Interim,
    /// The graph of the same map with other pieces.
    Updated,
    /// The store.
    Stored,
}

/// A graph in memory.
#[derive(Debug)]
pub struct Hosted {
    /// Map, body and settings of the graph, and what editing and searching it needs.
    pub origin: Origin,
    pub stats: BuildStats,
    pub provenance: Provenance,
    proved: NavGraph,
    view: RwLock<Arc<View>>,
    /// Shared with the earlier graphs of the same build.
    live: Arc<Mutex<LiveEvidence>>,
    /// Reports that are not stored yet. Their traversals are part of `live`.
    unsent: Arc<Mutex<Vec<Report>>>,
    /// Held while evidence is exchanged with other planners.
    exchanging: Mutex<()>,
    probes: Arc<ProbeCache>,
    /// Held while a new view is made and while live evidence is stored, so that an older one never replaces a newer
    /// one.
    updating: Mutex<()>,
    pub exchange_is_due: AtomicBool,
    pub refresh_is_due: AtomicBool,
    /// Duration of the latest refresh, ms.
    pub refresh_took_ms: AtomicU64,
    pub is_labelling: AtomicBool,
    /// Notified whenever plans may change.
    changes: watch::Sender<()>,
}

/// An immutable snapshot of a graph, except for `repriced`. Readers keep the old snapshot while a new one is made.
#[derive(Debug)]
struct View {
    router: Router,
    edited: Edited,
    layers: Vec<Layer>,
    revision: Revision,
    connected: f64,
    /// Why the graph refuses plans: its layers cannot be read.
    refusal: Option<PlannerError>,
    /// Costs of edges that have changed since the router was made. A search uses a snapshot: the lock is held briefly.
    repriced: RwLock<Arc<EdgeCosts>>,
}

/// A proved graph with layers applied to it, before plans use it.
#[derive(Debug)]
pub struct Prepared {
    edited: Edited,
    layers: Vec<Layer>,
    connected: f64,
    refusal: Option<PlannerError>,
}

impl Prepared {
    /// Applies the layers of a level to a proved graph; runs only probes that `probes` does not have. If the layers
    /// could not be read, the graph stays as it was proved and refuses plans with that error. Returns `None` if
    /// `progress` was cancelled.
    pub fn new(
        origin: &Origin,
        proved: &NavGraph,
        probes: &ProbeCache,
        layers: Result<Vec<Layer>, PlannerError>,
        progress: &Arc<Progress>,
    ) -> Option<Self> {
        let (layers, refusal) = layers.map_or_else(|error| (Vec::new(), Some(error)), |layers| (layers, None));
        let terrain = probes.terrain(origin, progress);
        let edited = apply_layers(proved, &layers, origin.settings.threshold, &terrain)?;
        Some(Self { connected: edited.graph.connected_share(), edited, layers, refusal })
    }
}

/// What the graphs of one build share: live evidence, results of edits, and watchers.
#[derive(Debug, Default)]
pub struct CarriedOver {
    live: Arc<Mutex<LiveEvidence>>,
    unsent: Arc<Mutex<Vec<Report>>>,
    /// Results of edits.
    pub probes: Arc<ProbeCache>,
    changes: watch::Sender<()>,
}

impl CarriedOver {
    /// Starts with live evidence.
    pub fn of(live: LiveEvidence) -> Self {
        Self { live: Arc::new(Mutex::new(live)), ..Self::default() }
    }
}

impl Hosted {
    /// Applies live evidence to a proved graph with layers, and prepares it for queries.
    pub fn new(
        origin: Origin,
        Built { graph: proved, stats }: Built,
        provenance: Provenance,
        CarriedOver { live, unsent, probes, changes }: CarriedOver,
        prepared: Prepared,
    ) -> Self {
        let view = View::new(&origin, prepared, &live.lock().clone());
        Self {
            origin,
            stats,
            provenance,
            proved,
            view: RwLock::new(Arc::new(view)),
            live,
            unsent,
            exchanging: Mutex::default(),
            probes,
            updating: Mutex::default(),
            exchange_is_due: AtomicBool::new(false),
            refresh_is_due: AtomicBool::new(false),
            refresh_took_ms: AtomicU64::new(0),
            is_labelling: AtomicBool::new(false),
            changes,
        }
    }

    /// What the next graph of the same build takes over.
    pub fn carry_over(&self) -> CarriedOver {
        // Layers may give other vertices these indices in the next graph.
        self.live.lock().keep_below(self.proved.vertex_count());
        CarriedOver {
            live: self.live.clone(),
            unsent: self.unsent.clone(),
            probes: self.probes.clone(),
            changes: self.changes.clone(),
        }
    }

    /// Whether the build of the graph is still running.
    pub fn is_interim(&self) -> bool {
        self.provenance == Provenance::Interim
    }

    /// Whether the graph and its evidence are in the store.
    pub fn is_stored(&self) -> bool {
        !matches!(self.provenance, Provenance::Interim | Provenance::Updated)
    }

    /// Notifies all watchers that plans may change.
    pub fn announce(&self) {
        self.changes.send_replace(());
    }

    /// Checks that the graph may be used for plans. While its layers could not be read, forbidden edges are unknown.
    pub fn check_layers(&self) -> Result<(), PlannerError> {
        self.view().refusal.clone().map_or(Ok(()), Err)
    }

    /// How the coordinates of the level relate to the map's, as they were when the graph was made.
    pub fn frame(&self) -> LevelFrame {
        self.origin.source.base().frame()
    }

    /// Checks that a point lies in the map or within [`MARGIN_M`] of it; `field` names it.
    pub fn check_inside(&self, point: Vec3, field: &'static str) -> Result<(), PlannerError> {
        let extent = self.origin.extent;
        let (low, high) = (Vec3::splat(-MARGIN_M), extent + MARGIN_M);
        if point.cmpge(low).all() && point.cmple(high).all() {
            return Ok(());
        }
        let frame = self.frame();
        Err(PlannerError::OutsideMap { field, place: frame.describe(point), span: frame.describe_span(extent) })
    }

    /// Returns a receiver that is notified whenever plans may change, and closed when the graph is dropped.
    pub fn changes(&self) -> watch::Receiver<()> {
        self.changes.subscribe()
    }

    /// The graph as it was proved, without layers and live evidence.
    pub fn proved(&self) -> &NavGraph {
        &self.proved
    }

    /// Returns the revision of the layers.
    pub fn revision(&self) -> Revision {
        self.view().revision
    }

    /// Returns the level whose layers apply to the graph.
    pub fn level(&self) -> LevelId {
        self.origin.level()
    }

    fn view(&self) -> Arc<View> {
        self.view.read().clone()
    }

    /// Finds the cheapest plan at current costs.
    pub fn plan(&self, query: &Query) -> Plan {
        let view = self.view();
        view.router.find_path_at(query, &view.costs())
    }

    /// Finds plans at current costs for NPCs that obstruct each other.
    pub fn plans_in(&self, traffic: &mut Traffic, queries: &[Query]) -> Vec<Plan> {
        let view = self.view();
        let costs = view.costs();
        queries.iter().map(|query| view.router.find_path_in(traffic, query, &costs)).collect()
    }

    /// Calls `read` with the router and the current costs.
    pub fn with_router<T>(&self, read: impl FnOnce(&Router, &EdgeCosts) -> T) -> T {
        let view = self.view();
        read(&view.router, &view.costs())
    }

    /// Adds traversals to the live evidence and reprices their edges. Returns the number of traversals along edges
    /// that the graph has. With a `call`, the next exchange or [`store_live`](Self::store_live) stores them with its
    /// receipt.
    pub fn report(&self, reporter: &Reporter, traversals: &[Traversal], call: Option<Call>) -> u32 {
        let view = self.view();
        let mut live = self.live.lock();
        let mut accepted = 0;
        {
            let mut costs = view.repriced.write();
            for traversal in traversals {
                let Some(cost) = live.note(&view.edited.graph, reporter, traversal) else { continue };
                Arc::make_mut(&mut costs).insert(traversal.edge, cost);
                accepted += 1;
            }
        }
        if let Some(call) = call.filter(|_| accepted > 0) {
            self.store_later(call, accepted, reporter, traversals);
        }
        accepted
    }

    /// Queues a report to be stored, with its traversals along proved edges. Edges that layers add may differ in other
    /// planners.
    fn store_later(&self, call: Call, accepted: u32, reporter: &Reporter, traversals: &[Traversal]) {
        let count = self.proved.vertex_count();
        let is_proved = |traversal: &&Traversal| traversal.edge.from.idx().max(traversal.edge.to.idx()) < count;
        let counts = traversals.iter().filter(is_proved).map(|traversal| Counts::of(reporter, traversal)).collect();
        let report = Report { receipt: Receipt { call, answer: accepted.to_le_bytes().to_vec() }, counts };
        let mut unsent = self.unsent.lock();
        let waiting: usize = unsent.iter().map(|report| 1 + report.counts.len()).sum();
        if waiting + report.counts.len() < MAX_UNSENT {
            unsent.push(report);
        }
    }

    /// Whether reports wait to be stored.
    pub fn has_unsent(&self) -> bool {
        !self.unsent.lock().is_empty()
    }

    /// Stores unsent reports with `send`, then takes over the evidence of all planners that `read` returns. Costs
    /// change at once. Returns whether any has changed.
    ///
    /// Those of `send` and `read`. The next exchange sends what was not sent.
    pub fn exchange<E>(
        &self,
        send: impl FnOnce(&[Report]) -> Result<(), E>,
        read: impl FnOnce() -> Result<LiveEvidence, E>,
    ) -> Result<bool, E> {
        let _turn = self.exchanging.lock();
        let sent = self.unsent.lock().clone();
        if !sent.is_empty() {
            send(&sent)?;
        }
        let fresh = read();
        let view = self.view();
        let mut live = self.live.lock();
        let mut unsent = self.unsent.lock();
        unsent.drain(..sent.len());
        let before = live.clone();
        live.renew(fresh?, self.proved.vertex_count());
        unsent.iter().flat_map(|report| &report.counts).for_each(|counts| live.add(counts));
        let mut repriced = view.repriced.write();
        let graph = &view.edited.graph;
        let mut has_changed = false;
        for edge in before.edges().chain(live.edges()) {
            let Some(cost) = live.cost(graph, edge) else { continue };
            if before.cost(graph, edge) != Some(cost) {
                Arc::make_mut(&mut repriced).insert(edge, cost);
                has_changed = true;
            }
        }
        Ok(has_changed)
    }

    /// Drops unsent reports of reporters with this name.
    pub fn drop_unsent(&self, name: &str) {
        let _turn = self.exchanging.lock();
        let is_other = |report: &Report| report.counts.iter().all(|counts| counts.reporter.name != name);
        self.unsent.lock().retain(is_other);
    }

    /// Makes a new router from the live evidence so far, with hub labels if the old one has them.
    pub fn refresh(&self) {
        while !self.try_refresh() {}
    }

    /// Returns false if another thread made a new view meanwhile.
    fn try_refresh(&self) -> bool {
        let view = self.view();
        let live = self.live.lock().clone();
        let router = self.origin.router(&view.edited, &live);
        if view.router.labels_bytes() > 0 {
            router.prepare_labels(self.origin.thread_count);
        }
        let next = View {
            router,
            edited: view.edited.clone(),
            layers: view.layers.clone(),
            revision: view.revision,
            connected: view.connected,
            refusal: view.refusal.clone(),
            repriced: RwLock::default(),
        };
        let _updating = self.updating.lock();
        let is_latest = Arc::ptr_eq(&view, &self.view());
        if is_latest {
            *self.view.write() = Arc::new(next);
            self.announce();
        }
        is_latest
    }

    /// Whether hub labels would make plans faster, without zones or with those of many queries.
    pub fn wants_labels(&self) -> bool {
        let router = &self.view().router;
        !self.is_interim() && (router.wants_labels() || router.zones_want_labels())
    }

    /// Prepares hub labels for the graph and its zones as they are now. Plans are made meanwhile.
    pub fn prepare_labels(&self) {
        let router = &self.view().router;
        router.prepare_labels(self.origin.thread_count);
        router.prepare_zone_labels(self.origin.thread_count);
    }

    /// Applies layers to the proved graph. Plans use the result after [`apply`](Self::apply). Returns `None` if
    /// `progress` was cancelled.
    pub fn prepare(&self, layers: Result<Vec<Layer>, PlannerError>, progress: &Arc<Progress>) -> Option<Prepared> {
        Prepared::new(&self.origin, &self.proved, &self.probes, layers, progress)
    }

    /// Uses a prepared graph for plans from now on.
    pub fn apply(&self, prepared: Prepared) {
        let _updating = self.updating.lock();
        let live = {
            let mut live = self.live.lock();
            // Layers may have given other vertices these indices.
            live.keep_below(self.proved.vertex_count());
            live.clone()
        };
        let view = View::new(&self.origin, prepared, &live);
        *self.view.write() = Arc::new(view);
        self.announce();
    }

    /// Calls `store` with the live evidence so far and the receipts of the calls that reported it. Calls do not
    /// overlap, so that the latest evidence is stored last.
    pub fn store_live<E>(&self, store: impl FnOnce(&LiveEvidence, &[Receipt]) -> Result<(), E>) -> Result<(), E> {
        let _updating = self.updating.lock();
        let (live, receipts) = {
            let live = self.live.lock();
            let unsent = self.unsent.lock();
            (live.clone(), unsent.iter().map(|report| report.receipt.clone()).collect::<Vec<_>>())
        };
        store(&live, &receipts)?;
        self.unsent.lock().drain(..receipts.len());
        Ok(())
    }

    /// Returns the number of traversals and failures of each reporter.
    pub fn reports(&self) -> Vec<Reported> {
        self.live.lock().reports()
    }

    /// Forgets the traversals that reporters of this name reported. Returns their number. Plans use them until the
    /// next [`refresh`](Self::refresh).
    pub fn drop_reports(&self, name: &str) -> u64 {
        self.live.lock().drop_reports(name)
    }

    /// Returns the layers, and the edits that could not be applied.
    pub fn layers(&self) -> (Vec<Layer>, Vec<Unapplied>) {
        let view = self.view();
        (view.layers.clone(), view.edited.unapplied.clone())
    }

    /// Calls `read` with the graph that plans use, layers and live evidence applied.
    pub fn with_graph<T>(&self, read: impl FnOnce(&NavGraph) -> T) -> T {
        read(self.view().router.graph())
    }

    /// Calls `read` with the graph that plans use, and with what designers forced and removed.
    pub fn with_edited<T>(&self, read: impl FnOnce(GraphView<'_>) -> T) -> T {
        let view = self.view();
        read(GraphView {
            graph: view.router.graph(),
            forced: &view.edited.forced,
            removed: &view.edited.removed,
            revision: view.revision,
        })
    }

    /// Returns the figures of the graph and of its build.
    pub fn figures(&self) -> Figures {
        let view = self.view();
        let traversals = self.live.lock().traversals();
        let summary = Summary::of(view.router.graph(), view.connected, traversals);
        self.figures_with(summary.with_edits(&view.layers, view.edited.unapplied.len()))
    }

    /// Returns the figures, unapplied edits and revision that a prepared graph will have.
    pub fn preview(&self, prepared: &Prepared) -> (Figures, Vec<Unapplied>, Revision) {
        let Prepared { edited, layers, connected, .. } = prepared;
        let mut live = self.live.lock().clone();
        live.keep_below(self.proved.vertex_count());
        let summary = Summary::of(&live.apply_to(&edited.graph), *connected, live.traversals());
        let figures = self.figures_with(summary.with_edits(layers, edited.unapplied.len()));
        (figures, edited.unapplied.clone(), Revision::of(layers))
    }

    fn figures_with(&self, summary: Summary) -> Figures {
        Figures {
            map_hash: self.origin.map_hash.clone(),
            stats: self.stats,
            cached: self.provenance == Provenance::Stored,
            summary,
        }
    }
}

/// A graph with the changes by designers.
#[derive(Debug, Clone, Copy)]
pub struct GraphView<'a> {
    /// The graph that plans use.
    pub graph: &'a NavGraph,
    /// Edges that designers forced.
    pub forced: &'a BTreeSet<EdgeKey>,
    /// Vertices that designers removed.
    pub removed: &'a BTreeSet<VertexId>,
    /// Revision of the layers.
    pub revision: Revision,
}

impl View {
    fn new(origin: &Origin, Prepared { edited, layers, connected, refusal }: Prepared, live: &LiveEvidence) -> Self {
        Self {
            connected,
            router: origin.router(&edited, live),
            edited,
            revision: Revision::of(&layers),
            layers,
            refusal,
            repriced: RwLock::default(),
        }
    }

    /// Returns the current costs of edges that have changed since the router was made.
    fn costs(&self) -> Arc<EdgeCosts> {
        self.repriced.read().clone()
    }
}
