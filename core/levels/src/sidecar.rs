//! The sidecar of a level: features and movers that its designer lists beside the model.

use crate::faults::ImportError;
use crate::found::{Found, FoundPool, jetpack_fuel, pad_speed};
use crate::moving::MoverEntry;
use crate::scene::Frame;
use serde::Deserialize;
use surefoot_world::Aabb;
use surefoot_world::map::{Jetpack, Liquid, Pad, Teleporter, ZipLine};

/// Content of `level.surefoot.json`: features in the level's own coordinates, and what of the level is solid.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Sidecar {
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
#[serde(remote = "Liquid", rename_all = "lowercase")]
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
    pub(super) fn collect(self, frame: Frame, found: &mut Found) -> Result<(), ImportError> {
        let metres = |name: &str, point: [f32; 3]| {
            let point = frame.to_metres(point.into());
            if point.is_finite() { Ok(point) } else { Err(ImportError::NotFinite { node: name.to_owned() }) }
        };
        for (name, PoolEntry { liquid, min, max }) in labelled("pools", self.pools) {
            let (one, other) = (metres(&name, min)?, metres(&name, max)?);
            let bounds = Aabb::at(one).union(Aabb::at(other));
            found.pools.push((name, FoundPool { liquid, bounds, radius: None }));
        }
        for (name, PadEntry { at, height }) in labelled("pads", self.pads) {
            let pad = Pad { centre: metres(&name, at)?, speed: pad_speed(height, &name)? };
            found.pads.push((name, pad));
        }
        for (name, ZipLineEntry { from, to }) in labelled("zip_lines", self.zip_lines) {
            let line = ZipLine { from: metres(&name, from)?, to: metres(&name, to)? };
            found.zip_lines.push((name, line));
        }
        for (name, TeleporterEntry { from, to, two_way }) in labelled("teleporters", self.teleporters) {
            let teleporter = Teleporter { from: metres(&name, from)?, to: metres(&name, to)?, two_way };
            found.teleporters.push((name, teleporter));
        }
        for (name, JetpackEntry { at, fuel }) in labelled("jetpacks", self.jetpacks) {
            let jetpack = Jetpack { centre: metres(&name, at)?, fuel: jetpack_fuel(fuel, &name)? };
            found.jetpacks.push((name, jetpack));
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
