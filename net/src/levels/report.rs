//! The report of an import, in the contract's types.

use surefoot_levels::{GeometryCounts, NodeReport, Role};
use surefoot_proto::world::v1 as wire;
use surefoot_world::DVec3;

pub(super) fn point(point: DVec3) -> wire::Vec3d {
    wire::Vec3d { x: point.x, y: point.y, z: point.z }
}

pub(super) fn node(node: NodeReport) -> wire::ImportedNode {
    let [low, high] = node.bounds.map_or([None, None], |bounds| bounds.map(|corner| Some(point(corner))));
    wire::ImportedNode {
        index: node.index as u32,
        name: node.name,
        role: role(node.role).into(),
        reason: node.reason,
        triangles: node.triangles as u32,
        low,
        high,
    }
}

pub(super) fn geometry(counts: &GeometryCounts) -> wire::GeometryCounts {
    wire::GeometryCounts {
        triangles: counts.triangles as u64,
        degenerate: counts.degenerate as u64,
        points_and_lines: counts.points_and_lines as u64,
        open_edges: counts.open_edges as u64,
        crowded_edges: counts.crowded_edges as u64,
        inconsistent_edges: counts.inconsistent_edges as u64,
        turned_shells: counts.turned_shells as u64,
        turned_triangles: counts.turned_triangles as u64,
        plates: counts.plates as u64,
    }
}

fn role(role: Role) -> wire::NodeRole {
    match role {
        Role::Solid => wire::NodeRole::Solid,
        Role::Water => wire::NodeRole::Water,
        Role::Lava => wire::NodeRole::Lava,
        Role::Pad => wire::NodeRole::Pad,
        Role::ZipLine => wire::NodeRole::ZipLine,
        Role::Teleporter => wire::NodeRole::Teleporter,
        Role::Jetpack => wire::NodeRole::Jetpack,
        Role::Door => wire::NodeRole::Door,
        Role::Lift => wire::NodeRole::Lift,
        Role::Platform => wire::NodeRole::Platform,
        Role::Floor => wire::NodeRole::Floor,
        Role::Conveyor => wire::NodeRole::Conveyor,
        Role::Crate => wire::NodeRole::Crate,
        Role::Ladder => wire::NodeRole::Ladder,
        Role::Spot => wire::NodeRole::Spot,
        Role::Climb => wire::NodeRole::Climb,
        Role::Path => wire::NodeRole::Path,
        Role::Helper => wire::NodeRole::Helper,
        Role::LeftOut => wire::NodeRole::LeftOut,
        Role::Empty => wire::NodeRole::Empty,
    }
}
