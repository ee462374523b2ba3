//! One graph in memory: what was proved, edited and reported, and the router made of it all.

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

/// The state of a level's layers as a number: a hash of what they say, so that equal edits have equal revisions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Revision(pub NonZeroU64);

impl Revision {
    /// The state of these layers.
    pub fn of(layers: &[Layer]) -> Self {
        let mut hasher = blake3::Hasher::new();
        for layer in layers {
            // Each begins with its checksum, so that none runs into the next.
            hasher.update(&encode_layer(layer));
        }
        let first = hasher.finalize().as_bytes().first_chunk().copied().expect("32 bytes");
        Self(NonZeroU64::new(u64::from_le_bytes(first)).unwrap_or(NonZeroU64::MIN))
    }
}

/// What decides how a hosted graph is edited and searched.
#[derive(Debug, Clone)]
pub struct Origin {
    /// Identity of the graph.
    pub id: GraphId,
    /// Where its map comes from.
    pub source: MapSource,
    /// What it was built with.
    pub settings: BuildSettings,
    /// Hash of its map, hexadecimal.
    pub map_hash: String,
    /// What proved it.
    pub policy: Policy,
    /// Threads to use.
    pub thread_count: usize,
    /// Vertices up to which it gets a table of next hops.
    pub table_limit: usize,
}

/// A graph in memory.
#[derive(Debug)]
pub struct Hosted {
    /// What decides how it is edited and searched.
    pub origin: Origin,
    /// What its build took.
    pub stats: BuildStats,
    /// Whether it came from the store.
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
    revision: Revision,
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

    /// The state of the layers.
    pub fn revision(&self) -> Revision {
        self.view().revision
    }

    /// The level that its layers belong to.
    pub fn level(&self) -> LevelId {
        self.origin.level()
    }

    fn view(&self) -> Arc<View> {
        self.view.read().expect(POISON).clone()
    }

    /// The cheapest plan at present prices.
    pub fn plan(&self, query: &Query) -> Plan {
        let view = self.view();
        let repriced = view.repriced.read().expect(POISON);
        view.router.find_path_at(query, &repriced)
    }

    /// Learns from traversals: how many were of edges that the graph has.
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

    /// Makes a router of all that was reported up to now; what is to be remembered of it.
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
        // Layers that were applied meanwhile win.
        if Arc::ptr_eq(&current, &view) {
            *current = Arc::new(next);
        }
        drop(current);
        self.changes.send_replace(());
        live
    }

    /// Applies these layers to what was proved, in place of those before.
    pub fn apply_layers(&self, layers: Vec<Layer>) {
        let live = {
            let mut live = self.live.lock().expect(POISON);
            // Vertices that layers put in may have other numbers from now on.
            live.keep_below(self.proved.vertex_count());
            live.clone()
        };
        let view = View::new(&self.origin, &self.proved, layers, &live);
        *self.view.write().expect(POISON) = Arc::new(view);
        self.changes.send_replace(());
    }

    /// What NPCs reported.
    pub fn live(&self) -> LiveEvidence {
        self.live.lock().expect(POISON).clone()
    }

    /// The layers, and the edits in them that found nothing to change.
    pub fn layers(&self) -> (Vec<Layer>, Vec<Unapplied>) {
        let view = self.view();
        (view.layers.clone(), view.edited.unapplied.clone())
    }

    /// The graph as plans see it.
    pub fn with_graph<T>(&self, read: impl FnOnce(&NavGraph) -> T) -> T {
        read(self.view().router.graph())
    }

    /// The graph as plans see it, with what designers did to it.
    pub fn with_edited<T>(&self, read: impl FnOnce(GraphView<'_>) -> T) -> T {
        let view = self.view();
        read(GraphView {
            graph: view.router.graph(),
            forced: &view.edited.forced,
            removed: &view.edited.removed,
            revision: view.revision,
        })
    }

    /// Its figures, with those of its build.
    pub fn figures(&self) -> Figures {
        Figures {
            map_hash: self.origin.map_hash.clone(),
            stats: self.stats,
            cached: self.cached,
            summary: self.summary(),
        }
    }

    /// Its figures.
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

/// A graph as it is shown to people.
#[derive(Debug, Clone, Copy)]
pub struct GraphView<'a> {
    /// As plans see it.
    pub graph: &'a NavGraph,
    /// Edges that designers put in.
    pub forced: &'a BTreeSet<EdgeKey>,
    /// Vertices that designers took out.
    pub removed: &'a BTreeSet<VertexId>,
    /// State of the layers.
    pub revision: Revision,
}

/// Figures of a graph and of its build.
#[derive(Debug, Clone, PartialEq)]
pub struct Figures {
    /// Hash of its map, hexadecimal.
    pub map_hash: String,
    /// What its build took.
    pub stats: BuildStats,
    /// Whether it came from the store.
    pub cached: bool,
    /// The graph as it is now.
    pub summary: Summary,
}

/// Figures of a graph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Vertices.
    pub vertices: usize,
    /// Edges.
    pub edges: usize,
    /// Strongly connected components.
    pub islands: u32,
    /// Share of ordered pairs of vertices with a path, in [0, 1].
    pub connected: f64,
    /// Traversals of NPCs that are remembered.
    pub traversals: u64,
    /// Edits in all layers.
    pub edits: usize,
    /// Of those, how many found nothing to change.
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
