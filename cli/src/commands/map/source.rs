//! Which map and which body a command works on: the flags, and loading.

use super::levels::LevelArgs;
use super::list::SeedOrFile;
use crate::commands::core_count;
use crate::terminal::progress_bar;
use anyhow::{Context, bail};
use std::path::Path;
use surefoot_generate::Stage;
use surefoot_levels::NodeReport;
use surefoot_net::levels::folder::is_level;
use surefoot_world::character::bodies::{BODIES, NamedBody};
use surefoot_world::map::{Features, LevelFrame, MapKind, MapSize, MoverDensities};
use surefoot_world::{CharacterProfile, Map, MapSpec};

/// Selects a map.
#[derive(clap::Args, Clone)]
pub struct Source {
    /// Seed of a generated map, or a file: a saved map or a level (.glb, .gltf, .obj)
    #[arg(value_name = "SEED|FILE")]
    pub map: String,
    /// Settings of a generated map.
    #[command(flatten)]
    pub generated: Generated,
    /// How a level is read.
    #[command(flatten)]
    pub levels: LevelArgs,
}

/// The body of the characters.
#[derive(clap::Args, Clone)]
pub struct BodyArg {
    /// Body of the characters: surefoot, paper, unreal, godot, unity, heavy, small or climber, or a .toml file with the
    /// fields of a profile; default: surefoot
    #[arg(long, value_name = "NAME|FILE")]
    body: Option<String>,
}

impl BodyArg {
    /// The profile of that body.
    pub fn profile(&self) -> anyhow::Result<CharacterProfile> {
        self.body.as_deref().map_or_else(|| Ok(CharacterProfile::default()), load_body)
    }

    /// The paper's body if the command names none.
    pub fn or_paper(&self) -> Self {
        Self { body: self.body.clone().or_else(|| Some("paper".to_owned())) }
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
    /// Kind of a generated map: terrain (the paper's), islands, interior, arena, tower or open; or one that needs
    /// moves: keep, flooded, vents, rooftops or canyon
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

    /// Generates a map.
    pub(super) fn generate(&self, seed: u64) -> anyhow::Result<Map> {
        let spec = self.apply(&MapSpec::new(seed))?;
        let bar = progress_bar(Stage::ALL.len() as u64 - 1, "map");
        let map = surefoot_generate::generate_with(&spec, core_count(), |stage| {
            bar.set_position(Stage::ALL.iter().position(|&other| other == stage).unwrap_or(0) as u64);
            bar.set_message(stage.name());
        });
        bar.finish_and_clear();
        Ok(map)
    }
}

impl Source {
    /// Generates or loads the map.
    pub fn load(&self) -> anyhow::Result<Map> {
        match self.choice()? {
            SeedOrFile::Seed(seed) => self.generated.generate(seed),
            SeedOrFile::File(file) => self.levels.load(&file),
        }
    }

    /// Generates or loads the map, with the nodes of its level.
    pub(super) fn load_with_nodes(&self) -> anyhow::Result<(Map, Vec<NodeReport>)> {
        match self.choice()? {
            SeedOrFile::Seed(seed) => Ok((self.generated.generate(seed)?, Vec::new())),
            SeedOrFile::File(file) => self.levels.load_with_nodes(&file),
        }
    }

    /// How the coordinates of the level that `map` was made from relate to the map's, if that is known.
    pub fn frame_of(&self, map: &Map) -> Option<LevelFrame> {
        // Maps that earlier versions saved do not have it.
        let is_known = self.is_level() || map.spec().is_some() || !map.frame().is_map();
        is_known.then(|| *map.frame())
    }

    /// This map and another version of it. The flags for levels apply to those of the two that are levels.
    pub fn versions(&self, other: &str) -> anyhow::Result<[Self; 2]> {
        let mut both = [self.map.as_str(), other].map(|map| Self { map: map.to_owned(), ..self.clone() });
        let has_level = both.iter().any(Self::is_level);
        let checked = both.iter().filter(|it| it.is_level() || !has_level);
        self.levels.check(&checked.map(|it| SeedOrFile::File(it.map.clone().into())).collect::<Vec<_>>())?;
        both.iter_mut().filter(|it| !it.is_level()).for_each(|it| it.levels = LevelArgs::default());
        Ok(both)
    }

    /// The map, after a check that each flag has an effect on it.
    fn choice(&self) -> anyhow::Result<SeedOrFile> {
        let choice = SeedOrFile::parse(&self.map)?;
        self.levels.check(std::slice::from_ref(&choice))?;
        Ok(choice)
    }

    fn is_level(&self) -> bool {
        is_level(Path::new(&self.map))
    }
}
