//! Errors that keep a level from becoming a map, and warnings that do not.
//!
//! Messages name the level's own nodes and meshes, and say what to change.

use crate::load::Overload;
use glam::DVec3;
use std::fmt;
use surefoot_world::Vec3;
use surefoot_world::map::MapSize;
use surefoot_world::map::MoverError;
use surefoot_world::map::spec::{MAX_HEIGHT_M, MAX_SIDE_M};
use surefoot_world::map::spot::MAX_TAG_LEN;

/// Most triangles of a level.
pub(super) const MAX_TRIANGLES: usize = 4_000_000;

/// Something that a designer may want to change in a level, although it can be used.
#[derive(Debug, Clone, PartialEq)]
pub enum Warning {
    /// Doors, stairs and the like are too large or small for people.
    Unit {
        /// Metres per unit that would suit people.
        scale: f64,
        /// What was measured.
        evidence: String,
    },
    /// A node, or a part of one, does not belong to the level and was left out.
    LeftOut {
        /// What was left out or clipped, and why.
        text: String,
    },
    /// Edges join two triangles that face opposite ways.
    InconsistentEdges {
        /// Number of edges.
        count: usize,
    },
    /// Nodes of pools have no height.
    FlatPools {
        /// Number of pools.
        count: usize,
    },
    /// Names begin like those of features, but with further letters.
    NearMiss {
        /// Name of the first such node.
        name: String,
        /// The word with which it begins.
        word: &'static str,
        /// Number of such nodes.
        count: usize,
    },
    /// A group has the name of a feature, but holds most of the level.
    Group {
        /// Name of the node.
        node: String,
    },
    /// A node that is called a device is too large for one.
    LargeDevice {
        /// Name of the node.
        node: String,
        /// The larger of its sides, m.
        side: f32,
    },
    /// A zip line or teleporter has only one end.
    NoOtherEnd {
        /// Name of the node.
        node: String,
        /// Name that the node of the other end should have.
        missing: String,
    },
    /// Two nodes stand for the same end.
    SecondEnd {
        /// Name of the second node.
        node: String,
        /// The end: `from` or `to`.
        end: &'static str,
    },
    /// The name of a zip line or teleporter does not say which end the node is.
    NoEnd {
        /// Name of the node.
        node: String,
    },
    /// An exported map no longer fits its former size.
    Outgrown {
        /// Size of the map when it was exported.
        former: MapSize,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unit { scale, evidence } => write!(f, "{evidence}: did you mean a scale of {scale}?"),
            Self::LeftOut { text } => write!(
                f,
                "{text}; to keep it, give the node the property `solid: true`, or list it under `nodes` in the sidecar"
            ),
            Self::InconsistentEdges { count } => write!(
                f,
                "{count} edges join triangles that face opposite ways: bodies pass through one of \
                 the two; make the normals consistent"
            ),
            Self::FlatPools { count } => {
                write!(f, "{count} pools are flat: their liquid is 1 m deep; give their nodes a height for more")
            }
            Self::NearMiss { name, word, count: 1 } => write!(
                f,
                "node `{name}` is solid, although its name begins with `{word}`: a separator must follow the word, as \
                 in `{word}_1`"
            ),
            Self::NearMiss { name, word, count } => write!(
                f,
                "{count} nodes are solid, although their names begin like those of features, as `{name}` with \
                 `{word}`: a separator must follow the word, as in `{word}_1`"
            ),
            Self::Group { node } => {
                write!(f, "node `{node}` holds most of the level, so its name has no meaning; rename it")
            }
            Self::LargeDevice { node, side } => write!(
                f,
                "node `{node}` stays solid: {side:.0} m are too much for the device that its name begins with; if it \
                 is one, list it under `nodes` in the sidecar"
            ),
            Self::NoOtherEnd { node, missing } => {
                write!(f, "node `{node}` has no other end and stays solid: add a node `{missing}`, or rename it")
            }
            Self::SecondEnd { node, end } => {
                write!(f, "node `{node}` is a second {end} end of the same pair and stays solid: rename it")
            }
            Self::NoEnd { node } => write!(
                f,
                "node `{node}` does not say which end it is and stays solid: call it `{node}:from` or `{node}:to`, or \
                 rename it"
            ),
            Self::Outgrown { former: MapSize { width, height, depth } } => write!(
                f,
                "the level no longer fits the {width} x {height} x {depth} m of its export and was placed again"
            ),
        }
    }
}

