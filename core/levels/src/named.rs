//! Finds the pools and devices of a level by the names of its nodes.
//!
//! Nodes: `lava*` and `water*` fill their bounding box; `pad*` and `jetpack*` stand at the centre of the bottom of
//! their bounding box; `zip_line*:from` and `:to`, `teleporter*:from` and `:to` pair up by the name before the end
//! (`_from` works like `:from`, for tools that do not allow colons). Case does not matter. Such nodes and their
//! children are not solid.
//!
//! Helpers are left out: `navmesh*`, `trigger*`, `occluder*`, what ends in `-navmesh`, `-noimp` or `-occonly` (Godot),
//! and the simple colliders `UCX_*`, `UBX_*`, `UCP_*` and `USP_*` (Unreal), whose meshes are solid themselves. A node
//! whose extras say `solid: false` is left out as well, and one with `solid: true` is solid whatever its name says. The
//! sidecar lists patterns of names: `leave_out`, and `colliders`, beside which nothing else is solid. What moves is
//! found in `moving`. The position of a node without a mesh is its origin; if there are feature nodes below it, it is
//! only a group.

use crate::extras::Extras;
use crate::faults::ImportError;
use crate::found::{Found, FoundPool, power};
use crate::moving::{self, Paths, Sign, Whole};
use crate::pairs::{End, Half, Pairs, split_end};
use crate::scene::{Frame, Node, node_label};
use crate::sidecar::Sidecar;
use surefoot_world::Aabb;
use surefoot_world::map::{Device, DeviceKind, Liquid, MoverKind};

/// Kind of feature that a node's name stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Kind {
    Pool(Liquid),
    /// A device, with the end and the name of the pair for one end of a transport whose node says which end it is.
    Device(DeviceKind, Option<(End, String)>),
    /// A door, lift, platform, floor or conveyor.
    Mover(MoverKind),
    /// A place on the path of a mover.
    Path,
    /// No part of the level.
    Helper,
}

/// How the names of helpers begin and end, in lower case.
const HELPER_STARTS: [&str; 7] = ["navmesh", "trigger", "occluder", "ucx_", "ubx_", "ucp_", "usp_"];
const HELPER_ENDS: [&str; 3] = ["-navmesh", "-noimp", "-occonly"];

impl Kind {
    fn of(name: &str) -> Option<Self> {
        let name = name.to_lowercase();
        if let Some(kind) = DeviceKind::ALL.iter().find(|kind| name.starts_with(kind.name())) {
            return Some(Kind::Device(*kind, split_end(&name).filter(|_| kind.is_transport())));
        }
        Some(match () {
            () if name.starts_with("lava") => Kind::Pool(Liquid::Lava),
            () if name.starts_with("water") => Kind::Pool(Liquid::Water),
            () if HELPER_STARTS.iter().any(|start| name.starts_with(start)) => Kind::Helper,
            () if HELPER_ENDS.iter().any(|end| name.ends_with(end)) => Kind::Helper,
            () => return None,
        })
    }

    /// Whether the name lacks the end that its feature needs.
    fn lacks_end(&self) -> bool {
        matches!(self, Kind::Device(kind, None) if kind.is_transport())
    }

    fn has_end(&self) -> bool {
        matches!(self, Kind::Device(_, Some(_)))
    }
}

/// Adds the features among `nodes` to `found` and returns for each node whether it is solid.
pub(super) fn collect_from_nodes(
    nodes: &[Node],
    sidecar: &Sidecar,
    frame: Frame,
    found: &mut Found,
) -> Result<Vec<bool>, ImportError> {
    let says = |(idx, node): (usize, &Node)| {
        let extras = Extras::new(node, &node_label(&node.name, idx))?.flag("solid")?;
        Ok(extras.or_else(|| sidecar.says_solid(&node.name)))
    };
    let says: Vec<Option<bool>> = nodes.iter().enumerate().map(says).collect::<Result<_, ImportError>>()?;
    let paths = Paths::of(nodes, frame);
    let kinds = kinds(nodes, &says, &paths)?;
    let owners = feature_owners(nodes, &kinds);
    add_features(nodes, kinds, &owners, &paths, found)?;
    let mut is_solid: Vec<bool> = owners.iter().map(Option::is_none).collect();
    if !sidecar.colliders.is_empty() {
        let mut is_collider: Vec<bool> = Vec::with_capacity(nodes.len());
        for (node, says) in nodes.iter().zip(says) {
            is_collider.push(says == Some(true) || node.parent.is_some_and(|parent| is_collider[parent]));
        }
        for ((is_solid, is_collider), node) in is_solid.iter_mut().zip(is_collider).zip(nodes) {
            found.helper_count += usize::from(*is_solid && !is_collider && !node.triangles.is_empty());
            *is_solid &= is_collider;
        }
    }
    Ok(is_solid)
}

