//! Designers' changes to a graph: named layers of edits that apply to what was proved.
//!
//! Edits name places, not indices, so a layer outlives the graph that it was made on: after a rebuild with other
//! settings, another policy or a changed map it is laid over whatever stands there now. An edit that finds nothing to
//! change is left out and [says so](Unapplied). Vertices are changed first, in the order of the edits, then edges.

use crate::build::{Builder, Progress};
use crate::candidates::Candidate;
use crate::evidence::Evidence;
use crate::graph::{Edge, GraphData, NavGraph};
use crate::ids::{EdgeKey, VertexId};
use crate::probe::ProbeExecutor;
use crate::settings::{BuildSettings, Probing};
use crate::site::Site;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use surefoot_world::character::MoveScratch;
use surefoot_world::{Seconds, Vec3, navigable};

/// How far from the place that an edit names a vertex may stand, m.
const FIT_M: f32 = 3.0;
/// How much higher or lower than asked for a new vertex may come to stand, m.
const STAND_M: f32 = 2.0;
/// Most edits of a layer.
pub const MAX_EDITS: usize = 4096;
/// Longest name of a layer, in bytes.
pub const MAX_NAME: usize = 64;
/// What a price may be multiplied by.
pub const FACTORS: std::ops::RangeInclusive<f32> = 0.1..=1000.0;
/// Longest time that a forced edge may be said to take, s.
const MAX_SECONDS: f32 = 3600.0;
/// Vertices that a new one is tried against.
const NEIGHBOURS: usize = 12;

/// One change.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "edit", rename_all = "snake_case", deny_unknown_fields)]
pub enum Edit {
    /// Takes the edge between the vertices at these places out.
    ForbidEdge {
        /// Where it leaves, m.
        from: Vec3,
        /// Where it leads, m.
        to: Vec3,
    },
    /// Puts an edge in, proved or not.
    ForceEdge {
        /// Where it leaves, m.
        from: Vec3,
        /// Where it leads, m.
        to: Vec3,
        /// How long it takes, s; estimated if not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        seconds: Option<f32>,
    },
    /// Makes an edge dearer or cheaper.
    PriceEdge {
        /// Where it leaves, m.
        from: Vec3,
        /// Where it leads, m.
        to: Vec3,
        /// Factor on its price, 0.1 to 1000.
        factor: f32,
    },
    /// Puts a vertex in and tries it against its nearest, both ways.
    AddVertex {
        /// Where, m.
        at: Vec3,
    },
    /// Moves a vertex and tries it again.
    MoveVertex {
        /// Where it stands, m.
        from: Vec3,
        /// Where it is to stand, m.
        to: Vec3,
    },
    /// Takes a vertex and all its edges out.
    RemoveVertex {
        /// Where it stands, m.
        at: Vec3,
    },
}

/// A named list of edits.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Layer {
    /// Its name.
    pub name: String,
    /// What it changes, in order.
    pub edits: Vec<Edit>,
}

/// A layer that cannot be taken.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LayerError {
    /// Its name is empty, too long or holds control characters.
    #[error("layer names have 1 to {MAX_NAME} bytes and no control characters")]
    Name,
    /// It is too long.
    #[error("a layer holds at most {MAX_EDITS} edits, this one {0}")]
    Length(usize),
    /// A number is out of range.
    #[error("edit {index}: {field} is {value}, allowed are {allowed}")]
    Number {
        /// Place of the edit.
        index: usize,
        /// Which number.
        field: &'static str,
        /// What it is.
        value: f32,
        /// What it may be.
        allowed: &'static str,
    },
}

impl Layer {
    /// Checks name and numbers.
    ///
    /// # Errors
    /// Names what is wrong.
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
                    return wrong("position", value, "finite numbers");
                }
            }
            match *edit {
                Edit::PriceEdge { factor, .. } if !FACTORS.contains(&factor) => {
                    return wrong("factor", factor, "0.1 to 1000");
                }
                Edit::ForceEdge { seconds: Some(seconds), .. } if !(0.0..=MAX_SECONDS).contains(&seconds) => {
                    return wrong("seconds", seconds, "0 to 3600");
                }
                _ => {}
            }
        }
        Ok(())
    }
}

impl Edit {
    fn places(&self) -> Vec<Vec3> {
        match *self {
            Edit::ForbidEdge { from, to }
            | Edit::ForceEdge { from, to, .. }
            | Edit::PriceEdge { from, to, .. }
            | Edit::MoveVertex { from, to } => vec![from, to],
            Edit::AddVertex { at } | Edit::RemoveVertex { at } => vec![at],
        }
    }
}

