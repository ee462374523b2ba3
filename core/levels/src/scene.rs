//! A level as read from a file: nodes with triangles, in the level's own coordinates.

use crate::animated::Animation;
use glam::DVec3;
use serde_json::value::RawValue;
use surefoot_world::Vec3;
use surefoot_world::map::{MapSize, UpAxis};

/// How to interpret a level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImportOptions {
    /// Metres per unit of the level, above 0.
    pub scale: f64,
    /// Vertical axis of the level.
    pub up: UpAxis,
    /// Leaves the fronts and backs of all surfaces as they were modelled, instead of turning what looks wrong and
    /// giving thickness to surfaces without.
    pub keep_sides: bool,
    /// Names of nodes have no meaning.
    pub ignore_names: bool,
    /// Imports the nodes of all scenes of a glTF instead of its default scene.
    pub all_scenes: bool,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self { scale: 1.0, up: UpAxis::Y, keep_sides: false, ignore_names: false, all_scenes: false }
    }
}

impl ImportOptions {
    /// Whether coordinates stay as they are.
    pub(super) fn is_unchanged(&self) -> bool {
        self.scale == 1.0 && self.up == UpAxis::Y
    }
}

/// A level as named nodes; parents come before their children.
#[derive(Default)]
pub(super) struct Scene {
    /// The nodes, in double precision: levels may lie far from their origin.
    pub(super) nodes: Vec<Node<DVec3>>,
    /// Size of the map that was exported; `None` for other levels.
    pub(super) former_size: Option<MapSize>,
}

/// One node with its triangles. Its points are `DVec3` in the level's coordinates, or `Vec3` near the map's, in metres.
#[derive(Default)]
pub(super) struct Node<P = Vec3> {
    /// Name of the node; empty if it has none.
    pub(super) name: String,
    /// Index of the node in the file.
    pub(super) file_idx: usize,
    pub(super) parent: Option<usize>,
    pub(super) origin: P,
    /// Triangles with corners counter-clockwise seen from outside.
    pub(super) triangles: Vec<[P; 3]>,
    /// Properties that the designer attached to the node, as JSON.
    pub(super) extras: Option<Box<RawValue>>,
    /// How the node is animated; `None` if it is not.
    pub(super) animation: Option<Animation>,
    /// Number of point and line primitives, which are left out.
    pub(super) skipped_count: usize,
    /// Whether the node's mesh has a skin, as figures have.
    pub(super) is_skinned: bool,
    /// Whether the file says that the node and those below it are not to be seen.
    pub(super) is_hidden: bool,
}

impl<P> Node<P> {
    /// The same node with other points.
    pub(super) fn map<Q>(self, point: impl Fn(P) -> Q) -> Node<Q> {
        Node {
            name: self.name,
            file_idx: self.file_idx,
            parent: self.parent,
            origin: point(self.origin),
            triangles: self.triangles.into_iter().map(|corners| corners.map(&point)).collect(),
            extras: self.extras,
            animation: self.animation,
            skipped_count: self.skipped_count,
            is_skinned: self.is_skinned,
            is_hidden: self.is_hidden,
        }
    }
}

/// Label of a node in messages.
pub(super) fn node_label(name: &str, idx: usize) -> String {
    if name.is_empty() { format!("node {idx}") } else { format!("node `{name}`") }
}
