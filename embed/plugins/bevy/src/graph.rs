//! Graphs that agents share, and plans from them.

use crate::error::{SurefootError, chain};
use crate::level::SurefootLevel;
use crate::policy::SurefootPolicy;
use crate::stage::{Stage, SurefootBlock};
use bevy_ecs::prelude::*;
use bevy_math::Vec3;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::{Arc, PoisonError, RwLock};
use surefoot_planner::export::{body_of, import_json};
use surefoot_planner::live::{LiveEvidence, Reporter, Traversal};
use surefoot_planner::price::{EdgeCost, EdgeCosts};
use surefoot_planner::search::DEFAULT_LABEL_LIMIT;
use surefoot_planner::{EdgeKey, NavGraph, Plan, Query, Router};
use surefoot_rollout::game::Rehearsals;
use surefoot_world::character::MoveScratch;
use surefoot_world::{CharacterProfile, navigable};

/// Largest share of vertices that may be nowhere to stand: a level may have been changed a little since.
const MAX_ASTRAY: f32 = 0.1;
/// Height above or below a vertex within which there must be a floor, m.
const RISE_M: f32 = 0.5;

/// The graph on which an agent plans, as written by `surefoot graph export --format json`. Clones share closed edges
/// and the agents' reports. All places are in scene coordinates.
#[derive(Component, Debug, Clone)]
#[cfg_attr(feature = "asset", derive(bevy_asset::Asset, bevy_reflect::TypePath))]
pub struct SurefootGraph {
    shared: Arc<RwLock<Paths>>,
    origin: Vec3,
    body: Option<CharacterProfile>,
    stage: Option<Arc<Stage>>,
}

#[derive(Debug)]
struct Paths {
    proved: Router,
    /// The graph without edges that are closed, if any are.
    open: Option<Router>,
    closed: BTreeSet<EdgeKey>,
    live: LiveEvidence,
    /// Costs of edges that agents reported.
    reported: EdgeCosts,
}

impl SurefootGraph {
    /// Reads a graph from the text of its file.
    ///
    /// # Errors
    /// If the text is no such graph.
    pub fn from_json(text: &str) -> Result<Self, SurefootError> {
        let graph = import_json(text).map_err(|error| SurefootError::Graph(chain(&error)))?;
        let paths = Paths {
            proved: Router::new(graph, DEFAULT_LABEL_LIMIT, 1),
            open: None,
            closed: BTreeSet::new(),
            live: LiveEvidence::default(),
            reported: EdgeCosts::new(),
        };
        Ok(Self { shared: Arc::new(RwLock::new(paths)), origin: Vec3::ZERO, body: body_of(text), stage: None })
    }

