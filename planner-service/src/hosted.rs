//! One graph in memory: the proved graph, the layers and live evidence that apply to it, and the router that results.

use crate::locks::POISON;
use std::collections::BTreeSet;
use std::num::NonZeroU64;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, OnceLock, RwLock};
use surefoot_net::levels::MapSource;
use surefoot_planner::candidates::Candidate;
use surefoot_planner::edits::{Edited, Layer, MapTerrain, Terrain, Unapplied, apply_layers};
use surefoot_planner::evidence::Evidence;
use surefoot_planner::live::{LiveEvidence, Traversal};
use surefoot_planner::search::Repriced;
use surefoot_planner::store::{LevelId, encode_layer};
use surefoot_planner::{BuildSettings, BuildStats, EdgeKey, GraphId, NavGraph, Plan, Query, Router, VertexId};
use surefoot_policy::Policy;
use surefoot_rollout::graphs;
use surefoot_rollout::probe::ProbeContext;
use surefoot_world::Vec3;
use tokio::sync::watch;

/// Revision of a level's layers: a hash of their content, so that equal layers have equal revisions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Revision(pub NonZeroU64);

impl Revision {
    /// Returns the revision of these layers.
    pub fn of(layers: &[Layer]) -> Self {
        let mut hasher = blake3::Hasher::new();
        for layer in layers {
            // Each encoded layer begins with its checksum, so different lists of layers have different encodings.
            hasher.update(&encode_layer(layer));
        }
        let first = hasher.finalize().as_bytes().first_chunk().copied().expect("32 bytes");
        Self(NonZeroU64::new(u64::from_le_bytes(first)).unwrap_or(NonZeroU64::MIN))
    }
}

/// Where a graph comes from, and what editing and searching it needs.
#[derive(Debug, Clone)]
pub struct Origin {
    /// Identity of the graph.
    pub id: GraphId,
    /// Source of the map.
    pub source: MapSource,
    /// Settings of the build.
    pub settings: BuildSettings,
    /// Content hash of the map, 64 hexadecimal digits.
    pub map_hash: String,
    /// Policy that proved the graph.
    pub policy: Policy,
    /// Number of threads.
    pub thread_count: usize,
    /// Largest number of vertices at which the router gets a table of next hops.
    pub table_limit: usize,
}

/// A graph in memory.
#[derive(Debug)]
pub struct Hosted {
    /// Where the graph comes from, and what editing and searching it needs.
    pub origin: Origin,
    /// Statistics of the build.
    pub stats: BuildStats,
    /// Whether the graph came from the store.
    pub cached: bool,
    proved: NavGraph,
    view: RwLock<Arc<View>>,
    live: Mutex<LiveEvidence>,
    /// Whether a refresh is scheduled.
    pub refresh_is_due: AtomicBool,
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
    /// Costs of edges that have changed since the router was made.
    repriced: RwLock<Repriced>,
}

impl Hosted {
    /// Applies the level's layers and live evidence to a proved graph, and prepares it for queries.
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

    /// Returns a receiver that is notified whenever plans may change, and closed when the graph is dropped.
    pub fn changes(&self) -> watch::Receiver<()> {
        self.changes.subscribe()
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
        self.view.read().expect(POISON).clone()
    }

    /// Finds the cheapest plan at current costs.
    pub fn plan(&self, query: &Query) -> Plan {
        let view = self.view();
        let repriced = view.repriced.read().expect(POISON);
        view.router.find_path_at(query, &repriced)
    }

    /// Adds traversals to the live evidence and reprices their edges. Returns the number of traversals along edges that the
    /// graph has.
    pub fn report(&self, traversals: &[Traversal]) -> u32 {
        let view = self.view();
        let mut live = self.live.lock().expect(POISON);
        let mut repriced = view.repriced.write().expect(POISON);
        let mut accepted = 0;
        for traversal in traversals {
            let Some(cost) = live.note(&view.edited.graph, traversal) else { continue };
            repriced.insert(traversal.edge, cost as f32);
            accepted += 1;
        }
        accepted
    }