/// Why a level cannot become a map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ImportError {
    /// The scale is not positive and finite.
    #[error("the scale is {0}, but must be above 0 and finite; use --scale 0.01 for a level in centimetres")]
    Scale(f64),
    /// The container of a binary glTF is damaged.
    #[error("the .glb file is damaged ({0}): export it again")]
    Container(&'static str),
    /// The glTF has another version than 2.
    #[error("the file is glTF {0}: export the level as glTF 2.0")]
    GltfVersion(String),
    /// The JSON of a glTF cannot be read.
    #[error("the JSON of the glTF cannot be read: {0}")]
    Json(String),
    /// The geometry cannot be known without an unsupported extension.
    #[error("the level requires the glTF extension {0}, which is not supported: export it without that")]
    Extension(String),
    /// The geometry is in another file.
    #[error("the geometry is in another file, `{uri}`, which cannot be read: {problem}")]
    ExternalBuffer {
        /// Path of that file, shortened.
        uri: String,
        /// Why, and what to do about it.
        problem: String,
    },
    /// The archive of a level cannot be read.
    #[error("the .zip cannot be read: {0}")]
    Zip(String),
    /// Embedded data cannot be decoded.
    #[error("buffer {buffer} holds no valid base64 data: export the level again, preferably as .glb")]
    Base64 {
        /// Index of the buffer.
        buffer: usize,
    },
    /// A buffer is shorter than it claims.
    #[error("buffer {buffer} has {len} of {expected} bytes: the file is cut off; export it again")]
    ShortBuffer {
        /// Index of the buffer.
        buffer: usize,
        /// Length of the buffer, bytes.
        len: usize,
        /// Length that the file claims, bytes.
        expected: u64,
    },
    /// An index in the glTF's JSON refers to nothing.
    #[error("{from} refers to {to} {idx}, which does not exist: export the level again")]
    Reference {
        /// What holds the reference.
        from: String,
        /// Kind of the missing item.
        to: &'static str,
        /// Index of the missing item.
        idx: usize,
    },
    /// The nodes do not form a tree.
    #[error("{node} is its own ancestor or has two parents: export the level again")]
    NotATree {
        /// The node that is visited twice.
        node: String,
    },
    /// Vertex or index data cannot be read.
    #[error("{mesh} has {problem}")]
    Data {
        /// Name of the mesh.
        mesh: String,
        /// The problem, and what to do about it.
        problem: &'static str,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error("{mesh} refers to vertex {vertex}, but has only {count}: export the level again")]
    VertexOutOfRange {
        /// Name of the mesh.
        mesh: String,
        /// Index of the vertex.
        vertex: u32,
        /// Number of vertices.
        count: usize,
    },
    /// A position is infinite or not a number.
    #[error("{node} has a position that is not a finite number: correct or delete it")]
    NotFinite {
        /// Name of the node or mesh.
        node: String,
    },
    /// The OBJ file cannot be read.
    #[error("the OBJ file cannot be read: {0}")]
    Obj(String),
    /// The level has no solid triangles.
    #[error(
        "the level has no solid triangles: nodes called lava, water, pad, zip_line, teleporter or jetpack, \
         and helpers such as navmesh or trigger, are not solid, and with `colliders` in the sidecar nothing else is"
    )]
    Empty,
    /// The JSON of a glTF has too many objects.
    #[error("the glTF has more than two million nodes, meshes and other objects: join them or split the level")]
    TooManyObjects,
    /// The level has too many triangles.
    #[error("the level has more than {MAX_TRIANGLES} triangles: simplify it or split it")]
    TooManyTriangles,
    /// The level is larger than a map may be.
    #[error(
        "the level is {:.0} x {:.0} x {:.0} m, but at most {MAX_SIDE_M} x {} x {MAX_SIDE_M} m fit: {advice}",
        span.x, span.y, span.z, MAX_HEIGHT_M - 1
    )]
    TooLarge {
        /// Extent of the level, m.
        span: Vec3,
        /// What makes it so large, and what to do.
        advice: String,
    },
    /// The level is too large to index.
    #[error("the level cannot be indexed: {0}")]
    Overload(#[from] Overload),
    /// A property of a feature cannot be used.
    #[error("{of} has {key} {value}: {expected}")]
    Property {
        /// The node or the entry of the sidecar.
        of: String,
        /// Name of the property.
        key: &'static str,
        /// Value of the property.
        value: String,
        /// Allowed values.
        expected: &'static str,
    },
    /// The box of a mover has no volume.
    #[error("{of} is a box without volume: give `min` and `max` that differ along all axes")]
    NoVolume {
        /// The entry of the sidecar.
        of: String,
    },
    /// A tag is not valid.
    #[error(
        "the tag of {of} is `{tag}`, but must be 1 to {MAX_TAG_LEN} lower-case letters, digits and `_`, a letter first"
    )]
    Tag {
        /// The entry of the sidecar.
        of: String,
        /// Its tag.
        tag: String,
    },
    /// A mover cannot be part of a map.
    #[error(transparent)]
    Mover(#[from] MoverError),
    /// A feature lies outside the level.
    #[error("{what} lies outside the level, which spans {low} to {high} in its own coordinates: move or delete it")]
    Outside {
        /// The node or the entry of the sidecar.
        what: String,
        /// Lowest corner of the level, in the level's coordinates.
        low: DVec3,
        /// Highest corner of the level, in the level's coordinates.
        high: DVec3,
    },
    /// The sidecar cannot be read.
    #[error("the sidecar cannot be read: {0}")]
    Sidecar(String),
}
