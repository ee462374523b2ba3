//! Which map and which body a command works on: the flags, and loading.

use crate::commands::core_count;
use crate::terminal::{progress_bar, with_spinner};
use anyhow::{Context, bail};
use std::path::Path;
use surefoot_generate::Stage;
use surefoot_levels::{ImportOptions, Imported, UpAxis};
use surefoot_world::character::bodies::{BODIES, NamedBody};
use surefoot_world::map::{Features, MapKind, MapSize, MoverDensities};
use surefoot_world::{CharacterProfile, Map, MapSpec, Vec3};

/// Selects a map.
#[derive(clap::Args, Clone)]
pub struct Source {
    /// Seed of a generated map, or a file: a saved map or a level (.glb, .gltf, .obj)
    #[arg(value_name = "SEED|FILE")]
    pub map: String,
    /// Settings of a generated map.
    #[command(flatten)]
    pub generated: Generated,
}

/// The body of the characters.
#[derive(clap::Args, Clone)]
pub struct BodyArg {
    /// Body of the characters: surefoot, unreal, godot, unity, heavy, small or climber, or a .toml file with the fields
    /// of a profile
    #[arg(long, default_value = "surefoot", value_name = "NAME|FILE")]
    body: String,
}

impl BodyArg {
    /// The profile of that body.
    pub fn profile(&self) -> anyhow::Result<CharacterProfile> {
        load_body(&self.body)
    }
}

/// The body with a name, or the body in a file.
pub fn load_body(name: &str) -> anyhow::Result<CharacterProfile> {
    if let Some(body) = NamedBody::find(name) {
        return Ok(body.profile());
    }
    let path = Path::new(name);
    if path.extension().is_none_or(|it| it != "toml") {
        let names = BODIES.map(|body| body.name).join(", ");
        bail!("there is no body `{name}`: there are {names}, or a .toml file with the fields of a profile");
    }
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    toml::from_str(&text).with_context(|| format!("{} is not a body", path.display()))
}

/// Settings of generated maps, besides their seeds.
#[derive(clap::Args, Clone)]
pub struct Generated {
    /// Side in metres of a generated map, 50 to 1000
    #[arg(long, default_value_t = 250, value_name = "METRES")]
    pub size: u32,
    /// Height in metres of a generated map, 40 to 200
    #[arg(long, default_value_t = 80, value_name = "METRES")]
    pub height: u32,
    /// Features of a generated map: paper, all or none, followed by changes, such as all,lava=0,zip_lines=2
    #[arg(long, default_value = "paper", value_name = "LIST")]
    pub features: Features,
    /// Kind of a generated map: terrain (the paper's), islands, interior, arena, tower or open
    #[arg(long, default_value = "terrain", value_name = "KIND")]
    pub kind: MapKind,
    /// Movers of a generated map: none or all, followed by changes, such as all,doors=0 or lifts,crates=2
    #[arg(long, default_value = "none", value_name = "LIST")]
    pub movers: MoverDensities,
    /// Do not add pads and zip lines to unreachable ground of a generated map
    #[arg(long)]
    pub no_repair: bool,
}

impl Generated {
    /// Gives a spec this size, kind and features.
    pub fn apply(&self, spec: &MapSpec) -> anyhow::Result<MapSpec> {
        let size = MapSize { width: self.size, height: self.height, depth: self.size };
        let changed = spec.with(|it| {
            (it.size, it.features, it.kind) = (size, self.features, self.kind);
            (it.movers, it.repair) = (self.movers, !self.no_repair);
        });
        Ok(changed?)
    }
}

/// The files of a list of maps, if it names files and not seeds.
pub fn level_files(maps: &str) -> Option<Vec<&Path>> {
    let is_seed = |word: &str| word.parse::<u64>().is_ok();
    let is_range = |word: &str| word.split_once("..").is_some_and(|(first, last)| is_seed(first) && is_seed(last));
    let is_file = |word: &str| Path::new(word).extension().is_some_and(|it| !it.is_empty()) && !is_range(word);
    maps.split(',').any(is_file).then(|| maps.split(',').map(Path::new).collect())
}

/// Name of a level's file, without folders.
pub fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Loads a saved map, or imports a level without scaling it.
pub fn load_level(path: &Path) -> anyhow::Result<Map> {
    Ok(load_with_origin(path)?.0)
}

/// Loads a saved map, or imports a level as it is, with the place where the level's own origin lies on the map, m.
/// Saved maps that were imported do not say it.
fn load_with_origin(path: &Path) -> anyhow::Result<(Map, Option<Vec3>)> {
    let extension = path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase);
    if matches!(extension.as_deref(), Some("glb" | "gltf" | "obj")) {
        let options = ImportOptions { scale: 1.0, up: UpAxis::Y, keep_sides: false };
        let imported = import_level(path, None, &options)?;
        return Ok((imported.map, Some(imported.origin)));
    }
    let map = surefoot_levels::decode(&read(path)?).with_context(|| format!("cannot use {}", path.display()))?;
    let origin = map.spec().map(|_| Vec3::ZERO);
    Ok((map, origin))
}

/// Imports a level with a sidecar file, or the one beside it, and prints warnings.
pub(super) fn import_level(level: &Path, sidecar: Option<&Path>, options: &ImportOptions) -> anyhow::Result<Imported> {
    let bytes = read(level)?;
    let beside = level.with_extension("surefoot.json");
    let sidecar = match sidecar {
        Some(path) => Some(path.to_owned()),
        None => beside.exists().then_some(beside),
    };
    let sidecar = sidecar
        .map(|path| std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display())))
        .transpose()?;
    let extension = level.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase);
    let import = match extension.as_deref() {
        Some("glb" | "gltf") => surefoot_levels::import_gltf,
        Some("obj") => surefoot_levels::import_obj,
        _ => bail!("{} is not a .glb, .gltf or .obj file", level.display()),
    };
    let imported = with_spinner("importing the level", || import(&bytes, sidecar.as_deref(), options))
        .with_context(|| format!("cannot import {}", level.display()))?;
    for warning in &imported.warnings {
        eprintln!("warning: {warning}");
    }
    Ok(imported)
}

impl Source {
    /// Generates or loads the map.
    pub fn load(&self) -> anyhow::Result<Map> {
        Ok(self.load_with_origin()?.0)
    }

    /// Loads the map, with the place where the level's own origin lies on it, m, if that is known.
    pub fn load_with_origin(&self) -> anyhow::Result<(Map, Option<Vec3>)> {
        let Ok(seed) = self.map.parse::<u64>() else {
            return load_with_origin(Path::new(&self.map))
                .with_context(|| format!("`{}` is neither a seed nor a file that can be used", self.map));
        };
        let spec = self.generated.apply(&MapSpec::new(seed))?;
        let bar = progress_bar(Stage::ALL.len() as u64 - 1, "map");
        let map = surefoot_generate::generate_with(&spec, core_count(), |stage| {
            bar.set_position(Stage::ALL.iter().position(|&other| other == stage).unwrap_or(0) as u64);
            bar.set_message(stage.name());
        });
        bar.finish_and_clear();
        Ok((map, Some(Vec3::ZERO)))
    }
}

/// Reads a file.
pub(super) fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))
}
