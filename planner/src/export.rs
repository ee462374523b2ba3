//! Export of graphs to other programs: GraphML and DOT for graph tools, node-link JSON for networkx, and off-mesh links in
//! the fields of Detour's `dtNavMeshCreateParams`, so that proved links join the islands of a NavMesh.

use crate::graph::{Edge, GraphData, NavGraph};
use crate::ids::{EdgeKey, VertexId};
use crate::links::{NavMesh, expected_seconds};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write;
use surefoot_world::{Ability, DECISION_SECONDS, Vec3};

/// File format of an exported graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// GraphML 1.0, an XML format.
    GraphMl,
    /// DOT, the format of Graphviz.
    Dot,
    /// Node-link JSON as networkx reads and writes it, with all data that [`import_json`] needs.
    Json,
    /// Off-mesh connections as JSON, in the fields of Detour.
    Detour,
}

impl Format {
    /// All formats.
    pub const ALL: [Format; 4] = [Format::GraphMl, Format::Dot, Format::Json, Format::Detour];

    /// Returns the name that commands use.
    pub fn name(self) -> &'static str {
        match self {
            Format::GraphMl => "graphml",
            Format::Dot => "dot",
            Format::Json => "json",
            Format::Detour => "detour",
        }
    }
}

/// Writes `graph` in `format`.
///
/// [`Format::Detour`] exports the edges that are worth a link at `max_detour` ([`NavMesh::links`]); without `max_detour`, all
/// edges that `nav_mesh` cannot take by itself ([`NavMesh::needs_link`]).
pub fn export(graph: &NavGraph, format: Format, nav_mesh: NavMesh<'_>, max_detour: Option<f64>) -> String {
    match format {
        Format::GraphMl => graphml(graph),
        Format::Dot => dot(graph),
        Format::Json => serde_json::to_string_pretty(&NodeLink::of(graph)).expect("a graph is plain data") + "\n",
        Format::Detour => {
            let links = match max_detour {
                Some(max_detour) => nav_mesh.links(graph, max_detour),
                None => graph.edges().filter(|edge| nav_mesh.needs_link(graph, edge)).collect(),
            };
            let links = OffMeshLinks::of(graph, &links, nav_mesh.radius);
            serde_json::to_string_pretty(&links).expect("links are plain data") + "\n"
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
    })?)
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
    legs: crate::legs::LegModel,
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
    evidence: crate::evidence::Evidence,
}

impl NodeLink {
    fn of(graph: &NavGraph) -> Self {
        let node = |(id, &island): (u64, &u32)| {
            let at = graph.position(VertexId(id as u32));
            Node { id, x: at.x, y: at.y, z: at.z, island }
        };
        let link = |edge: &Edge| Link {
            source: edge.key.from.0,
            target: edge.key.to.0,
            weight: edge.evidence.cost(),
            seconds: seconds(edge),
            chance: edge.evidence.chance().get(),
            ability: edge.evidence.ability.name().to_owned(),
            evidence: edge.evidence,
        };
        Self {
            directed: true,
            multigraph: false,
            graph: GraphFields { units: "metres, seconds, y up, right-handed".to_owned(), legs: *graph.legs() },
            nodes: (0..).zip(graph.islands()).map(node).collect(),
            edges: graph.edges().map(link).collect(),
        }
    }
}

/// Returns the mean duration of the probes that arrived, s.
fn seconds(edge: &Edge) -> f64 {
    edge.evidence.decisions_mean().0 * f64::from(DECISION_SECONDS)
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
    for (vertex, island) in graph.vertices().zip(graph.islands()) {
        let at = graph.position(vertex);
        line(
            &mut text,
            format_args!(
                "    <node id=\"{vertex}\"><data key=\"x\">{}</data><data key=\"y\">{}</data><data key=\"z\">{}</data><data key=\"island\">{island}</data></node>",
                at.x, at.y, at.z
            ),
        );
    }
    for edge in graph.edges() {
        let evidence = &edge.evidence;
        line(
            &mut text,
            format_args!(
                "    <edge source=\"{}\" target=\"{}\"><data key=\"weight\">{}</data><data key=\"seconds\">{}</data><data key=\"chance\">{}</data><data key=\"ability\">{}</data><data key=\"tries\">{}</data><data key=\"successes\">{}</data></edge>",
                edge.key.from,
                edge.key.to,
                evidence.cost(),
                seconds(edge),
                evidence.chance().get(),
                evidence.ability.name(),
                evidence.tries,
                evidence.successes
            ),
        );
    }
    text + "  </graph>\n</graphml>\n"
}

