//! Finds the pools and devices of a level by the names of its nodes and in the sidecar.
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

use crate::extras::{Extras, property};
use crate::faults::ImportError;
use crate::moving::{self, MoverEntry, Paths, Sign, Whole};
use crate::pairs::{End, Half, Pairs, split_end};
use crate::scene::{Bounds, Frame, Node, node_label};
use serde::Deserialize;
use surefoot_world::Vec3;
use surefoot_world::map::spec::MAX_HEIGHT_M;
use surefoot_world::map::{Device, DeviceKind, Liquid, MapSize, Mover, MoverKind, Outline, Placed, Pool, features};

/// Constants of pads in `f64`, like the numbers of JSON.
pub(super) const PAD_GRAVITY: f64 = features::PAD_GRAVITY as f64;
pub(super) const PAD_EXTRA_M: f64 = features::PAD_EXTRA_M as f64;
/// Default rise for which a pad is there, m.
const PAD_HEIGHT_M: f64 = 4.0;
/// Height of a node below which its pool counts as flat, m.
const FLAT_M: f32 = 0.01;
/// Distance outside the map that counts as a rounding error, m.
const ROUNDING_M: f32 = 0.01;

/// The features found, in metres before the shift onto the map, each with its name for messages.
#[derive(Default)]
pub(super) struct Found {
    pools: Vec<(String, FoundPool)>,
    devices: Vec<(String, Device)>,
    movers: Vec<Mover>,
    /// Number of helpers, which are left out.
    pub(super) helper_count: usize,
}

struct FoundPool {
    liquid: Liquid,
    bounds: Bounds,
    /// Radius of a round pool, m; `None` for a rectangle.
    radius: Option<f32>,
}

impl Found {
    /// Lowest and highest y of all pools, m; infinite if there are none.
    pub(super) fn pool_heights(&self) -> (f32, f32) {
        let heights = self.pools.iter().map(|(_, pool)| (pool.bounds.low.y, pool.bounds.high.y));
        heights.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), (l, h)| (low.min(l), high.max(h)))
    }

    pub(super) fn flat_pool_count(&self) -> usize {
        self.pools.iter().filter(|(_, pool)| pool.bounds.high.y - pool.bounds.low.y < FLAT_M).count()
    }

    /// Takes the movers, shifted onto the map.
    pub(super) fn take_movers(&mut self, shift: Vec3) -> Vec<Mover> {
        let moved = |mover: Mover| Mover {
            triangles: mover.triangles.iter().map(|corners| corners.map(|corner| corner + shift)).collect(),
            pivot: mover.pivot + shift,
            ..mover
        };
        std::mem::take(&mut self.movers).into_iter().map(moved).collect()
    }

    /// Shifts all features onto the map and clips pools at its rim; `Err` is the name of a feature that lies outside.
    pub(super) fn place(self, shift: Vec3, size: MapSize) -> Result<Placed, String> {
        let extent = size.extent();
        let on_map = |name: &String, point: Vec3| {
            let point = point + shift;
            let slack = Vec3::splat(ROUNDING_M);
            let is_inside = point.cmpge(-slack).all() && point.cmple(extent + slack).all();
            if is_inside { Ok(point) } else { Err(name.clone()) }
        };
        let mut placed = Placed::default();
        for (name, pool) in self.pools {
            placed.pools.push(pool.place(shift, extent).ok_or(name)?);
        }
        for (name, device) in self.devices {
            let to = device.to.map(|to| on_map(&name, to)).transpose()?;
            placed.add(Device { from: on_map(&name, device.from)?, to, ..device });
        }
        Ok(placed)
    }
}

