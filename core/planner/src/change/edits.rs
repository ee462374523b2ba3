//! Designers' changes to a graph: named layers of edits that apply to the proved graph.
//!
//! Edits refer to vertices by position, not by index, so a layer outlives the graph that it was made for: it also
//! applies to a graph that was rebuilt with other settings, another policy or a changed map. An edit with nothing to
//! change is skipped and reported as [`Unapplied`]. Edits of vertices are applied first, in order, then edits of
//! edges.

use crate::build::Builder;
use crate::build::Progress;
use crate::build::candidates::Candidate;
use crate::build::probe::ProbeExecutor;
use crate::change::editable::Editable;
use crate::evidence::Evidence;
pub use crate::evidence::FACTORS;
use crate::graph::{Edge, MAX_EDGE_M, NavGraph, is_place};
use crate::ids::{EdgeKey, VertexId};
use crate::settings::Site;
use crate::settings::{BuildSettings, Probing};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::sync::Arc;
use surefoot_world::character::MoveScratch;
use surefoot_world::map::LevelFrame;
use surefoot_world::{Seconds, Vec3, navigable};

/// Greatest distance of a vertex from the position by which an edit refers to it, m.
const FIT_M: f32 = 3.0;
/// Greatest height difference between the position in an edit and the ground that the vertex is placed on, m.
const STAND_M: f32 = 2.0;
/// Maximum number of edits in a layer.
pub const MAX_EDITS: usize = 4096;
/// Maximum length of a layer's name, in bytes.
pub const MAX_NAME: usize = 64;
/// Longest duration that an edit may give a forced edge, s.
const MAX_SECONDS: f32 = 3600.0;
/// Number of nearest neighbours that a new or moved vertex is probed against.
const NEIGHBOURS: usize = 12;

/// One change of a graph.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "edit", rename_all = "snake_case", deny_unknown_fields)]
pub enum Edit {
    /// Removes an edge.
    ForbidEdge {
        /// Position of the vertex that the edge leaves, m.
        from: Vec3,
        /// Position of the vertex that the edge reaches, m.
        to: Vec3,
    },
    /// Adds an edge, proved or not.
    ForceEdge {
        /// Position of the vertex that the edge leaves, m.
        from: Vec3,
        /// Position of the vertex that the edge reaches, m.
        to: Vec3,
        /// Duration, 0 to 3600 s; estimated if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        seconds: Option<f32>,
    },
    /// Multiplies the cost of an edge.
    PriceEdge {
        /// Position of the vertex that the edge leaves, m.
        from: Vec3,
        /// Position of the vertex that the edge reaches, m.
        to: Vec3,
        /// Factor on the cost, 0.1 to 1000.
        factor: f32,
    },
    /// Adds a vertex and probes it against its nearest neighbours, in both directions.
    AddVertex {
        /// Position of the new vertex, m; the vertex is placed on the ground within 2 m above or below.
        at: Vec3,
    },
    /// Moves a vertex and probes it against its nearest neighbours, in both directions.
    MoveVertex {
        /// Present position of the vertex, m.
        from: Vec3,
        /// New position, m; the vertex is placed on the ground within 2 m above or below.
        to: Vec3,
    },
    /// Removes a vertex and all its edges.
    RemoveVertex {
        /// Position of the vertex, m.
        at: Vec3,
    },
}

/// A named list of edits.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Layer {
    /// Name, 1 to 64 bytes without control characters; unique within a level.
    pub name: String,
    /// Edits in the order in which they apply, at most 4096.
    pub edits: Vec<Edit>,
}

/// Why a layer is invalid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LayerError {
    /// The name is empty, too long or contains control characters.
    #[error("layer names have 1 to {MAX_NAME} bytes and no control characters")]
    Name,
    /// The layer has too many edits.
    #[error("a layer has at most {MAX_EDITS} edits, but this one has {0}")]
    Length(usize),
    /// A number is out of range.
    #[error("edit {index}: {field} is {value}; it must be {allowed}")]
    Number {
        /// Index of the edit in the layer.
        index: usize,
        /// Name of the field.
        field: &'static str,
        /// Value of the field.
        value: f32,
        /// Allowed values, for people.
        allowed: &'static str,
    },
}