fn dot(graph: &NavGraph) -> String {
    let mut text = String::from("digraph surefoot {\n  // Positions are x and z in metres; draw with neato -n.\n");
    for (vertex, island) in graph.vertices().zip(graph.islands()) {
        let at = graph.position(vertex);
        line(&mut text, format_args!("  {vertex} [pos=\"{},{}\", y={}, island={island}];", at.x, -at.z, at.y));
    }
    for edge in graph.edges() {
        let evidence = &edge.evidence;
        line(
            &mut text,
            format_args!(
                "  {} -> {} [weight={}, seconds={}, chance={}, ability={}];",
                edge.key.from,
                edge.key.to,
                evidence.cost(),
                seconds(edge),
                evidence.chance().get(),
                evidence.ability.name()
            ),
        );
    }
    text + "}\n"
}

fn line(text: &mut String, arguments: std::fmt::Arguments<'_>) {
    writeln!(text, "{arguments}").expect("writing to a String does not fail");
}

/// Off-mesh connections in the fields of `dtNavMeshCreateParams`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
struct OffMeshLinks {
    /// Number of links.
    off_mesh_con_count: usize,
    /// Start and end of each link: count x 6 coordinates, m.
    off_mesh_con_verts: Vec<f32>,
    /// Radius of the ends of each link, m.
    off_mesh_con_rad: Vec<f32>,
    /// Direction of each link: 0 from start to end only, 1 (`DT_OFFMESH_CON_BIDIR`) both ways.
    off_mesh_con_dir: Vec<u8>,
    /// Area of each link; every ability has an area of its own.
    off_mesh_con_areas: Vec<u8>,
    /// Flags of each link: one bit for each ability, from bit 0; bit 6 for drops.
    off_mesh_con_flags: Vec<u16>,
    /// Index of each link's edge in the graph's JSON export.
    #[serde(rename = "offMeshConUserID")]
    off_mesh_con_user_id: Vec<u32>,
    /// Cost of each link in seconds, as [`expected_seconds`] returns it. Detour has no such field; area costs can be derived
    /// from it.
    off_mesh_con_seconds: Vec<f32>,
    /// Estimated chance of success of each link, 0 to 1.
    off_mesh_con_chance: Vec<f32>,
    /// Area and flag of each ability.
    legend: Vec<AbilityKey>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct AbilityKey {
    ability: String,
    area: u8,
    flag: u16,
}

/// Area of the first ability; the others follow. Recast reserves 0 and 63.
const FIRST_AREA: u8 = 1;

impl OffMeshLinks {
    /// Creates the links of `edges`, with ends of this radius, m.
    fn of(graph: &NavGraph, edges: &[&Edge], radius: f32) -> Self {
        let kept: BTreeMap<EdgeKey, &Edge> = edges.iter().map(|edge| (edge.key, *edge)).collect();
        let area = |ability: Ability| FIRST_AREA + ability as u8;
        let flag = |ability: Ability| if ability == Ability::Walk { 1 << 6 } else { 1 << (ability as u16 - 1) };
        let mut links = Self {
            off_mesh_con_count: 0,
            off_mesh_con_verts: Vec::new(),
            off_mesh_con_rad: Vec::new(),
            off_mesh_con_dir: Vec::new(),
            off_mesh_con_areas: Vec::new(),
            off_mesh_con_flags: Vec::new(),
            off_mesh_con_user_id: Vec::new(),
            off_mesh_con_seconds: Vec::new(),
            off_mesh_con_chance: Vec::new(),
            legend: Ability::ALL
                .iter()
                .map(|&ability| AbilityKey {
                    ability: if ability == Ability::Walk { "drop" } else { ability.name() }.to_owned(),
                    area: area(ability),
                    flag: flag(ability),
                })
                .collect(),
        };
        for (user_id, edge) in (0u32..).zip(graph.edges()).filter(|(_, edge)| kept.contains_key(&edge.key)) {
            let ability = edge.evidence.ability;
            let back = kept.get(&edge.key.reversed()).filter(|back| back.evidence.ability == ability);
            // A bidirectional link is written once, from its lower vertex.
            if back.is_some() && edge.key.from > edge.key.to {
                continue;
            }
            links.off_mesh_con_count += 1;
            links.off_mesh_con_verts.extend(graph.position(edge.key.from).to_array());
            links.off_mesh_con_verts.extend(graph.position(edge.key.to).to_array());
            links.off_mesh_con_rad.push(radius);
            links.off_mesh_con_dir.push(u8::from(back.is_some()));
            links.off_mesh_con_areas.push(area(ability));
            links.off_mesh_con_flags.push(flag(ability));
            links.off_mesh_con_user_id.push(user_id);
            // A bidirectional link has the worse value of its two directions.
            let worst = |value: fn(&Edge) -> f64, pick: fn(f64, f64) -> f64| {
                back.map_or(value(edge), |back| pick(value(edge), value(back))) as f32
            };
            links.off_mesh_con_seconds.push(worst(expected_seconds, f64::max));
            links.off_mesh_con_chance.push(worst(|edge| edge.evidence.chance().get(), f64::min));
        }
        links
    }
}