/// Why an edit changes nothing.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Misfit {
    /// No vertex stands where it names one.
    #[error("no vertex stands within {FIT_M} m of ({:.1}, {:.1}, {:.1})", .0.x, .0.y, .0.z)]
    NoVertex(Vec3),
    /// Its two places are the same vertex.
    #[error("both ends are the same vertex")]
    OneVertex,
    /// No edge joins the two vertices.
    #[error("no edge leads from vertex {} to vertex {}", .0.from, .0.to)]
    NoEdge(EdgeKey),
    /// A vertex cannot stand there.
    #[error("the character cannot stand within {STAND_M} m of ({:.1}, {:.1}, {:.1})", .0.x, .0.y, .0.z)]
    NoGround(Vec3),
}

/// An edit that changed nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct Unapplied {
    /// Name of its layer.
    pub layer: String,
    /// Its place in the layer.
    pub index: usize,
    /// Why.
    pub reason: Misfit,
}

/// A graph with layers applied to it.
#[derive(Debug, Clone)]
pub struct Edited {
    /// The graph. Vertices keep their indices; one taken out has no edges, new ones come last.
    pub graph: NavGraph,
    /// Edits that found nothing to change.
    pub unapplied: Vec<Unapplied>,
    /// Vertices that were taken out.
    pub removed: BTreeSet<VertexId>,
    /// Edges that were put in, proved or not.
    pub forced: BTreeSet<EdgeKey>,
}

/// The level that a graph is edited on.
pub trait Terrain {
    /// Where the character comes to stand at a place, m; `None` if it cannot.
    fn stand(&self, place: Vec3) -> Option<Vec3>;

    /// Tries candidate edges between vertices at these positions: one evidence each, or `None` if cancelled.
    fn prove(&self, vertices: &[Vec3], candidates: &[Candidate]) -> Option<Vec<Evidence>>;
}

/// A map, tried as the graph itself was.
pub struct MapTerrain {
    /// The map and the character.
    pub site: Site,
    /// Runs the probes.
    pub executor: Box<dyn ProbeExecutor + Send + Sync>,
    /// How the graph was built.
    pub settings: BuildSettings,
    /// Threads to use.
    pub thread_count: usize,
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
            progress: &Progress::default(),
        };
        builder.proving(vertices, candidates).run(Probing::Exhaustive)
    }
}

/// Applies all `layers` to `graph`, in their order. `None` if proving was cancelled.
pub fn apply_layers(graph: &NavGraph, layers: &[Layer], threshold: f64, terrain: &dyn Terrain) -> Option<Edited> {
    let mut sheet = Sheet::of(graph);
    let mut unapplied = Vec::new();
    let edits = || layers.iter().flat_map(|layer| layer.edits.iter().enumerate().map(move |edit| (layer, edit)));
    let mut note = |layer: &Layer, index, result: Result<(), Misfit>| {
        if let Err(reason) = result {
            unapplied.push(Unapplied { layer: layer.name.clone(), index, reason });
        }
    };
    for (layer, (index, edit)) in edits() {
        note(layer, index, sheet.change_vertices(edit, terrain));
    }
    sheet.prove_fresh(threshold, terrain)?;
    for (layer, (index, edit)) in edits() {
        note(layer, index, sheet.change_edges(edit));
    }
    let graph = NavGraph::check(sheet.data).expect("edits join existing vertices");
    Some(Edited { graph, unapplied, removed: sheet.gone, forced: sheet.forced })
}

/// A graph that is being edited.
struct Sheet {
    data: GraphData,
    /// Vertices that were taken out.
    gone: BTreeSet<VertexId>,
    /// Vertices that were put in or moved.
    fresh: BTreeSet<VertexId>,
    /// Edges that were put in.
    forced: BTreeSet<EdgeKey>,
}

impl Sheet {
    fn of(graph: &NavGraph) -> Self {
        Self { data: graph.to_data(), gone: BTreeSet::new(), fresh: BTreeSet::new(), forced: BTreeSet::new() }
    }

    fn vertex_at(&self, place: Vec3) -> Result<VertexId, Misfit> {
        let standing = (0..).map(VertexId).zip(&self.data.vertices).filter(|(vertex, _)| !self.gone.contains(vertex));
        let nearest = standing.min_by(|a, b| a.1.distance_squared(place).total_cmp(&b.1.distance_squared(place)));
        match nearest {
            Some((vertex, at)) if at.distance(place) <= FIT_M => Ok(vertex),
            _ => Err(Misfit::NoVertex(place)),
        }
    }

