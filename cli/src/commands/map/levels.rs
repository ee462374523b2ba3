//! Levels of a command line: the flags that say how they are read, and the report on what their nodes became.

use super::list::{SeedOrFile, file_name, is_saved};
use crate::terminal::with_spinner;
use anyhow::{Context, bail};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use surefoot_levels::{ImportOptions, Imported, NodeReport, Role, UpAxis, role_counts};
use surefoot_net::levels::folder::{import_file, is_level};
use surefoot_world::Map;

/// Most nodes that are listed on the terminal.
const LISTED_NODES: usize = 20;

/// How levels are read.
#[derive(clap::Args, Clone, Default)]
#[command(next_help_heading = "Levels")]
pub struct LevelArgs {
    /// Metres per unit of the level; default: 1
    #[arg(long, value_name = "METRES")]
    scale: Option<f64>,
    /// Axis that points up in the level; default: y
    #[arg(long, value_name = "AXIS", value_parser = PossibleValuesParser::new(["y", "z"]).map(axis))]
    up: Option<UpAxis>,
    /// Do not turn surfaces whose front seems to be on the wrong side
    #[arg(long)]
    keep_sides: bool,
    /// Give names of nodes no meaning: nodes are solid unless custom properties or the sidecar say otherwise
    #[arg(long)]
    no_names: bool,
    /// Import the nodes of all scenes of a glTF, not only of its default scene
    #[arg(long)]
    all_scenes: bool,
    /// File with a list of features; default: LEVEL.surefoot.json beside the level, if it exists
    #[arg(long, value_name = "FILE")]
    sidecar: Option<PathBuf>,
}

fn axis(name: String) -> UpAxis {
    if name == "z" { UpAxis::Z } else { UpAxis::Y }
}

impl LevelArgs {
    /// Refuses flags that would have no effect on one of these maps.
    pub fn check(&self, maps: &[SeedOrFile]) -> anyhow::Result<()> {
        let Some(flag) = self.given() else { return Ok(()) };
        for map in maps {
            match map {
                SeedOrFile::Seed(seed) => bail!("{flag} is for levels, and {seed} is the seed of a generated map"),
                SeedOrFile::File(file) if is_saved(file) => bail!(
                    "{flag} is for levels, and {} is a saved map: import the level that it was made from again",
                    file.display()
                ),
                SeedOrFile::File(file) if !is_level(file) => {
                    bail!("{flag} is for levels, and {} is not a .glb, .gltf or .obj file", file.display())
                }
                SeedOrFile::File(_) => {}
            }
        }
        if maps.is_empty() {
            bail!("{flag} is for levels: name them with --maps");
        }
        if self.sidecar.is_some() && maps.len() > 1 {
            bail!("--sidecar is for one level, and there are {}: put a sidecar beside each instead", maps.len());
        }
        Ok(())
    }

    /// The first flag that was given.
    fn given(&self) -> Option<&'static str> {
        let flags = [
            (self.sidecar.is_some(), "--sidecar"),
            (self.scale.is_some(), "--scale"),
            (self.up.is_some(), "--up"),
            (self.keep_sides, "--keep-sides"),
            (self.no_names, "--no-names"),
            (self.all_scenes, "--all-scenes"),
        ];
        flags.into_iter().find_map(|(is_given, flag)| is_given.then_some(flag))
    }

    fn options(&self) -> ImportOptions {
        ImportOptions {
            scale: self.scale.unwrap_or(1.0),
            up: self.up.unwrap_or_default(),
            keep_sides: self.keep_sides,
            ignore_names: self.no_names,
            all_scenes: self.all_scenes,
        }
    }

    /// Imports a level, and prints warnings.
    pub fn import(&self, level: &Path) -> anyhow::Result<Imported> {
        let import = || import_file(level, self.sidecar.as_deref(), &self.options());
        let imported = with_spinner("importing the level", import)?;
        for warning in &imported.warnings {
            eprintln!("warning: {}: {warning}", file_name(level));
        }
        Ok(imported)
    }

    /// Imports a level or loads a saved map, and prints warnings; with the nodes of the level.
    pub fn load_with_nodes(&self, file: &Path) -> anyhow::Result<(Map, Vec<NodeReport>)> {
        if is_level(file) {
            let Imported { map, nodes, .. } = self.import(file)?;
            return Ok((map, nodes));
        }
        let hint = if is_saved(file) { "" } else { " (levels are .glb, .gltf or .obj files)" };
        let map =
            surefoot_levels::decode(&read(file)?).with_context(|| format!("cannot use {}{hint}", file.display()))?;
        Ok((map, Vec::new()))
    }

    /// Imports a level or loads a saved map. Prints warnings, and what the nodes became if any is more than solid.
    pub fn load(&self, file: &Path) -> anyhow::Result<Map> {
        let (map, nodes) = self.load_with_nodes(file)?;
        if nodes.iter().any(is_special) {
            eprintln!("{}: {}", file_name(file), summary(&nodes));
        }
        Ok(map)
    }
}