impl Layer {
    /// Checks the name, the number of edits, and their numbers.
    ///
    /// # Errors
    /// Returns the first violation.
    pub fn validate(&self) -> Result<(), LayerError> {
        if self.name.is_empty() || self.name.len() > MAX_NAME || self.name.chars().any(char::is_control) {
            return Err(LayerError::Name);
        }
        if self.edits.len() > MAX_EDITS {
            return Err(LayerError::Length(self.edits.len()));
        }
        for (index, edit) in self.edits.iter().enumerate() {
            let wrong = |field, value, allowed| Err(LayerError::Number { index, field, value, allowed });
            for place in edit.places() {
                if let Some(&value) = place.to_array().iter().find(|value| !value.is_finite()) {
                    return wrong("position", value, "finite");
                }
            }
            match *edit {
                Edit::PriceEdge { factor, .. } if !FACTORS.contains(&factor) => {
                    return wrong("factor", factor, "between 0.1 and 1000");
                }
                Edit::ForceEdge { seconds: Some(seconds), .. } if !(0.0..=MAX_SECONDS).contains(&seconds) => {
                    return wrong("seconds", seconds, "between 0 and 3600");
                }
                _ => {}
            }
        }
        Ok(())
    }
}

impl Edit {
    /// Returns whether applying the edit takes probes: it adds or moves a vertex.
    pub fn is_probed(&self) -> bool {
        matches!(self, Edit::AddVertex { .. } | Edit::MoveVertex { .. })
    }

    /// The positions that the edit refers to, m.
    pub fn places(&self) -> Vec<Vec3> {
        match *self {
            Edit::ForbidEdge { from, to }
            | Edit::ForceEdge { from, to, .. }
            | Edit::PriceEdge { from, to, .. }
            | Edit::MoveVertex { from, to } => vec![from, to],
            Edit::AddVertex { at } | Edit::RemoveVertex { at } => vec![at],
        }
    }
}

/// Why an edit cannot be applied.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum UnappliedReason {
    /// The graph has no vertex near this position.
    #[error("there is no vertex within {FIT_M} m of ({:.1}, {:.1}, {:.1})", .0.x, .0.y, .0.z)]
    NoVertex(Vec3),
    /// Both positions refer to the same vertex.
    #[error("both ends are the same vertex")]
    OneVertex,
    /// No edge joins the two vertices.
    #[error("no edge leads from vertex {} to vertex {}", .0.from, .0.to)]
    NoEdge(EdgeKey),
    /// The two vertices are farther apart than any edge may be.
    #[error("vertices {} and {} are more than {MAX_EDGE_M} m apart", .0.from, .0.to)]
    TooLong(EdgeKey),
    /// The character cannot stand near this position.
    #[error("the character cannot stand within {STAND_M} m of ({:.1}, {:.1}, {:.1})", .0.x, .0.y, .0.z)]
    NoGround(Vec3),
}

impl UnappliedReason {
    /// The reason for people, with places in the coordinates of a level with this frame too.
    pub fn describe(&self, frame: &LevelFrame) -> String {
        match self {
            Self::NoVertex(at) | Self::NoGround(at) => format!("{self}{}", frame.aside(*at)),
            Self::OneVertex | Self::NoEdge(_) | Self::TooLong(_) => self.to_string(),
        }
    }
}

/// An edit that could not be applied.
#[derive(Debug, Clone, PartialEq)]
pub struct Unapplied {
    /// Name of the layer.
    pub layer: String,
    /// Index of the edit in the layer.
    pub index: usize,
    /// Why the edit could not be applied.
    pub reason: UnappliedReason,
}

/// A graph with layers applied to it.
#[derive(Debug, Clone)]
pub struct Edited {
    /// The edited graph. Vertices keep their indices: removed vertices stay without edges, new ones come last.
    pub graph: NavGraph,
    /// Edits that could not be applied.
    pub unapplied: Vec<Unapplied>,
    /// Vertices that were removed.
    pub removed: BTreeSet<VertexId>,
    /// Edges that were forced, proved or not.
    pub forced: BTreeSet<EdgeKey>,
    /// Edges that were forbidden; the graph lacks them.
    pub forbidden: BTreeSet<EdgeKey>,
}

