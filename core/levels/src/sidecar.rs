//! The sidecar of a level: features and movers that its designer lists beside the model.

use crate::faults::ImportError;
use crate::found::{Found, FoundPool, power};
use crate::meaning::Kind;
use crate::moving::MoverEntry;
use serde::Deserialize;
use std::collections::BTreeMap;
use surefoot_world::Aabb;
use surefoot_world::map::spot::{ANCHOR, SPAWN, is_tag};
use surefoot_world::map::{Device, DeviceKind, LevelFrame, Liquid, MoverKind, Spot};

/// Content of `level.surefoot.json`: features in the level's own coordinates, and what of the level is solid.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Sidecar {
    /// What nodes are, by their names or patterns of them, whatever their names say.
    #[serde(default)]
    nodes: BTreeMap<String, NodeAs>,
    /// Whether names of nodes have a meaning.
    names: Option<bool>,
    /// Patterns of the names of nodes that are no part of the level.
    #[serde(default)]
    leave_out: Vec<String>,
    /// Patterns of the names of the only nodes that are solid; empty: all are.
    #[serde(default)]
    pub(super) colliders: Vec<String>,
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
    anchors: Vec<PlaceEntry>,
    #[serde(default)]
    spawns: Vec<PlaceEntry>,
    #[serde(default)]
    moves: Vec<MoveEntry>,
    #[serde(default)]
    movers: Vec<MoverEntry>,
}

/// What a node is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum NodeAs {
    Solid,
    LeaveOut,
    Water,
    Lava,
    Pad,
    Jetpack,
    Door,
    Lift,
    Platform,
    Floor,
    Conveyor,
    Crate,
    Ladder,
    Climb,
    Anchor,
    Spawn,
}

