//! Export of graphs to other programs: GraphML for graph tools, and node-link JSON for networkx. For the NavMeshes of
//! engines, [`links`] selects edges and [`assets`] writes them.

pub mod assets;
pub mod links;

use crate::evidence::Evidence;
use crate::graph::{Edge, GraphData, NavGraph};
use crate::ids::{EdgeKey, VertexId};
use crate::legs::LegModel;
use serde::{Deserialize, Serialize};
use std::fmt::{Display, Write};
use std::sync::Arc;
use strum::VariantArray;
use surefoot_world::character::OwnMove;
use surefoot_world::map::{LevelFrame, UpAxis};
use surefoot_world::{CharacterProfile, DECISION_SECONDS, DVec3, Vec3};

/// File format of an exported graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::VariantArray, strum::IntoStaticStr)]
#[strum(serialize_all = "lowercase")]
pub enum Format {
    /// GraphML 1.0, an XML format.
    GraphMl,
    /// Node-link JSON as networkx reads and writes it, with all data that [`import_json`] needs.
    Json,
}

impl Format {
    /// All formats.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// Returns the name that commands use.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Facts about a graph that its file has besides the graph.
#[derive(Debug, Clone, Default)]
pub struct About {
    /// How the level's own coordinates relate to the map's, if known.
    pub frame: Option<LevelFrame>,
    /// The body for which the graph was proved.
    pub body: Option<CharacterProfile>,
}

/// Writes `graph` in `format`.
pub fn export(graph: &NavGraph, format: Format) -> String {
    export_about(graph, format, About::default())
}

/// Writes `graph` in `format`; JSON also has the facts in `about`.
pub fn export_about(graph: &NavGraph, format: Format, about: About) -> String {
    match format {
        Format::GraphMl => graphml(graph),
        Format::Json => {
            serde_json::to_string_pretty(&NodeLink::of(graph, about)).expect("a graph is plain data") + "\n"
        }
    }
}

/// Why a file cannot be imported as a graph.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The file is not node-link JSON in the form of [`Format::Json`].
    #[error("the file is not in the format that `surefoot graph export --format json` writes: {0}")]
    Json(#[from] serde_json::Error),
    /// The graph in the file is invalid.
    #[error(transparent)]
    Graph(#[from] crate::graph::GraphError),
    /// Node ids are not 0, 1, 2 and so on.
    #[error("node {0} has id {1}, but ids must count from 0 in order")]
    Ids(usize, u64),
}

/// Reads a graph from node-link JSON that [`export`] wrote.
///
/// # Errors
/// If `text` is not JSON of that form, or the graph in it is invalid.
pub fn import_json(text: &str) -> Result<NavGraph, ImportError> {
    let file: NodeLink = serde_json::from_str(text)?;
    if let Some((idx, node)) = file.nodes.iter().enumerate().find(|(idx, node)| node.id != *idx as u64) {
        return Err(ImportError::Ids(idx, node.id));
    }
    Ok(NavGraph::check(GraphData {
        vertices: file.nodes.iter().map(|node| Vec3::new(node.x, node.y, node.z)).collect(),
        edges: file
            .edges
            .into_iter()
            .map(|link| Edge { key: EdgeKey::new(link.source, link.target), evidence: link.evidence })
            .collect(),
        legs: file.graph.legs,
        moves: file.graph.moves,
    })?)
}

/// Reads the body for which a graph was proved from JSON that [`export_about`] wrote, if it has one.
pub fn body_of(text: &str) -> Option<CharacterProfile> {
    #[derive(Deserialize)]
    struct File {
        graph: Fields,
    }
    #[derive(Deserialize)]
    struct Fields {
        body: CharacterProfile,
    }
    serde_json::from_str::<File>(text).ok().map(|file| file.graph.body)
}

/// Reads how the coordinates of a graph's level relate to its map's from JSON that [`export_about`] wrote, if it says
/// so.
pub fn frame_of(text: &str) -> Option<LevelFrame> {
    #[derive(Deserialize)]
    struct File {
        graph: FrameFields,
    }
    serde_json::from_str::<File>(text).ok()?.graph.frame()
}

/// The frame of a level in files. `P` is a point.
#[derive(Serialize, Deserialize)]
struct FrameFields<P = [f64; 3]> {
    /// Position of the level's own origin on the map, m; absent if the frame is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    origin: Option<P>,
    /// Metres per unit of the level; absent: 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    scale: Option<f64>,
    /// Upright axis of the level, "z"; absent: y.
    #[serde(skip_serializing_if = "Option::is_none")]
    up: Option<String>,
}

impl<P> FrameFields<P> {
    fn of(frame: Option<LevelFrame>, point: impl Fn(DVec3) -> P) -> Self {
        Self {
            origin: frame.map(|frame| point(frame.origin)),
            scale: frame.map(|frame| frame.scale).filter(|scale| *scale != 1.0),
            up: frame.filter(|frame| frame.up == UpAxis::Z).map(|_| "z".to_owned()),
        }
    }
}

impl FrameFields {
    fn frame(&self) -> Option<LevelFrame> {
        let up = match self.up.as_deref() {
            None | Some("y") => UpAxis::Y,
            Some("z") => UpAxis::Z,
            Some(_) => return None,
        };
        Some(LevelFrame { origin: DVec3::from_array(self.origin?), scale: self.scale.unwrap_or(1.0), up })
    }
}

#[derive(Serialize, Deserialize)]
struct NodeLink {
    directed: bool,
    multigraph: bool,
    graph: GraphFields,
    nodes: Vec<Node>,
    edges: Vec<Link>,
}

#[derive(Serialize, Deserialize)]
struct GraphFields {
    units: String,
    #[serde(flatten)]
    frame: FrameFields,
    legs: LegModel,
    /// Moves of the body's own.
    #[serde(default, skip_serializing_if = "is_empty")]
    moves: Arc<[OwnMove]>,
    /// The body for which the graph was proved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    body: Option<CharacterProfile>,
}

fn is_empty(moves: &Arc<[OwnMove]>) -> bool {
    moves.is_empty()
}

#[derive(Serialize, Deserialize)]
struct Node {
    id: u64,
    x: f32,
    y: f32,
    z: f32,
    island: u32,
}

#[derive(Serialize, Deserialize)]
struct Link {
    source: u32,
    target: u32,
    /// Cost that a search minimises, in decisions.
    weight: f64,
    seconds: f64,
    chance: f64,
    ability: String,
    evidence: Evidence,
}

impl NodeLink {
    fn of(graph: &NavGraph, about: About) -> Self {
        let node = |(id, &island): (u64, &u32)| {
            let at = graph.position(VertexId(id as u32));
            Node { id, x: at.x, y: at.y, z: at.z, island }
        };
        let link = |edge: &Edge| Link {
            source: edge.key.from.0,
            target: edge.key.to.0,
            weight: edge.evidence.cost(),
            seconds: seconds(&edge.evidence),
            chance: edge.evidence.chance().get(),
            ability: graph.name_of(edge.evidence.ability).to_owned(),
            evidence: edge.evidence,
        };
        Self {
            directed: true,
            multigraph: false,
            graph: GraphFields {
                units: "metres, seconds, y up, right-handed".to_owned(),
                frame: FrameFields::of(about.frame, |origin| origin.to_array()),
                legs: *graph.legs(),
                moves: graph.moves().clone(),
                body: about.body,
            },
            nodes: (0..).zip(graph.islands()).map(node).collect(),
            edges: graph.edges().map(link).collect(),
        }
    }
}

/// Returns the mean duration of the probes that arrived, s.
fn seconds(evidence: &Evidence) -> f64 {
    evidence.decisions_mean().0 * f64::from(DECISION_SECONDS)
}

fn graphml(graph: &NavGraph) -> String {
    let mut text = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<graphml xmlns=\"http://graphml.graphdrawing.org/xmlns\">\n",
    );
    let keys = [
        ("x", "node", "double"),
        ("y", "node", "double"),
        ("z", "node", "double"),
        ("island", "node", "int"),
        ("weight", "edge", "double"),
        ("seconds", "edge", "double"),
        ("chance", "edge", "double"),
        ("ability", "edge", "string"),
        ("tries", "edge", "int"),
        ("successes", "edge", "int"),
    ];
    for (name, of, kind) in keys {
        line(&mut text, format_args!("  <key id=\"{name}\" for=\"{of}\" attr.name=\"{name}\" attr.type=\"{kind}\"/>"));
    }
    text += "  <graph id=\"surefoot\" edgedefault=\"directed\">\n";
    let data = |fields: &[(&str, &dyn Display)]| -> String {
        fields.iter().map(|(key, value)| format!("<data key=\"{key}\">{value}</data>")).collect()
    };
    for (vertex, island) in graph.vertices().zip(graph.islands()) {
        let at = graph.position(vertex);
        let data = data(&[("x", &at.x), ("y", &at.y), ("z", &at.z), ("island", island)]);
        line(&mut text, format_args!("    <node id=\"{vertex}\">{data}</node>"));
    }
    for Edge { key, evidence } in graph.edges() {
        let data = data(&[
            ("weight", &evidence.cost()),
            ("seconds", &seconds(evidence)),
            ("chance", &evidence.chance().get()),
            ("ability", &graph.name_of(evidence.ability)),
            ("tries", &evidence.tries),
            ("successes", &evidence.successes),
        ]);
        line(&mut text, format_args!("    <edge source=\"{}\" target=\"{}\">{data}</edge>", key.from, key.to));
    }
    text + "  </graph>\n</graphml>\n"
}

fn line(text: &mut String, arguments: std::fmt::Arguments<'_>) {
    writeln!(text, "{arguments}").expect("writing to a String does not fail");
}