/// What each node stands for; `says` is whether it was declared solid or not.
fn kinds(nodes: &[Node], says: &[Option<bool>], paths: &Paths) -> Result<Vec<Option<Kind>>, ImportError> {
    let whole = with_children(nodes);
    let kind = |(idx, (node, says)): (usize, (&Node, &Option<bool>))| {
        let label = node_label(&node.name, idx);
        let moving = moving::sign(node, &Extras::new(node, &label)?, paths, &whole[idx])?;
        Ok(match (says, Kind::of(&node.name), moving) {
            (Some(false), ..) => Some(Kind::Helper),
            (Some(true), Some(Kind::Helper), _) => None,
            (_, None, Some(Sign::Mover(kind))) => Some(Kind::Mover(kind)),
            (_, None, Some(Sign::Path)) => Some(Kind::Path),
            (_, kind, _) => kind,
        })
    };
    nodes.iter().zip(says).enumerate().map(kind).collect()
}

/// Adds the features that nodes stand for to `found`; `owners` are those of [`feature_owners`].
fn add_features(
    nodes: &[Node],
    kinds: Vec<Option<Kind>>,
    owners: &[Option<usize>],
    paths: &Paths,
    found: &mut Found,
) -> Result<(), ImportError> {
    let bounds = feature_bounds(nodes, owners);
    let mut pairs = Pairs::default();
    for (idx, (node, kind)) in nodes.iter().zip(kinds).enumerate() {
        let Some(kind) = kind.filter(|_| owners[idx] == Some(idx)) else { continue };
        let bounds = bounds[idx].unwrap_or(Aabb::at(node.origin));
        let at = bounds.bottom();
        let name = node_label(&node.name, idx);
        let extras = Extras::new(node, &name)?;
        match kind {
            Kind::Pool(liquid) => {
                let pool = FoundPool { liquid, bounds, radius: extras.radius()? };
                found.pools.push((name, pool));
            }
            Kind::Device(kind, Some((end, pair))) => {
                let two_way = kind == DeviceKind::Teleporter && extras.flag("two_way")?.unwrap_or_default();
                pairs.add(pair, end, Half { node, kind, at, two_way })?;
            }
            Kind::Device(kind, None) if kind.is_transport() => {
                return Err(ImportError::NoEnd { node: node.name.clone() });
            }
            Kind::Device(kind, None) => {
                let power = power(kind, |key| extras.number(key), &name)?;
                found.devices.push((name, Device { power, ..Device::new(kind, at) }));
            }
            Kind::Mover(kind) => {
                let own = nodes.iter().zip(owners).filter(|(_, owner)| **owner == Some(idx));
                let triangles = own.flat_map(|(node, _)| node.triangles.iter().copied()).collect();
                let mut mover = moving::from_node(kind, node, &extras, paths, triangles)?;
                if let Some(mover) = mover.as_mut().filter(|_| node.animation.is_some()) {
                    mover.name = moving::distinct_name(&node.name, idx, &found.movers);
                }
                found.movers.extend(mover);
            }
            Kind::Path => {}
            Kind::Helper => found.helper_count += 1,
        }
    }
    found.devices.extend(pairs.finish()?);
    Ok(())
}

/// The box around each feature node with what belongs to it; `None` if it has no triangles.
fn feature_bounds(nodes: &[Node], owners: &[Option<usize>]) -> Vec<Option<Aabb>> {
    let mut bounds: Vec<Option<Aabb>> = vec![None; nodes.len()];
    for (node, owner) in nodes.iter().zip(owners) {
        if let (Some(owner), Some(own)) = (*owner, Aabb::around(node.triangles.iter().flatten().copied())) {
            bounds[owner] = Some(bounds[owner].map_or(own, |bounds| bounds.union(own)));
        }
    }
    bounds
}

/// Each node with everything below it.
fn with_children(nodes: &[Node]) -> Vec<Whole> {
    let own = |node: &Node| Whole {
        bounds: Aabb::around(node.triangles.iter().flatten().copied()),
        triangle_count: node.triangles.len(),
    };
    let mut whole: Vec<Whole> = nodes.iter().map(own).collect();
    // Parents come before their children.
    for (idx, node) in nodes.iter().enumerate().rev() {
        let Some(parent) = node.parent else { continue };
        let Whole { bounds, triangle_count } = whole[idx];
        let above = &mut whole[parent];
        above.bounds = above.bounds.map_or(bounds, |all| Some(bounds.map_or(all, |bounds| all.union(bounds))));
        above.triangle_count = above.triangle_count.saturating_add(triangle_count);
    }
    whole
}

/// For each node, the index of the feature node that it is or belongs to; `None` for solid nodes.
fn feature_owners(nodes: &[Node], kinds: &[Option<Kind>]) -> Vec<Option<usize>> {
    let mut has_feature_below = vec![false; nodes.len()];
    for (idx, node) in nodes.iter().enumerate().rev() {
        if let Some(parent) = node.parent {
            has_feature_below[parent] |= has_feature_below[idx] || kinds[idx].is_some();
        }
    }
    let mut owners: Vec<Option<usize>> = Vec::with_capacity(nodes.len());
    for (idx, node) in nodes.iter().enumerate() {
        let inherited = node.parent.and_then(|parent| owners[parent]);
        owners.push(match &kinds[idx] {
            None => inherited,
            Some(kind) if node.triangles.is_empty() && has_feature_below[idx] && !kind.has_end() => inherited,
            Some(kind) if kind.lacks_end() && inherited.is_some() => inherited,
            Some(_) => Some(idx),
        });
    }
    owners
}