/// Access to the level that edits are applied on.
pub trait Terrain {
    /// Returns the position of the feet of a character that stands at `place`, m; `None` if the character cannot
    /// stand there.
    fn stand(&self, place: Vec3) -> Option<Vec3>;

    /// Probes candidate edges between vertices at these positions. Returns one evidence per candidate, in order;
    /// `None` if cancelled.
    fn prove(&self, vertices: &[Vec3], candidates: &[Candidate]) -> Option<Vec<Evidence>>;
}

/// A map on which candidate edges are probed as in the build of the graph, except that every candidate is probed
/// `settings.repeats` times.
pub struct MapTerrain {
    /// The map and the character.
    pub site: Site,
    /// Runs the probes.
    pub executor: Box<dyn ProbeExecutor + Send + Sync>,
    /// Settings that the graph was built with.
    pub settings: BuildSettings,
    /// Number of threads.
    pub thread_count: usize,
    /// Counts the probes, and cancels them.
    pub progress: Arc<Progress>,
}

impl Terrain for MapTerrain {
    fn stand(&self, place: Vec3) -> Option<Vec3> {
        navigable::stand_at(&self.site.map, &self.site.profile, place, STAND_M, &mut MoveScratch::default())
    }

    fn prove(&self, vertices: &[Vec3], candidates: &[Candidate]) -> Option<Vec<Evidence>> {
        let builder = Builder {
            site: &self.site,
            settings: &self.settings,
            executor: &*self.executor,
            thread_count: self.thread_count,
            clock: &|| 0.0,
            progress: &self.progress,
        };
        builder.prover(vertices, candidates).run(Probing::Exhaustive).ok()
    }
}

/// Applies `layers` to `graph`, in order. An edge to or from a new or moved vertex is kept if its success rate reaches
/// `threshold`. Returns `None` if probing was cancelled.
pub fn apply_layers(graph: &NavGraph, layers: &[Layer], threshold: f64, terrain: &dyn Terrain) -> Option<Edited> {
    let mut editor = GraphEditor::of(graph);
    let mut unapplied = Vec::new();
    let edits = || layers.iter().flat_map(|layer| layer.edits.iter().enumerate().map(move |edit| (layer, edit)));
    let mut record = |layer: &Layer, index, result: Result<(), UnappliedReason>| {
        if let Err(reason) = result {
            unapplied.push(Unapplied { layer: layer.name.clone(), index, reason });
        }
    };
    for (layer, (index, edit)) in edits() {
        record(layer, index, editor.change_vertices(edit, terrain));
    }
    editor.prove_unprobed(threshold, terrain)?;
    for (layer, (index, edit)) in edits() {
        record(layer, index, editor.change_edges(edit));
    }
    let (data, removed) = editor.graph.into_data();
    let graph = NavGraph::check(data).expect("edits join existing vertices");
    Some(Edited { graph, unapplied, removed, forced: editor.forced, forbidden: editor.forbidden })
}

/// A graph to which edits are being applied.
struct GraphEditor {
    graph: Editable,
    /// Vertices that were added or moved.
    unprobed: BTreeSet<VertexId>,
    /// Edges that were forced.
    forced: BTreeSet<EdgeKey>,
    /// Edges that were forbidden.
    forbidden: BTreeSet<EdgeKey>,
}

impl GraphEditor {
    fn of(graph: &NavGraph) -> Self {
        Self {
            graph: Editable::of(graph, FIT_M),
            unprobed: BTreeSet::new(),
            forced: BTreeSet::new(),
            forbidden: BTreeSet::new(),
        }
    }

    /// Returns the nearest remaining vertex, at most [`FIT_M`] away.
    fn vertex_at(&self, place: Vec3) -> Result<VertexId, UnappliedReason> {
        self.graph.vertex_at(place).ok_or(UnappliedReason::NoVertex(place))
    }

    fn length(&self, EdgeKey { from, to }: EdgeKey) -> f32 {
        self.graph.vertices()[from.idx()].distance(self.graph.vertices()[to.idx()])
    }

