//! A level as read from a file: nodes with triangles, in the level's own coordinates.

use crate::animated::Animation;
use glam::DVec3;
use serde_json::value::RawValue;
use surefoot_world::Vec3;
use surefoot_world::map::MapSize;

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
}

impl<P> Node<P> {
    /// The same node with other points.
    pub(super) fn map<Q>(self, point: impl Fn(P) -> Q) -> Node<Q> {
        Node {
            name: self.name,
            parent: self.parent,
            origin: point(self.origin),
            triangles: self.triangles.into_iter().map(|corners| corners.map(&point)).collect(),
            extras: self.extras,
            animation: self.animation,
            skipped_count: self.skipped_count,
            is_skinned: self.is_skinned,
        }
    }
}

/// Label of a node in messages.
pub(super) fn node_label(name: &str, idx: usize) -> String {
    if name.is_empty() { format!("node {idx}") } else { format!("node `{name}`") }
}