    /// Reads a graph from its file.
    ///
    /// # Errors
    /// If the file cannot be read, or is no graph.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, SurefootError> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path);
        Self::from_json(&text.map_err(|source| SurefootError::Io { path: path.to_owned(), source })?)
    }

    /// The same graph, where the level's origin lies at `origin`, m, on the map: `surefoot map import` prints it.
    #[must_use]
    pub fn with_origin(self, origin: Vec3) -> Self {
        Self { origin, ..self }
    }

    /// The same graph with the origin of its level, against which it is checked.
    ///
    /// # Errors
    /// If one can stand at too few of the graph's vertices.
    pub fn aligned_to(self, level: &SurefootLevel) -> Result<Self, SurefootError> {
        let body = self.body.clone().unwrap_or_default();
        let mut scratch = MoveScratch::default();
        let mut can_stand = |place| navigable::stand_at(level.map(), &body, place, RISE_M, &mut scratch).is_some();
        let (astray, count) = self.read(|paths| {
            let graph = paths.proved.graph();
            (graph.vertices().filter(|vertex| !can_stand(graph.position(*vertex))).count(), graph.vertex_count())
        });
        if astray as f32 > MAX_ASTRAY * count as f32 {
            return Err(SurefootError::OtherLevel { astray, count });
        }
        Ok(self.with_origin(level.origin()))
    }

    /// The same graph with rehearsals: agents run the next legs of their plans in a copy of `level`, on `thread_count`
    /// threads. They then move calmly, and take another route where a leg would kill them. With 0 threads they rehearse
    /// in the fixed ticks, which take milliseconds longer, and equal seeds give equal bits. Call
    /// [`aligned_to`](Self::aligned_to) as well.
    #[must_use]
    pub fn rehearsed_on(self, level: &SurefootLevel, thread_count: usize) -> Self {
        Self { stage: Some(Arc::new(Stage::new(level.map().clone(), thread_count))), ..self }
    }

    /// Replaces the blocks that rehearsals know, at most 1024. Agents then take another plan, and avoid legs on which a
    /// block stops their rehearsals. Call it when a block has come to rest, or is gone. Clones share the blocks.
    ///
    /// # Errors
    /// If a block cannot be used, or agents do not rehearse. All blocks then stay as they were.
    pub fn set_blocks(&self, blocks: &[SurefootBlock]) -> Result<(), SurefootError> {
        let stage = self.stage.as_ref().ok_or(SurefootError::NoRehearsals)?;
        stage.set_blocks(blocks, self.origin)
    }

    /// The rehearsals for agents with this policy and body, if they rehearse.
    pub(crate) fn rehearsals(&self, policy: &SurefootPolicy, body: &CharacterProfile) -> Option<Arc<Rehearsals>> {
        self.stage.as_ref().map(|stage| stage.rehearsals(policy, body))
    }

    /// Whether a graph is a clone of this one.
    pub(crate) fn is_clone_of(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.shared, &other.shared) && self.origin == other.origin
    }

    /// Where the level's origin lies on the map, m.
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// The body for which the graph was proved; `None` if its file does not say.
    pub fn body(&self) -> Option<&CharacterProfile> {
        self.body.as_ref()
    }

    /// Finds the cheapest plan of a query whose places are those of the scene.
    pub fn find_path(&self, query: &Query) -> Plan {
        let query = Query { start: query.start + self.origin, goal: query.goal + self.origin, ..query.clone() };
        self.in_scene(self.find(&query))
    }

    /// Position of each vertex, m.
    pub fn vertices(&self) -> Vec<Vec3> {
        self.read(|paths| {
            let graph = paths.proved.graph();
            graph.vertices().map(|vertex| graph.position(vertex) - self.origin).collect()
        })
    }

    /// The proved edges with where they begin and end, m. Doors are found among them.
    pub fn edges(&self) -> Vec<(surefoot_planner::Edge, [Vec3; 2])> {
        self.read(|paths| {
            let graph = paths.proved.graph();
            let place = |vertex| graph.position(vertex) - self.origin;
            let placed = |edge: &surefoot_planner::Edge| (*edge, [place(edge.key.from), place(edge.key.to)]);
            graph.edges().map(placed).collect()
        })
    }

    /// Opens or closes edges, as a door does; plans made from now on know it.
    ///
    /// # Errors
    /// Names an edge that the graph does not have; nothing is changed then.
    pub fn set_open(&self, edges: &[EdgeKey], is_open: bool) -> Result<(), SurefootError> {
        let mut paths = self.shared.write().unwrap_or_else(PoisonError::into_inner);
        if let Some(key) = edges.iter().find(|key| paths.proved.graph().edge(**key).is_none()) {
            return Err(SurefootError::NoEdge { from: key.from.0, to: key.to.0 });
        }
        for key in edges {
            if is_open {
                paths.closed.remove(key)
            } else {
                paths.closed.insert(*key)
            };
        }
        paths.open = (!paths.closed.is_empty()).then(|| {
            let mut data = paths.proved.graph().to_data();
            data.edges.retain(|edge| !paths.closed.contains(&edge.key));
            let graph = NavGraph::check(data).expect("a checked graph with fewer edges");
            let mut router = Router::new(graph, DEFAULT_LABEL_LIMIT, 1);
            // Unproved legs must not stand in for them.
            router.forbid(paths.closed.iter().copied().collect());
            router
        });
        Ok(())
    }

    /// A plan on the map.
    pub(crate) fn find(&self, query: &Query) -> Plan {
        self.read(|paths| paths.open.as_ref().unwrap_or(&paths.proved).find_path_at(query, &paths.reported))
    }

    /// A plan of the map in the scene.
    pub(crate) fn in_scene(&self, mut plan: Plan) -> Plan {
        plan.waypoints.iter_mut().chain(&mut plan.nearest).for_each(|place| *place -= self.origin);
        plan
    }

    /// Adds how an agent got on along an edge to what is known of it.
    pub(crate) fn note(&self, traversal: &Traversal) {
        let reporter = Reporter { name: "app".to_owned(), is_trusted: true };
        let mut paths = self.shared.write().unwrap_or_else(PoisonError::into_inner);
        let Paths { proved, live, reported, .. } = &mut *paths;
        let cost: Option<EdgeCost> = live.note(proved.graph(), &reporter, traversal);
        reported.extend(cost.map(|cost| (traversal.edge, cost)));
    }

    fn read<T>(&self, read: impl FnOnce(&Paths) -> T) -> T {
        read(&self.shared.read().unwrap_or_else(PoisonError::into_inner))
    }
}