impl NodeAs {
    /// What it stands for; `None` for what is solid or left out.
    pub(super) fn kind(self) -> Option<Kind> {
        Some(match self {
            Self::Solid | Self::LeaveOut => return None,
            Self::Water => Kind::Pool(Liquid::Water),
            Self::Lava => Kind::Pool(Liquid::Lava),
            Self::Pad => Kind::Device(DeviceKind::Pad, None),
            Self::Jetpack => Kind::Device(DeviceKind::Jetpack, None),
            Self::Door => Kind::Mover(MoverKind::Door),
            Self::Lift => Kind::Mover(MoverKind::Lift),
            Self::Platform => Kind::Mover(MoverKind::Platform),
            Self::Floor => Kind::Mover(MoverKind::Floor),
            Self::Conveyor => Kind::Mover(MoverKind::Conveyor),
            Self::Crate => Kind::Mover(MoverKind::Crate),
            Self::Ladder => Kind::Ladder,
            Self::Climb => Kind::Climb,
            Self::Anchor => Kind::Spot(ANCHOR.to_owned(), None),
            Self::Spawn => Kind::Spot(SPAWN.to_owned(), None),
        })
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PoolEntry {
    #[serde(with = "LiquidName")]
    liquid: Liquid,
    min: [f64; 3],
    max: [f64; 3],
}

#[derive(Deserialize)]
#[serde(remote = "Liquid", rename_all = "lowercase")]
enum LiquidName {
    Water,
    Lava,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PadEntry {
    at: [f64; 3],
    height: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ZipLineEntry {
    from: [f64; 3],
    to: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TeleporterEntry {
    from: [f64; 3],
    to: [f64; 3],
    #[serde(default)]
    two_way: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct JetpackEntry {
    at: [f64; 3],
    fuel: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PlaceEntry {
    at: [f64; 3],
}

/// A spot for moves.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MoveEntry {
    tag: String,
    from: [f64; 3],
    to: Option<[f64; 3]>,
    #[serde(default)]
    two_way: bool,
}

impl Sidecar {
    pub(super) fn parse(json: &str) -> Result<Self, ImportError> {
        serde_json::from_str(json.trim_start_matches('\u{feff}'))
            .map_err(|error| ImportError::Sidecar(error.to_string()))
    }

    /// Whether names of nodes have no meaning.
    pub(super) fn ignores_names(&self) -> bool {
        self.names == Some(false)
    }

    /// What a node of this name is; `None` if it does not say. The name itself comes before patterns of it.
    pub(super) fn role(&self, name: &str) -> Option<NodeAs> {
        if self.nodes.is_empty() {
            return None;
        }
        let lower = name.to_lowercase();
        let exact = self.nodes.iter().find(|(pattern, _)| pattern.to_lowercase() == lower);
        let found = exact.or_else(|| self.nodes.iter().find(|(pattern, _)| matches(pattern, &lower)));
        found.map(|(_, role)| *role)
    }

    /// Whether a node of this name is solid; `None` if it does not say.
    pub(super) fn says_solid(&self, name: &str) -> Option<bool> {
        let name = name.to_lowercase();
        let is_listed = |patterns: &[String]| patterns.iter().any(|pattern| matches(pattern, &name));
        match () {
            () if is_listed(&self.leave_out) => Some(false),
            () if is_listed(&self.colliders) => Some(true),
            () => None,
        }
    }

    /// Adds the features that it lists to `found`.
    pub(super) fn collect(self, frame: &LevelFrame, found: &mut Found) -> Result<(), ImportError> {
        let metres = |name: &str, point: [f64; 3]| {
            let point = frame.to_map(point.into());
            if point.is_finite() { Ok(point) } else { Err(ImportError::NotFinite { node: name.to_owned() }) }
        };
        for (name, PoolEntry { liquid, min, max }) in labelled("pools", self.pools) {
            let (one, other) = (metres(&name, min)?, metres(&name, max)?);
            let bounds = Aabb::at(one).union(Aabb::at(other));
            found.pools.push((name, FoundPool { liquid, bounds, radius: None }));
        }
        let pads = labelled("pads", self.pads).map(|(name, it)| (name, DeviceKind::Pad, it.at, None, false, it.height));
        let lines = labelled("zip_lines", self.zip_lines)
            .map(|(name, it)| (name, DeviceKind::ZipLine, it.from, Some(it.to), false, None));
        let teleporters = labelled("teleporters", self.teleporters)
            .map(|(name, it)| (name, DeviceKind::Teleporter, it.from, Some(it.to), it.two_way, None));
        let jetpacks = labelled("jetpacks", self.jetpacks)
            .map(|(name, it)| (name, DeviceKind::Jetpack, it.at, None, false, it.fuel));
        for (name, kind, from, to, two_way, number) in pads.chain(lines).chain(teleporters).chain(jetpacks) {
            let (from, to) = (metres(&name, from)?, to.map(|to| metres(&name, to)).transpose()?);
            let power = power(kind, |_| Ok(number), &name)?;
            found.devices.push((name, Device { to, two_way, power, ..Device::new(kind, from) }));
        }
        let places = |kind, entries, tag: &'static str| {
            labelled(kind, entries).map(move |(name, it): (_, PlaceEntry)| (name, tag.to_owned(), it.at, None, false))
        };
        let anchors = places("anchors", self.anchors, ANCHOR);
        let spawns = places("spawns", self.spawns, SPAWN);
        let moves = labelled("moves", self.moves).map(|(name, it)| (name, it.tag, it.from, it.to, it.two_way));
        for (name, tag, from, to, two_way) in anchors.chain(spawns).chain(moves) {
            if !is_tag(&tag) {
                return Err(ImportError::Tag { of: name, tag });
            }
            let (from, to) = (metres(&name, from)?, to.map(|to| metres(&name, to)).transpose()?);
            found.spots.push((name, Spot { tag, from, to, two_way }));
        }
        for (name, entry) in labelled("movers", self.movers) {
            found.movers.push(entry.mover(frame).ok_or(ImportError::NoVolume { of: name })?);
        }
        Ok(())
    }
}

/// The entries of a list, each with its name for messages.
fn labelled<T>(kind: &str, entries: Vec<T>) -> impl Iterator<Item = (String, T)> {
    (0..).zip(entries).map(move |(idx, entry)| (format!("{kind}[{idx}] of the sidecar"), entry))
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
