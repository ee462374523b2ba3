//! One graph that is being asked: what was proved, edited and reported, and the router made of it all.

use super::POISON;
use super::wire_form::edge_to_wire;
use crate::build::{BuildSettings, BuildStats, GraphId};
use crate::cache::{LevelId, encode_layer};
use crate::candidates::Candidate;
use crate::edits::{Edited, Layer, MapTerrain, Terrain, Unfit, lay_over};
use crate::graph::{Edge, Evidence, NavGraph};
use crate::live::{LiveEvidence, Passage};
use crate::probe::ProbeContext;
use crate::search::{Plan, Query, Repriced, Router};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, OnceLock, RwLock};
use surefoot_policy::Policy;
use surefoot_proto::convert;
use surefoot_proto::maps::MapSource;
use surefoot_proto::planner::v1 as wire;
use surefoot_world::Vec3;
use tokio::sync::watch;

/// What decides how a hosted graph is edited and searched.
#[derive(Debug, Clone)]
pub(super) struct Origin {
    pub id: GraphId,
    pub source: MapSource,
    pub settings: BuildSettings,
    pub map_hash: String,
    pub policy: Policy,
    pub thread_count: usize,
    pub table_limit: usize,
}

/// A graph that is ready to be asked.
#[derive(Debug)]
pub(super) struct Hosted {
    pub origin: Origin,
    pub stats: BuildStats,
    pub cached: bool,
    proved: NavGraph,
    view: RwLock<Arc<View>>,
    live: Mutex<LiveEvidence>,
    /// Set while a refresh is due.
    pub refresh_is_due: AtomicBool,
    /// Told whenever plans may come out differently.
    changes: watch::Sender<()>,
}

/// A graph at one moment: readers keep theirs while a new one is made.
#[derive(Debug)]
struct View {
    router: Router,
    edited: Edited,
    layers: Vec<Layer>,
    revision: u64,
    connected: f64,
    /// Edges that have changed since the router was made.
    repriced: RwLock<Repriced>,
}

impl Hosted {
    /// Makes a proved graph ready, with what was reported of it and the level's layers.
    pub fn new(
        origin: Origin,
        proved: NavGraph,
        stats: BuildStats,
        cached: bool,
        live: LiveEvidence,
        layers: Vec<Layer>,
    ) -> Self {
        let view = Arc::new(View::new(&origin, &proved, layers, &live));
        Self {
            origin,
            stats,
            cached,
            proved,
            view: RwLock::new(view),
            live: Mutex::new(live),
            refresh_is_due: AtomicBool::new(false),
            changes: watch::Sender::new(()),
        }
    }

    /// Told whenever plans may come out differently; over when the graph is no longer kept.
    pub fn changes(&self) -> watch::Receiver<()> {
        self.changes.subscribe()
    }

    /// The state of the layers: the same for the same edits, never 0.
    pub fn revision(&self) -> u64 {
        self.view().revision
    }

    pub fn level(&self) -> LevelId {
        self.origin.level()
    }

    fn view(&self) -> Arc<View> {
        self.view.read().expect(POISON).clone()
    }

    pub fn plan(&self, query: &Query) -> Plan {
        let view = self.view();
        let repriced = view.repriced.read().expect(POISON);
        view.router.find_path_at(query, &repriced)
    }

    /// Learns from passages: how many were of edges that the graph has.
    pub fn report(&self, passages: &[Passage]) -> u32 {
        let view = self.view();
        let mut live = self.live.lock().expect(POISON);
        let mut repriced = view.repriced.write().expect(POISON);
        let mut accepted = 0;
        for passage in passages {
            let Some(cost) = live.note(&view.edited.graph, passage) else { continue };
            repriced.insert((passage.from, passage.to), cost as f32);
            accepted += 1;
        }
        accepted
    }

    /// Makes a router of all that was reported up to now; what is to be remembered of it.
    pub fn refresh(&self) -> LiveEvidence {
        let view = self.view();
        let live = self.live.lock().expect(POISON).clone();
        let next = View {
            router: self.origin.router(live.lay_over(&view.edited.graph)),
            edited: view.edited.clone(),
            layers: view.layers.clone(),
            revision: view.revision,
            connected: view.connected,
            repriced: RwLock::default(),
        };
        let mut current = self.view.write().expect(POISON);
        // Layers that were laid over meanwhile win.
        if Arc::ptr_eq(&current, &view) {
            *current = Arc::new(next);
        }
        drop(current);
        self.changes.send_replace(());
        live
    }

