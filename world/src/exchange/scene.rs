//! A level as files say it, before it becomes a map: nodes with triangles, and how to read its coordinates.

use super::faults::ImportError;
use crate::Vec3;
use crate::map::MapSize;
use serde_json::value::RawValue;

/// Which way is up in the level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum UpAxis {
    /// As in glTF and here.
    #[default]
    Y,
    /// As in many OBJ files: (x, y, z) becomes (x, z, -y).
    Z,
}

/// How to read a level's coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImportOptions {
    /// Metres for each unit of the level.
    pub scale: f32,
    /// Its vertical.
    pub up: UpAxis,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self { scale: 1.0, up: UpAxis::Y }
    }
}

/// A level as named nodes, in its own coordinates; parents come before their children.
pub(super) struct Scene {
    pub(super) nodes: Vec<Node>,
    /// The size that an exported map had.
    pub(super) former_size: Option<MapSize>,
    /// Sets of points and lines that were left out.
    pub(super) skipped_count: usize,
}

/// One node with its mesh.
pub(super) struct Node {
    /// Empty if it has none.
    pub(super) name: String,
    pub(super) parent: Option<usize>,
    pub(super) origin: Vec3,
    /// Corners counter-clockwise seen from outside.
    pub(super) triangles: Vec<[Vec3; 3]>,
    /// What the designer attached to it, as JSON.
    pub(super) extras: Option<Box<RawValue>>,
}

/// Turns the level's coordinates into metres, y up.
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

/// How messages call a node.
pub(super) fn node_label(name: &str, idx: usize) -> String {
    if name.is_empty() { format!("node {idx}") } else { format!("node `{name}`") }
}