/// Reads a file.
pub(super) fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))
}

/// Writes a file, and returns the line that says so.
pub(super) fn written(path: &Path, bytes: &[u8]) -> anyhow::Result<String> {
    std::fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(format!("wrote {} ({:.1} MB)", path.display(), bytes.len() as f64 / 1.0e6))
}

/// Whether a node became something that a designer may want to check.
fn is_special(node: &NodeReport) -> bool {
    !matches!(node.role, Role::Solid | Role::Empty)
}

/// How many nodes became what, in one line.
pub(super) fn summary(nodes: &[NodeReport]) -> String {
    let count = |(role, count): (Role, usize)| format!("{count} {}", names(role)[usize::from(count != 1)]);
    let counts: Vec<String> = role_counts(nodes).into_iter().map(count).collect();
    let all = if nodes.len() == 1 { "node" } else { "nodes" };
    format!("{} {all}: {}", nodes.len(), counts.join(", "))
}

/// What one node of a role is called, and what several are.
fn names(role: Role) -> [&'static str; 2] {
    match role {
        Role::Solid => ["solid"; 2],
        Role::Water => ["water"; 2],
        Role::Lava => ["lava"; 2],
        Role::Pad => ["pad", "pads"],
        Role::ZipLine => ["end of a zip line", "ends of zip lines"],
        Role::Teleporter => ["end of a teleporter", "ends of teleporters"],
        Role::Jetpack => ["jetpack", "jetpacks"],
        Role::Door => ["door", "doors"],
        Role::Lift => ["lift", "lifts"],
        Role::Platform => ["platform", "platforms"],
        Role::Floor => ["vanishing floor", "vanishing floors"],
        Role::Conveyor => ["conveyor", "conveyors"],
        Role::Crate => ["crate", "crates"],
        Role::Ladder => ["ladder", "ladders"],
        Role::Spot => ["spot for moves", "spots for moves"],
        Role::Climb => ["wall to climb", "walls to climb"],
        Role::Path => ["stop of a mover", "stops of movers"],
        Role::Helper => ["helper", "helpers"],
        Role::LeftOut => ["left out"; 2],
        Role::Empty => ["empty"; 2],
    }
}

/// The nodes that became something special, one a line, for the terminal.
pub(super) fn listing(nodes: &[NodeReport]) -> String {
    let special: Vec<&NodeReport> = nodes.iter().filter(|node| is_special(node)).collect();
    let mut lines = String::new();
    for node in special.iter().take(LISTED_NODES) {
        let name = if node.name.is_empty() { format!("node {}", node.index) } else { node.name.clone() };
        let reason = if node.reason.is_empty() { String::new() } else { format!(": {}", node.reason) };
        lines += &format!("  {:<19} {name}{reason}\n", names(node.role)[0]);
    }
    if special.len() > LISTED_NODES {
        lines += &format!("  ... and {} more (--json lists all)\n", special.len() - LISTED_NODES);
    }
    lines
}

/// The report of an import, for programs.
pub(super) fn report(imported: &Imported) -> Value {
    let (size, frame) = (imported.map.size(), imported.map.frame());
    json!({
        "map": { "hash": imported.map.hash().to_string(), "size": [size.width, size.height, size.depth] },
        "frame": {
            "origin": frame.origin.to_array(),
            "scale": frame.scale,
            "up": if frame.up == UpAxis::Z { "z" } else { "y" },
        },
        "warnings": imported.warnings.iter().map(ToString::to_string).collect::<Vec<_>>(),
        "geometry": imported.geometry,
        "nodes": imported.nodes,
    })
}
