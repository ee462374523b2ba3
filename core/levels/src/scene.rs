//! A level as read from a file: nodes with triangles, and the frame of its coordinates.

use crate::animated::Animation;
use crate::faults::ImportError;
use serde_json::value::RawValue;
use surefoot_world::Vec3;
use surefoot_world::map::MapSize;

/// Vertical axis of a level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum UpAxis {
    /// y is up, as in glTF and on maps.
    #[default]
    Y,
    /// z is up, as in many OBJ files: (x, y, z) becomes (x, z, -y).
    Z,
}

/// How to interpret a level's coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImportOptions {
    /// Metres per unit of the level, above 0.
    pub scale: f32,
    /// Vertical axis of the level.
    pub up: UpAxis,
    /// Leaves the fronts and backs of all surfaces as they were modelled, instead of turning what looks wrong and
    /// giving thickness to surfaces without.
    pub keep_sides: bool,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self { scale: 1.0, up: UpAxis::Y, keep_sides: false }
    }
}

/// A level as named nodes, in its own coordinates; parents come before their children.
pub(super) struct Scene {
    pub(super) nodes: Vec<Node>,
    /// Size of the map that was exported; `None` for other levels.
    pub(super) former_size: Option<MapSize>,
    /// Number of point and line primitives that were left out.
    pub(super) skipped_count: usize,
}

/// One node with its triangles.
pub(super) struct Node {
    /// Name of the node; empty if it has none.
    pub(super) name: String,
    pub(super) parent: Option<usize>,
    pub(super) origin: Vec3,
    /// Triangles with corners counter-clockwise seen from outside.
    pub(super) triangles: Vec<[Vec3; 3]>,
    /// Properties that the designer attached to the node, as JSON.
    pub(super) extras: Option<Box<RawValue>>,
    /// How the node is animated; `None` if it is not.
    pub(super) animation: Option<Animation>,
}

/// Converts between the level's coordinates and metres, y up.
#[derive(Clone, Copy)]
pub(super) struct Frame(ImportOptions);

impl Frame {
    pub(super) fn new(options: &ImportOptions) -> Result<Self, ImportError> {
        let is_length = options.scale > 0.0 && options.scale.is_finite();
        if is_length { Ok(Self(*options)) } else { Err(ImportError::Scale(options.scale)) }
    }

    pub(super) fn to_metres(self, point: Vec3) -> Vec3 {
        let upright = match self.0.up {
            UpAxis::Y => point,
            UpAxis::Z => Vec3::new(point.x, point.z, -point.y),
        };
        upright * self.0.scale
    }

    pub(super) fn to_level(self, point: Vec3) -> Vec3 {
        let point = point / self.0.scale;
        match self.0.up {
            UpAxis::Y => point,
            UpAxis::Z => Vec3::new(point.x, -point.z, point.y),
        }
    }
}

/// Label of a node in messages.
pub(super) fn node_label(name: &str, idx: usize) -> String {
    if name.is_empty() { format!("node {idx}") } else { format!("node `{name}`") }
}
