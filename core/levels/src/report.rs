//! What an import made of each node of a level, for people and programs.

use glam::DVec3;
use serde::Serialize;
use strum::{Display, EnumString, VariantArray};

/// What a node became.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Display, EnumString, VariantArray)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Role {
    /// Ground, walls and everything else that holds bodies.
    Solid,
    /// A pool of water.
    Water,
    /// A pool of lava.
    Lava,
    /// A jump pad.
    Pad,
    /// An end of a zip line.
    ZipLine,
    /// An end of a teleporter.
    Teleporter,
    /// A jetpack.
    Jetpack,
    /// A place for moves that bodies define.
    Spot,
    /// A door.
    Door,
    /// A lift.
    Lift,
    /// A platform that travels.
    Platform,
    /// A floor that disappears.
    Floor,
    /// A conveyor.
    Conveyor,
    /// A crate that can be pushed.
    Crate,
    /// A ladder, as its box.
    Ladder,
    /// A wall or a net that can be climbed.
    Climb,
    /// A stop on the path of a mover.
    Path,
    /// Something for a tool or an engine, such as a navigation mesh; it is left out.
    Helper,
    /// No part of the level.
    LeftOut,
    /// A node without triangles that stands for nothing.
    Empty,
}

/// What became of a node, and why.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NodeReport {
    /// Index of the node: of a glTF's array of nodes, or the place of an OBJ's object.
    pub index: usize,
    /// Name of the node; empty if it has none.
    pub name: String,
    /// What it became.
    pub role: Role,
    /// Why, as a phrase such as ``its name begins with `water` ``; empty for what is solid as usual.
    pub reason: String,
    /// Number of its own triangles.
    pub triangles: usize,
    /// Lowest and highest corner of its own triangles, in the level's own coordinates; `None` without triangles.
    pub bounds: Option<[DVec3; 2]>,
}

/// Counts that describe a level's geometry. None of them needs a change by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct GeometryCounts {
    /// Solid triangles as modelled.
    pub triangles: usize,
    /// Triangles without area, which were left out.
    pub degenerate: usize,
    /// Sets of points or lines, which were left out.
    pub points_and_lines: usize,
    /// Edges of one triangle only.
    pub open_edges: usize,
    /// Edges of three or more triangles.
    pub crowded_edges: usize,
    /// Edges of two triangles that face opposite ways.
    pub inconsistent_edges: usize,
    /// Closed shells that were inside out and were turned.
    pub turned_shells: usize,
    /// Triangles that faced another way than their neighbours and were turned.
    pub turned_triangles: usize,
    /// Triangles of surfaces without thickness, which became plates.
    pub plates: usize,
}

/// The roles of nodes and how many nodes have each, without roles that no node has.
pub fn role_counts(nodes: &[NodeReport]) -> Vec<(Role, usize)> {
    let count = |role: Role| nodes.iter().filter(|node| node.role == role).count();
    Role::VARIANTS.iter().map(|&role| (role, count(role))).filter(|(_, count)| *count > 0).collect()
}