    fn ends(&self, from: Vec3, to: Vec3) -> Result<EdgeKey, Misfit> {
        let (from, to) = (self.vertex_at(from)?, self.vertex_at(to)?);
        if from == to { Err(Misfit::OneVertex) } else { Ok(EdgeKey { from, to }) }
    }

    fn change_vertices(&mut self, edit: &Edit, terrain: &dyn Terrain) -> Result<(), Misfit> {
        let stand = |place| terrain.stand(place).ok_or(Misfit::NoGround(place));
        match *edit {
            Edit::AddVertex { at } => {
                let feet = stand(at)?;
                self.fresh.insert(VertexId::at(self.data.vertices.len()));
                self.data.vertices.push(feet);
            }
            Edit::MoveVertex { from, to } => {
                let vertex = self.vertex_at(from)?;
                self.data.vertices[vertex.idx()] = stand(to)?;
                self.cut_off(vertex);
                self.fresh.insert(vertex);
            }
            Edit::RemoveVertex { at } => {
                let vertex = self.vertex_at(at)?;
                self.cut_off(vertex);
                self.fresh.remove(&vertex);
                self.gone.insert(vertex);
            }
            Edit::ForbidEdge { .. } | Edit::ForceEdge { .. } | Edit::PriceEdge { .. } => {}
        }
        Ok(())
    }

    fn cut_off(&mut self, vertex: VertexId) {
        self.data.edges.retain(|edge| edge.key.from != vertex && edge.key.to != vertex);
    }

    /// Tries new and moved vertices against their nearest, both ways.
    fn prove_fresh(&mut self, threshold: f64, terrain: &dyn Terrain) -> Option<()> {
        let mut candidates: BTreeSet<Candidate> = BTreeSet::new();
        for &vertex in &self.fresh {
            let at = self.data.vertices[vertex.idx()];
            let mut others: Vec<(f32, VertexId)> = (0..)
                .map(VertexId)
                .zip(&self.data.vertices)
                .filter(|(other, _)| *other != vertex && !self.gone.contains(other))
                .map(|(other, place)| (place.distance_squared(at), other))
                .collect();
            others.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            candidates.extend(others.iter().take(NEIGHBOURS).flat_map(|&(_, other)| {
                let there = EdgeKey { from: vertex, to: other };
                [there, there.reversed()]
            }));
        }
        if candidates.is_empty() {
            return Some(());
        }
        let candidates: Vec<Candidate> = candidates.into_iter().collect();
        let evidence = terrain.prove(&self.data.vertices, &candidates)?;
        let proved = candidates.iter().zip(evidence).filter(|(_, evidence)| evidence.proves(threshold));
        self.data.edges.extend(proved.map(|(&key, evidence)| Edge { key, evidence }));
        Some(())
    }

    fn change_edges(&mut self, edit: &Edit) -> Result<(), Misfit> {
        match *edit {
            Edit::ForbidEdge { from, to } => {
                let key = self.ends(from, to)?;
                let before = self.data.edges.len();
                self.data.edges.retain(|edge| edge.key != key);
                if self.data.edges.len() == before {
                    return Err(Misfit::NoEdge(key));
                }
                self.forced.remove(&key);
            }
            Edit::ForceEdge { from, to, seconds } => {
                let key = self.ends(from, to)?;
                let (start, end) = (self.data.vertices[key.from.idx()], self.data.vertices[key.to.idx()]);
                let decisions = match seconds {
                    Some(seconds) => Seconds(seconds).decisions(),
                    None => self.data.legs.decisions(start, end),
                };
                self.data.edges.retain(|edge| edge.key != key);
                self.data.edges.push(Edge { key, evidence: Evidence::vouched(decisions) });
                self.forced.insert(key);
            }
            Edit::PriceEdge { from, to, factor } => {
                let key = self.ends(from, to)?;
                let edge = self.data.edges.iter_mut().find(|edge| edge.key == key);
                let edge = edge.ok_or(Misfit::NoEdge(key))?;
                edge.evidence.price_factor =
                    (edge.evidence.price_factor * factor).clamp(*FACTORS.start(), *FACTORS.end());
            }
            Edit::AddVertex { .. } | Edit::MoveVertex { .. } | Edit::RemoveVertex { .. } => {}
        }
        Ok(())
    }
}
