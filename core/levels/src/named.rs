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
use crate::found::{Found, FoundPool, jetpack_fuel, pad_speed};
use crate::moving::{self, Paths, Sign, Whole};
use crate::scene::{Frame, Node, node_label};
use crate::sidecar::Sidecar;
use std::collections::HashMap;
use surefoot_world::map::{Jetpack, Liquid, MoverKind, Pad, Teleporter, ZipLine};
use surefoot_world::{Aabb, Vec3};

/// Kind of feature that a node's name stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Kind {
    Pool(Liquid),
    Pad,
    Jetpack,
    /// The end and the name of the pair; `None` if the node's name does not say which end it is.
    ZipLine(Option<(End, String)>),
    Teleporter(Option<(End, String)>),
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

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    From,
    To,
}

impl End {
    fn name(self) -> &'static str {
        match self {
            End::From => "from",
            End::To => "to",
        }
    }

    fn other(self) -> Self {
        match self {
            End::From => End::To,
            End::To => End::From,
        }
    }
}

impl Kind {
    fn of(name: &str) -> Option<Self> {
        let name = name.to_lowercase();
        let pair = || split_end(&name);
        Some(match () {
            () if name.starts_with("lava") => Kind::Pool(Liquid::Lava),
            () if name.starts_with("water") => Kind::Pool(Liquid::Water),
            () if name.starts_with("pad") => Kind::Pad,
            () if name.starts_with("jetpack") => Kind::Jetpack,
            () if name.starts_with("zip_line") => Kind::ZipLine(pair()),
            () if name.starts_with("teleporter") => Kind::Teleporter(pair()),
            () if HELPER_STARTS.iter().any(|start| name.starts_with(start)) => Kind::Helper,
            () if HELPER_ENDS.iter().any(|end| name.ends_with(end)) => Kind::Helper,
            () => return None,
        })
    }

    /// Whether the name lacks the end that its feature needs.
    fn lacks_end(&self) -> bool {
        matches!(self, Kind::ZipLine(None) | Kind::Teleporter(None))
    }

    fn has_end(&self) -> bool {
        matches!(self, Kind::ZipLine(Some(_)) | Kind::Teleporter(Some(_)))
    }
}

/// Splits `zip_line_3:from` into its end and `zip_line_3`. A number that a tool appended to a copy (`:from.001`)
/// becomes part of the name of the pair.
fn split_end(name: &str) -> Option<(End, String)> {
    let (stem, copy) = match name.rsplit_once('.') {
        Some((stem, digits)) if !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit()) => {
            (stem, digits)
        }
        _ => (name, ""),
    };
    [End::From, End::To].into_iter().find_map(|end| {
        let stem = stem.strip_suffix(end.name())?.strip_suffix([':', '_', '-', '.', ' '])?;
        Some((end, format!("{stem}.{copy}")))
    })
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
    let (mut zip_lines, mut teleporters) = (Pairs::default(), Pairs::default());
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
            Kind::Pad => {
                let pad = Pad { centre: at, speed: pad_speed(extras.number("height")?, &name)? };
                found.pads.push((name, pad));
            }
            Kind::Jetpack => {
                let jetpack = Jetpack { centre: at, fuel: jetpack_fuel(extras.number("fuel")?, &name)? };
                found.jetpacks.push((name, jetpack));
            }
            Kind::ZipLine(Some((end, pair))) => zip_lines.add(pair, end, Half { node, at, two_way: false })?,
            Kind::Teleporter(Some((end, pair))) => {
                let two_way = extras.flag("two_way")?.unwrap_or_default();
                teleporters.add(pair, end, Half { node, at, two_way })?;
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
            Kind::ZipLine(None) | Kind::Teleporter(None) => {
                return Err(ImportError::NoEnd { node: node.name.clone() });
            }
        }
    }
    let lines = zip_lines.finish()?.into_iter();
    found.zip_lines.extend(lines.map(|(name, from, to)| (name, ZipLine { from: from.at, to: to.at })));
    let teleporters = teleporters.finish()?.into_iter();
    found.teleporters.extend(
        teleporters.map(|(name, from, to)| {
            (name, Teleporter { from: from.at, to: to.at, two_way: from.two_way || to.two_way })
        }),
    );
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

/// Pairs of ends of zip lines or teleporters, in the order in which each pair was first seen.
#[derive(Default)]
struct Pairs<'a> {
    pairs: Vec<[Option<Half<'a>>; 2]>,
    numbers: HashMap<String, usize>,
}

#[derive(Clone, Copy)]
struct Half<'a> {
    node: &'a Node,
    at: Vec3,
    two_way: bool,
}

impl<'a> Pairs<'a> {
    fn add(&mut self, name: String, end: End, half: Half<'a>) -> Result<(), ImportError> {
        let idx = *self.numbers.entry(name).or_insert_with(|| {
            self.pairs.push([None; 2]);
            self.pairs.len() - 1
        });
        match self.pairs[idx][end as usize].replace(half) {
            None => Ok(()),
            Some(_) => Err(ImportError::SecondHalf { node: half.node.name.clone(), end: end.name() }),
        }
    }

    /// All pairs, each with its name for messages.
    fn finish(self) -> Result<Vec<(String, Half<'a>, Half<'a>)>, ImportError> {
        let whole = self.pairs.into_iter().filter_map(|pair| match pair {
            [Some(from), Some(to)] => Some(Ok((format!("node `{}` or `{}`", from.node.name, to.node.name), from, to))),
            [Some(from), None] => Some(Err(missing_half(from.node, End::From))),
            [None, Some(to)] => Some(Err(missing_half(to.node, End::To))),
            [None, None] => None,
        });
        whole.collect()
    }
}

fn missing_half(node: &Node, end: End) -> ImportError {
    // The end is ASCII and comes last, except for the number of a copy.
    let at = node.name.to_ascii_lowercase().rfind(end.name()).unwrap_or(node.name.len());
    let (stem, rest) = node.name.split_at(at);
    let missing = format!("{stem}{}{}", end.other().name(), rest.get(end.name().len()..).unwrap_or_default());
    ImportError::MissingHalf { node: node.name.clone(), missing }
}
