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
use crate::scene::{Bounds, Frame, Node, node_label};
use serde::Deserialize;
use std::collections::HashMap;
use surefoot_world::Vec3;
use surefoot_world::map::spec::MAX_HEIGHT_M;
use surefoot_world::map::{
    Jetpack, Liquid, MapSize, Mover, MoverKind, Outline, Pad, Placed, Pool, Teleporter, ZipLine, features,
};

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
    pads: Vec<(String, Pad)>,
    zip_lines: Vec<(String, ZipLine)>,
    teleporters: Vec<(String, Teleporter)>,
    jetpacks: Vec<(String, Jetpack)>,
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
        for (name, pad) in self.pads {
            placed.pads.push(Pad { centre: on_map(&name, pad.centre)?, ..pad });
        }
        for (name, line) in self.zip_lines {
            placed.zip_lines.push(ZipLine { from: on_map(&name, line.from)?, to: on_map(&name, line.to)? });
        }
        for (name, teleporter) in self.teleporters {
            let (from, to) = (on_map(&name, teleporter.from)?, on_map(&name, teleporter.to)?);
            placed.teleporters.push(Teleporter { from, to, ..teleporter });
        }
        for (name, jetpack) in self.jetpacks {
            placed.jetpacks.push(Jetpack { centre: on_map(&name, jetpack.centre)?, ..jetpack });
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
    let says: Vec<Option<bool>> =
        nodes.iter().enumerate().map(|(idx, node)| says_solid(node, idx, sidecar)).collect::<Result<_, _>>()?;
    let paths = Paths::of(nodes, frame);
    let whole = with_children(nodes);
    let kind = |(idx, (node, says)): (usize, (&Node, &Option<bool>))| {
        let label = node_label(&node.name, idx);
        let moving = moving::sign(node, &Extras::new(node, &label)?, &paths, &whole[idx])?;
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
    let (mut zip_lines, mut teleporters) = (Pairs::default(), Pairs::default());
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
            Kind::Pad => {
                let speed = pad_speed(extras.number("height")?, &name)?;
                found.pads.push((name, Pad { centre: bounds.bottom(), speed }));
            }
            Kind::Jetpack => {
                let fuel = jetpack_fuel(extras.number("fuel")?, &name)?;
                found.jetpacks.push((name, Jetpack { centre: bounds.bottom(), fuel }));
            }
            Kind::ZipLine(Some((end, pair))) => {
                zip_lines.add(pair, end, Half { node, at: bounds.bottom(), two_way: false })?;
            }
            Kind::Teleporter(Some((end, pair))) => {
                let two_way = extras.flag("two_way")?.unwrap_or_default();
                teleporters.add(pair, end, Half { node, at: bounds.bottom(), two_way })?;
            }
            Kind::Mover(kind) => {
                let own = nodes.iter().zip(&owners).filter(|(_, owner)| **owner == Some(idx));
                let triangles = own.flat_map(|(node, _)| node.triangles.iter().copied()).collect();
                let mut mover = moving::from_node(kind, node, &extras, &paths, triangles)?;
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
    for (name, from, to) in zip_lines.finish()? {
        found.zip_lines.push((name, ZipLine { from: from.at, to: to.at }));
    }
    for (name, from, to) in teleporters.finish()? {
        let two_way = from.two_way || to.two_way;
        found.teleporters.push((name, Teleporter { from: from.at, to: to.at, two_way }));
    }
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
    liquid: LiquidName,
    min: [f32; 3],
    max: [f32; 3],
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
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
        let liquid = match liquid {
            LiquidName::Water => Liquid::Water,
            LiquidName::Lava => Liquid::Lava,
        };
        found.pools.push((name, FoundPool { liquid, bounds, radius: None }));
    }
    for (idx, PadEntry { at, height }) in sidecar.pads.into_iter().enumerate() {
        let name = label("pads", idx);
        let pad = Pad { centre: metres(&name, at)?, speed: pad_speed(height, &name)? };
        found.pads.push((name, pad));
    }
    for (idx, ZipLineEntry { from, to }) in sidecar.zip_lines.into_iter().enumerate() {
        let name = label("zip_lines", idx);
        let line = ZipLine { from: metres(&name, from)?, to: metres(&name, to)? };
        found.zip_lines.push((name, line));
    }
    for (idx, TeleporterEntry { from, to, two_way }) in sidecar.teleporters.into_iter().enumerate() {
        let name = label("teleporters", idx);
        let teleporter = Teleporter { from: metres(&name, from)?, to: metres(&name, to)?, two_way };
        found.teleporters.push((name, teleporter));
    }
    for (idx, JetpackEntry { at, fuel }) in sidecar.jetpacks.into_iter().enumerate() {
        let name = label("jetpacks", idx);
        let jetpack = Jetpack { centre: metres(&name, at)?, fuel: jetpack_fuel(fuel, &name)? };
        found.jetpacks.push((name, jetpack));
    }
    for (idx, entry) in sidecar.movers.into_iter().enumerate() {
        let name = label("movers", idx);
        found.movers.push(entry.mover(frame).ok_or(ImportError::NoVolume { of: name })?);
    }
    Ok(())
}