impl FoundPool {
    fn place(&self, shift: Vec3, extent: Vec3) -> Option<Pool> {
        let Bounds { low, high } = self.bounds;
        let (low, high) = (low + shift, high + shift);
        // The bottom may lie below the map, but no pool is deeper than the highest map.
        let depth = (high.y - low.y).min(MAX_HEIGHT_M as f32);
        let (low, high) = match self.radius {
            Some(_) => (low, high),
            None => (
                Vec3::new(low.x.max(0.0), low.y, low.z.max(0.0)),
                Vec3::new(high.x.min(extent.x), high.y, high.z.min(extent.z)),
            ),
        };
        let half = (high - low) * 0.5;
        let middle = (low + high) * 0.5;
        let centre = Vec3::new(middle.x, high.y, middle.z);
        // These comparisons are false for NaN.
        let is_on_map = half.x > 0.0
            && half.z > 0.0
            && centre.cmpge(Vec3::ZERO).all()
            && centre.cmple(extent).all()
            && self.radius.is_none_or(|radius| radius <= extent.x.max(extent.z));
        let outline = match self.radius {
            Some(radius) => Outline::Round { radius },
            None => Outline::Rectangle { half_x: half.x, half_z: half.z },
        };
        is_on_map.then_some(Pool { centre, outline, depth, liquid: self.liquid })
    }
}

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
    let says: Vec<Option<bool>> =
        nodes.iter().enumerate().map(|(idx, node)| says_solid(node, idx, sidecar)).collect::<Result<_, _>>()?;
    let paths = Paths::of(nodes);
    let whole = with_children(nodes);
    let kind = |(idx, (node, says)): (usize, (&Node, &Option<bool>))| {
        let label = node_label(&node.name, idx);
        let moving = moving::sign(node, &Extras::new(node, &label)?, &paths, &whole[idx], frame)?;
        Ok(match (says, Kind::of(&node.name), moving) {
            (Some(false), ..) => Some(Kind::Helper),
            (Some(true), Some(Kind::Helper), _) => None,
            (_, None, Some(Sign::Mover(kind))) => Some(Kind::Mover(kind)),
            (_, None, Some(Sign::Path)) => Some(Kind::Path),
            (_, kind, _) => kind,
        })
    };
    let kinds: Vec<Option<Kind>> = nodes.iter().zip(&says).enumerate().map(kind).collect::<Result<_, ImportError>>()?;
    let owners = feature_owners(nodes, &kinds);
    let mut bounds: Vec<Option<Bounds>> = vec![None; nodes.len()];
    for (node, owner) in nodes.iter().zip(&owners) {
        if let (Some(owner), Some(own)) = (*owner, Bounds::of(node.triangles.iter().flatten().copied())) {
            bounds[owner] = Some(bounds[owner].map_or(own, |bounds| bounds.union(own)));
        }
    }
    let mut pairs = Pairs::default();
    for (idx, (node, kind)) in nodes.iter().zip(kinds).enumerate() {
        let Some(kind) = kind.filter(|_| owners[idx] == Some(idx)) else { continue };
        let bounds = bounds[idx].unwrap_or(Bounds { low: node.origin, high: node.origin });
        let name = node_label(&node.name, idx);
        let extras = Extras::new(node, &name)?;
        match kind {
            Kind::Pool(liquid) => {
                let radius = extras.radius()?;
                found.pools.push((name, FoundPool { liquid, bounds, radius }));
            }
            Kind::Device(kind, Some((end, pair))) => {
                let two_way = kind == DeviceKind::Teleporter && extras.flag("two_way")?.unwrap_or_default();
                pairs.add(pair, end, Half { node, kind, at: bounds.bottom(), two_way })?;
            }
            Kind::Device(kind, None) if kind.is_transport() => {
                return Err(ImportError::NoEnd { node: node.name.clone() });
            }
            Kind::Device(kind, None) => {
                let power = power(kind, |key| extras.number(key), &name)?;
                found.devices.push((name, Device { power, ..Device::new(kind, bounds.bottom()) }));
            }
            Kind::Mover(kind) => {
                let own = nodes.iter().zip(&owners).filter(|(_, owner)| **owner == Some(idx));
                let triangles = own.flat_map(|(node, _)| node.triangles.iter().copied()).collect();
                let mut mover = moving::from_node(kind, node, &extras, frame, &paths, triangles)?;
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

/// Each node with everything below it.
fn with_children(nodes: &[Node]) -> Vec<Whole> {
    let own = |node: &Node| Whole {
        bounds: Bounds::of(node.triangles.iter().flatten().copied()),
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

/// Whether a node's extras or the sidecar say that it is solid or not; `None` if they do not say.
fn says_solid(node: &Node, idx: usize, sidecar: &Sidecar) -> Result<Option<bool>, ImportError> {
    let name = node.name.to_lowercase();
    let is_listed = |patterns: &[String]| patterns.iter().any(|pattern| matches(pattern, &name));
    let extras = Extras::new(node, &node_label(&node.name, idx))?.flag("solid")?;
    Ok(extras.or(match () {
        () if is_listed(&sidecar.leave_out) => Some(false),
        () if is_listed(&sidecar.colliders) => Some(true),
        () => None,
    }))
}

/// Whether a name in lower case matches a pattern, which may begin and end with `*`. Case does not matter.
fn matches(pattern: &str, name: &str) -> bool {
    let pattern = pattern.to_lowercase();
    match (pattern.strip_prefix('*'), pattern.strip_suffix('*')) {
        (Some(_), Some(_)) => name.contains(pattern.trim_matches('*')),
        (Some(end), None) => name.ends_with(end),
        (None, Some(start)) => name.starts_with(start),
        (None, None) => name == pattern,
    }
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

/// What a device gives according to its `height` or `fuel`, which `number` reads.
fn power(
    kind: DeviceKind,
    number: impl Fn(&'static str) -> Result<Option<f64>, ImportError>,
    of: &str,
) -> Result<f32, ImportError> {
    match kind {
        DeviceKind::Pad => pad_speed(number("height")?, of),
        DeviceKind::Jetpack => jetpack_fuel(number("fuel")?, of),
        DeviceKind::ZipLine | DeviceKind::Teleporter => Ok(0.0),
    }
}

/// Upward speed of a pad for a rise of `height` metres, m/s: it throws [`PAD_EXTRA_M`] higher.
fn pad_speed(height: Option<f64>, of: &str) -> Result<f32, ImportError> {
    let height = height.unwrap_or(PAD_HEIGHT_M);
    if !(-PAD_EXTRA_M..=1000.0).contains(&height) {
        return Err(property(of, "height", height, "must be -10 to 1000 m"));
    }
    Ok((2.0 * PAD_GRAVITY * (height + PAD_EXTRA_M)).sqrt() as f32)
}

fn jetpack_fuel(fuel: Option<f64>, of: &str) -> Result<f32, ImportError> {
    let fuel = fuel.unwrap_or(f64::from(features::JETPACK_FUEL_S));
    if (0.0..=600.0).contains(&fuel) { Ok(fuel as f32) } else { Err(property(of, "fuel", fuel, "must be 0 to 600 s")) }
}

/// Content of `level.surefoot.json`: features in the level's own coordinates, and what of the level is solid.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Sidecar {
    /// Patterns of the names of nodes that are no part of the level.
    #[serde(default)]
    leave_out: Vec<String>,
    /// Patterns of the names of the only nodes that are solid; empty: all are.
    #[serde(default)]
    colliders: Vec<String>,
    #[serde(default)]
    pools: Vec<PoolEntry>,
    #[serde(default)]
    pads: Vec<PadEntry>,
    #[serde(default)]
    zip_lines: Vec<ZipLineEntry>,
    #[serde(default)]
    teleporters: Vec<TeleporterEntry>,
    #[serde(default)]
    jetpacks: Vec<JetpackEntry>,
    #[serde(default)]
    movers: Vec<MoverEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PoolEntry {
    #[serde(with = "LiquidName")]
    liquid: Liquid,
    min: [f32; 3],
    max: [f32; 3],
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase", remote = "Liquid")]
enum LiquidName {
    Water,
    Lava,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PadEntry {
    at: [f32; 3],
    height: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ZipLineEntry {
    from: [f32; 3],
    to: [f32; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TeleporterEntry {
    from: [f32; 3],
    to: [f32; 3],
    #[serde(default)]
    two_way: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct JetpackEntry {
    at: [f32; 3],
    fuel: Option<f64>,
}

impl Sidecar {
    pub(super) fn parse(json: &str) -> Result<Self, ImportError> {
        serde_json::from_str(json).map_err(|error| ImportError::Sidecar(error.to_string()))
    }
}

/// Adds the features that the sidecar lists to `found`.
pub(super) fn collect_from_sidecar(sidecar: Sidecar, frame: Frame, found: &mut Found) -> Result<(), ImportError> {
    let label = |kind: &str, idx: usize| format!("{kind}[{idx}] of the sidecar");
    let metres = |name: &str, point: [f32; 3]| {
        let point = frame.to_metres(point.into());
        if point.is_finite() { Ok(point) } else { Err(ImportError::NotFinite { node: name.to_owned() }) }
    };
    for (idx, PoolEntry { liquid, min, max }) in sidecar.pools.into_iter().enumerate() {
        let name = label("pools", idx);
        let (one, other) = (metres(&name, min)?, metres(&name, max)?);
        let bounds = Bounds { low: one.min(other), high: one.max(other) };
        found.pools.push((name, FoundPool { liquid, bounds, radius: None }));
    }
    let pads = sidecar.pads.into_iter().map(|it| (DeviceKind::Pad, it.at, None, false, it.height));
    let lines = sidecar.zip_lines.into_iter().map(|it| (DeviceKind::ZipLine, it.from, Some(it.to), false, None));
    let teleporters = sidecar.teleporters.into_iter();
    let teleporters = teleporters.map(|it| (DeviceKind::Teleporter, it.from, Some(it.to), it.two_way, None));
    let jetpacks = sidecar.jetpacks.into_iter().map(|it| (DeviceKind::Jetpack, it.at, None, false, it.fuel));
    let ways = lines.enumerate().chain(teleporters.enumerate());
    for (idx, (kind, from, to, two_way, number)) in pads.enumerate().chain(ways).chain(jetpacks.enumerate()) {
        let name = label(&kind.plural(), idx);
        let (from, to) = (metres(&name, from)?, to.map(|to| metres(&name, to)).transpose()?);
        let power = power(kind, |_| Ok(number), &name)?;
        found.devices.push((name, Device { to, two_way, power, ..Device::new(kind, from) }));
    }
    for (idx, entry) in sidecar.movers.into_iter().enumerate() {
        let name = label("movers", idx);
        found.movers.push(entry.mover(frame).ok_or(ImportError::NoVolume { of: name })?);
    }
    Ok(())
}
