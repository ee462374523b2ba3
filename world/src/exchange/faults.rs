//! What is said about levels: errors that keep one from becoming a map, and warnings that do not.
//!
//! Messages speak of the level's own nodes and meshes, and say what to change.

use super::load::Overload;
use crate::Vec3;
use crate::map::MapSize;
use crate::map::spec::{MAX_HEIGHT_M, MAX_SIDE_M};
use std::fmt;

/// Most triangles of a level.
pub(super) const MAX_TRIANGLES: usize = 4_000_000;

/// Something odd that does not keep a level from being used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Warning {
    /// Triangles without area, left out.
    DegenerateTriangles {
        /// How many.
        count: usize,
    },
    /// Points and lines, left out.
    NotTriangles {
        /// How many primitives.
        count: usize,
    },
    /// Edges of a single triangle.
    OpenEdges {
        /// How many.
        count: usize,
    },
    /// Edges of three or more triangles.
    CrowdedEdges {
        /// How many.
        count: usize,
    },
    /// Edges whose two triangles face opposite ways.
    TurnedEdges {
        /// How many.
        count: usize,
    },
    /// Most of what is seen from above faces down.
    FacesDown {
        /// In percent.
        share: u32,
    },
    /// Pools whose nodes have no height.
    FlatPools {
        /// How many.
        count: usize,
    },
    /// An exported map that no longer fits its former size.
    Outgrown {
        /// The size it had.
        former: MapSize,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::DegenerateTriangles { count } => write!(f, "{count} triangles have no area and were left out"),
            Self::NotTriangles { count } => write!(f, "{count} sets of points or lines were left out"),
            Self::OpenEdges { count } => write!(
                f,
                "{count} edges belong to one triangle only: a wall without thickness can be passed from behind"
            ),
            Self::CrowdedEdges { count } => {
                write!(f, "{count} edges belong to more than two triangles: bodies may overlap or have walls inside")
            }
            Self::TurnedEdges { count } => write!(
                f,
                "{count} edges join triangles that face opposite ways: one of the two can be passed; make the normals consistent"
            ),
            Self::FacesDown { share } => write!(
                f,
                "{share} % of what is seen from above faces down and would not carry anyone: flip the normals"
            ),
            Self::FlatPools { count } => {
                write!(f, "{count} pools are flat: their liquid reaches 1 m down; give their nodes a height for more")
            }
            Self::Outgrown { former: MapSize { width, height, depth } } => write!(
                f,
                "the level no longer fits the {width} x {height} x {depth} m it was exported with and was placed anew"
            ),
        }
    }
}

/// Why a level cannot become a map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ImportError {
    /// The scale is no length.
    #[error("the scale is {0}, but must be above 0 and finite; use --scale 0.01 for a level in centimetres")]
    Scale(f32),
    /// The container of a binary glTF is broken.
    #[error("the .glb file is damaged ({0}): export it again")]
    Container(&'static str),
    /// A glTF of another version than 2.
    #[error("the file is glTF {0}: export the level as glTF 2.0")]
    GltfVersion(String),
    /// The JSON of a glTF cannot be read.
    #[error("the JSON of the glTF cannot be read: {0}")]
    Json(String),
    /// An extension without which the geometry is unknown.
    #[error(
        "the level uses the glTF extension {0}, which is not supported: export it without compression or instancing"
    )]
    Extension(String),
    /// Geometry in another file.
    #[error("the geometry lies in another file, `{uri}`: export the level as one binary .glb")]
    ExternalBuffer {
        /// Where it lies.
        uri: String,
    },
    /// Embedded data that cannot be decoded.
    #[error("buffer {buffer} holds no valid base64 data: export the level again, best as .glb")]
    Base64 {
        /// Index of the buffer.
        buffer: usize,
    },
    /// A buffer shorter than it says.
    #[error("buffer {buffer} has {len} of {expected} bytes: the file is cut off; export it again")]
    ShortBuffer {
        /// Index of the buffer.
        buffer: usize,
        /// Bytes that there are.
        len: usize,
        /// Bytes that there should be.
        expected: u64,
    },
    /// An index within the glTF's JSON that leads nowhere.
    #[error("{from} refers to {to} {idx}, which does not exist: export the level again")]
    Reference {
        /// What refers.
        from: String,
        /// What it refers to.
        to: &'static str,
        /// Its index.
        idx: usize,
    },
    /// Nodes that do not form a tree.
    #[error("{node} is its own ancestor or has two parents: export the level again")]
    NotATree {
        /// The node.
        node: String,
    },
    /// Vertex or index data that cannot be read.
    #[error("{mesh} has {problem}")]
    Data {
        /// The mesh.
        mesh: String,
        /// What is wrong with it, and what helps.
        problem: &'static str,
    },
    /// A triangle that refers to no vertex.
    #[error("{mesh} refers to vertex {vertex}, but has only {count}: export the level again")]
    VertexOutOfRange {
        /// The mesh.
        mesh: String,
        /// Index of the vertex.
        vertex: u32,
        /// How many there are.
        count: usize,
    },
    /// A position that is infinite or not a number.
    #[error("{node} has a position that is not a finite number: correct or delete it")]
    NotFinite {
        /// The node or mesh.
        node: String,
    },
    /// An OBJ file that cannot be read.
    #[error("the OBJ file cannot be read: {0}")]
    Obj(String),
    /// Nothing to stand on.
    #[error(
        "the level has no solid triangles: nodes called lava, water, pad, zip_line, teleporter or jetpack are not solid"
    )]
    Empty,
    /// Too many triangles.
    #[error("the level has more than {MAX_TRIANGLES} triangles: simplify it or split it")]
    TooManyTriangles,
    /// Larger than a map may be.
    #[error(
        "the level is {:.0} x {:.0} x {:.0} m, but at most {MAX_SIDE_M} x {} x {MAX_SIDE_M} m fit: use --scale (0.01 if it is in centimetres) or split it",
        .0.x, .0.y, .0.z, MAX_HEIGHT_M - 1
    )]
    TooLarge(Vec3),
    /// Too much for any machine.
    #[error("the level cannot be indexed: {0}")]
    Overload(#[from] Overload),
    /// One end of a zip line or teleporter without the other.
    #[error("node `{node}` has no other half: add a node `{missing}`")]
    MissingHalf {
        /// The node.
        node: String,
        /// What the other should be called.
        missing: String,
    },
    /// Two nodes for the same end.
    #[error("node `{node}` is a second {end} end of the same pair: rename it")]
    SecondHalf {
        /// The node.
        node: String,
        /// Which end: `from` or `to`.
        end: &'static str,
    },
    /// A zip line or teleporter whose name does not say which end it is.
    #[error("node `{node}` does not say which end it is: call it `{node}:from` or `{node}:to`")]
    NoEnd {
        /// The node.
        node: String,
    },
    /// A feature's property that cannot be used.
    #[error("{of} has {key} {value}: {expected}")]
    Property {
        /// The node or entry.
        of: String,
        /// Name of the property.
        key: &'static str,
        /// What it is set to.
        value: String,
        /// What is allowed.
        expected: &'static str,
    },
    /// A feature off the map.
    #[error("{what} lies outside the level, which spans {low} to {high} in its own coordinates: move or delete it")]
    Outside {
        /// The node or entry.
        what: String,
        /// Lowest corner of the level.
        low: Vec3,
        /// Highest corner of the level.
        high: Vec3,
    },
    /// The sidecar cannot be read.
    #[error("the sidecar cannot be read: {0}")]
    Sidecar(String),
}