    /// Lays these layers over what was proved, in place of those before.
    pub fn lay_over(&self, layers: Vec<Layer>) {
        let live = {
            let mut live = self.live.lock().expect(POISON);
            // Vertices that layers put in may have other numbers from now on.
            live.keep_below(self.proved.vertex_count() as u32);
            live.clone()
        };
        let view = View::new(&self.origin, &self.proved, layers, &live);
        *self.view.write().expect(POISON) = Arc::new(view);
        self.changes.send_replace(());
    }

    pub fn live(&self) -> LiveEvidence {
        self.live.lock().expect(POISON).clone()
    }

    pub fn layers(&self) -> (Vec<Layer>, Vec<Unfit>) {
        let view = self.view();
        (view.layers.clone(), view.edited.unfit.clone())
    }

    /// The graph as plans see it.
    pub fn with_graph<T>(&self, read: impl FnOnce(&NavGraph) -> T) -> T {
        read(self.view().router.graph())
    }

    /// All of it, as it is sent.
    pub fn to_wire(&self) -> wire::GetGraphResponse {
        let view = self.view();
        let graph = view.router.graph();
        let is_forced = |edge: &Edge| view.edited.forced.contains(&(edge.from, edge.to));
        wire::GetGraphResponse {
            summary: Some(self.summary()),
            vertices: (0..graph.vertex_count() as u32).map(|vertex| convert::to_wire(graph.position(vertex))).collect(),
            islands: graph.islands().to_vec(),
            edges: graph.edges().map(|edge| edge_to_wire(edge, is_forced(edge))).collect(),
            revision: view.revision,
            removed: view.edited.removed.iter().copied().collect(),
        }
    }

    pub fn summary(&self) -> wire::GraphSummary {
        let view = self.view();
        let graph = view.router.graph();
        wire::GraphSummary {
            map_hash: self.origin.map_hash.clone(),
            vertices: graph.vertex_count() as u32,
            edges: graph.edge_count() as u32,
            islands: graph.island_count(),
            connected: view.connected as f32,
            probes: self.stats.probes,
            build_s: self.stats.seconds as f32,
            cached: self.cached,
            candidates: self.stats.candidates,
            passages: self.live.lock().expect(POISON).passages(),
            edits: view.layers.iter().map(|layer| layer.edits.len() as u32).sum(),
            unfit_edits: view.edited.unfit.len() as u32,
        }
    }
}

impl View {
    fn new(origin: &Origin, proved: &NavGraph, layers: Vec<Layer>, live: &LiveEvidence) -> Self {
        let terrain = LazyTerrain { origin, terrain: OnceLock::new() };
        let edited = lay_over(proved, &layers, origin.settings.threshold, &terrain).expect("nobody cancels an edit");
        Self {
            connected: edited.graph.connected_share(),
            router: origin.router(live.lay_over(&edited.graph)),
            edited,
            revision: revision_of(&layers),
            layers,
            repriced: RwLock::default(),
        }
    }
}

/// The state of a level's layers as a number: a hash of what they say.
pub(super) fn revision_of(layers: &[Layer]) -> u64 {
    let mut hasher = blake3::Hasher::new();
    for layer in layers {
        // Each begins with its checksum, so that none runs into the next.
        hasher.update(&encode_layer(layer));
    }
    let first = hasher.finalize().as_bytes().first_chunk().copied().expect("32 bytes");
    u64::from_le_bytes(first).max(1)
}

impl Origin {
    /// What layers belong to: a generated map's spec, or the name of a level, which outlives changes of it.
    pub fn level(&self) -> LevelId {
        match &self.source {
            MapSource::Spec(spec) => LevelId::of_spec(spec),
            MapSource::Level(level) => LevelId::of(level.name.as_bytes()),
        }
    }

    fn router(&self, graph: NavGraph) -> Router {
        Router::new(graph, self.table_limit, self.thread_count)
    }
}

/// The map of a graph, generated when an edit first needs it.
struct LazyTerrain<'a> {
    origin: &'a Origin,
    terrain: OnceLock<MapTerrain>,
}

impl LazyTerrain<'_> {
    fn terrain(&self) -> &MapTerrain {
        self.terrain.get_or_init(|| {
            let Origin { source, policy, settings, thread_count, .. } = self.origin;
            let map = source.map().expect("the graph's map came from there");
            let context = ProbeContext::new(map, policy.clone());
            MapTerrain { context, settings: *settings, thread_count: *thread_count }
        })
    }
}

impl Terrain for LazyTerrain<'_> {
    fn stand(&self, place: Vec3) -> Option<Vec3> {
        self.terrain().stand(place)
    }

    fn prove(&self, vertices: &[Vec3], candidates: &[Candidate]) -> Option<Vec<Evidence>> {
        self.terrain().prove(vertices, candidates)
    }
}