    /// Returns the key of the edge between the vertices at two positions.
    fn ends(&self, from: Vec3, to: Vec3) -> Result<EdgeKey, UnappliedReason> {
        let (from, to) = (self.vertex_at(from)?, self.vertex_at(to)?);
        if from == to { Err(UnappliedReason::OneVertex) } else { Ok(EdgeKey { from, to }) }
    }

    fn change_vertices(&mut self, edit: &Edit, terrain: &dyn Terrain) -> Result<(), UnappliedReason> {
        let stand = |place| terrain.stand(place).filter(|feet| is_place(*feet)).ok_or(UnappliedReason::NoGround(place));
        match *edit {
            Edit::AddVertex { at } => {
                let vertex = self.graph.add_vertex(stand(at)?);
                self.unprobed.insert(vertex);
            }
            Edit::MoveVertex { from, to } => {
                let vertex = self.vertex_at(from)?;
                self.graph.move_vertex(vertex, stand(to)?);
                self.unprobed.insert(vertex);
            }
            Edit::RemoveVertex { at } => {
                let vertex = self.vertex_at(at)?;
                self.graph.remove_vertex(vertex);
                self.unprobed.remove(&vertex);
            }
            Edit::ForbidEdge { .. } | Edit::ForceEdge { .. } | Edit::PriceEdge { .. } => {}
        }
        Ok(())
    }

    /// Probes added and moved vertices against their nearest neighbours, in both directions. `None` if cancelled.
    fn prove_unprobed(&mut self, threshold: f64, terrain: &dyn Terrain) -> Option<()> {
        if self.unprobed.is_empty() {
            return Some(());
        }
        let near = self.graph.neighbours(self.unprobed.iter().copied(), NEIGHBOURS);
        let pairs = near.flat_map(|(from, near)| near.into_iter().map(move |to| EdgeKey { from, to }));
        let short = pairs.filter(|key| self.length(*key) <= MAX_EDGE_M);
        let candidates: BTreeSet<Candidate> = short.flat_map(|there| [there, there.reversed()]).collect();
        if candidates.is_empty() {
            return Some(());
        }
        let candidates: Vec<Candidate> = candidates.into_iter().collect();
        let evidence = terrain.prove(self.graph.vertices(), &candidates)?;
        let proved = candidates.iter().zip(evidence).filter(|(_, evidence)| evidence.proves(threshold));
        proved.for_each(|(&key, evidence)| self.graph.add_edge(Edge { key, evidence }));
        Some(())
    }

    fn change_edges(&mut self, edit: &Edit) -> Result<(), UnappliedReason> {
        match *edit {
            Edit::ForbidEdge { from, to } => {
                let key = self.ends(from, to)?;
                if !self.graph.remove_edge(key) {
                    return Err(UnappliedReason::NoEdge(key));
                }
                self.forced.remove(&key);
                self.forbidden.insert(key);
            }
            Edit::ForceEdge { from, to, seconds } => {
                let key = self.ends(from, to)?;
                if self.length(key) > MAX_EDGE_M {
                    return Err(UnappliedReason::TooLong(key));
                }
                let [start, end] = [key.from, key.to].map(|end| self.graph.vertices()[end.idx()]);
                let decisions = match seconds {
                    Some(seconds) => Seconds(seconds).decisions(),
                    None => self.graph.legs().decisions(start, end),
                };
                self.graph.remove_edge(key);
                self.graph.add_edge(Edge { key, evidence: Evidence::forced(decisions) });
                self.forced.insert(key);
                self.forbidden.remove(&key);
            }
            Edit::PriceEdge { from, to, factor } => {
                let key = self.ends(from, to)?;
                let edge = self.graph.edge_mut(key).ok_or(UnappliedReason::NoEdge(key))?;
                edge.evidence.price_factor =
                    (edge.evidence.price_factor * factor).clamp(*FACTORS.start(), *FACTORS.end());
            }
            Edit::AddVertex { .. } | Edit::MoveVertex { .. } | Edit::RemoveVertex { .. } => {}
        }
        Ok(())
    }
}