    /// Makes a new router from the live evidence so far, and returns that evidence for the store.
    pub fn refresh(&self) -> LiveEvidence {
        let view = self.view();
        let live = self.live.lock().expect(POISON).clone();
        let next = View {
            router: self.origin.router(live.apply_to(&view.edited.graph)),
            edited: view.edited.clone(),
            layers: view.layers.clone(),
            revision: view.revision,
            connected: view.connected,
            repriced: RwLock::default(),
        };
        let mut current = self.view.write().expect(POISON);
        // Keep the newer view if layers were applied in the meantime.
        if Arc::ptr_eq(&current, &view) {
            *current = Arc::new(next);
        }
        drop(current);
        self.changes.send_replace(());
        live
    }

    /// Applies `layers` to the proved graph, in place of the layers before.
    pub fn apply_layers(&self, layers: Vec<Layer>) {
        let live = {
            let mut live = self.live.lock().expect(POISON);
            // Vertices that layers add may now have other indices.
            live.keep_below(self.proved.vertex_count());
            live.clone()
        };
        let view = View::new(&self.origin, &self.proved, layers, &live);
        *self.view.write().expect(POISON) = Arc::new(view);
        self.changes.send_replace(());
    }

    /// Returns the live evidence.
    pub fn live(&self) -> LiveEvidence {
        self.live.lock().expect(POISON).clone()
    }

    /// Returns the layers, and those of their edits that could not be applied.
    pub fn layers(&self) -> (Vec<Layer>, Vec<Unapplied>) {
        let view = self.view();
        (view.layers.clone(), view.edited.unapplied.clone())
    }

    /// Calls `read` with the graph that plans use: with layers and live evidence applied.
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
        Figures {
            map_hash: self.origin.map_hash.clone(),
            stats: self.stats,
            cached: self.cached,
            summary: self.summary(),
        }
    }

    /// Returns the figures of the graph as it is now.
    fn summary(&self) -> Summary {
        let view = self.view();
        let graph = view.router.graph();
        Summary {
            vertices: graph.vertex_count(),
            edges: graph.edge_count(),
            islands: graph.island_count(),
            connected: view.connected,
            traversals: self.live.lock().expect(POISON).traversals(),
            edits: view.layers.iter().map(|layer| layer.edits.len()).sum(),
            unapplied_edits: view.edited.unapplied.len(),
        }
    }
}

/// A graph with the changes that designers made to it.
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

/// Figures of a graph and of its build.
#[derive(Debug, Clone, PartialEq)]
pub struct Figures {
    /// Content hash of the map, 64 hexadecimal digits.
    pub map_hash: String,
    /// Statistics of the build.
    pub stats: BuildStats,
    /// Whether the graph came from the store.
    pub cached: bool,
    /// Figures of the graph as it is now.
    pub summary: Summary,
}

/// Figures of a graph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Number of vertices.
    pub vertices: usize,
    /// Number of edges.
    pub edges: usize,
    /// Number of islands (strongly connected components).
    pub islands: u32,
    /// Share of ordered pairs of vertices with a path, in [0, 1].
    pub connected: f64,
    /// Number of NPCs' traversals that count towards the evidence.
    pub traversals: u64,
    /// Number of edits in all layers.
    pub edits: usize,
    /// Number of these edits that could not be applied.
    pub unapplied_edits: usize,
}

impl View {
    fn new(origin: &Origin, proved: &NavGraph, layers: Vec<Layer>, live: &LiveEvidence) -> Self {
        let terrain = LazyTerrain { origin, terrain: OnceLock::new() };
        let edited =
            apply_layers(proved, &layers, origin.settings.threshold, &terrain).expect("nobody cancels an edit");
        Self {
            connected: edited.graph.connected_share(),
            router: origin.router(live.apply_to(&edited.graph)),
            edited,
            revision: Revision::of(&layers),
            layers,
            repriced: RwLock::default(),
        }
    }
}

impl Origin {
    /// Returns the level that layers belong to. An imported level is identified by its name, so that its layers outlive changes
    /// of its map; a generated map, by its spec.
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
            let map = source.map();
            graphs::terrain(&ProbeContext::new(map, policy.clone()), *settings, *thread_count)
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
