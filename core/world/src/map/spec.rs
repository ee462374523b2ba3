//! [`MapSpec`]: what map to generate, checked before anything is allocated.

use crate::Vec3;
use serde::{Deserialize, Serialize};
use std::ops::Deref;
use std::str::FromStr;

/// Smallest side of a map in metres.
pub const MIN_SIDE_M: u32 = 50;
/// Largest side of a map in metres.
pub const MAX_SIDE_M: u32 = 1000;
/// Smallest height of a map in metres.
pub const MIN_HEIGHT_M: u32 = 40;
/// Largest height of a map in metres.
pub const MAX_HEIGHT_M: u32 = 200;
/// Largest feature density; 1 is the usual density.
pub const MAX_DENSITY: f32 = 4.0;

/// All parameters of a generated map: the same spec gives the same bits, on every run and any number of threads.
///
/// Every value is in its range: a spec is made from a [`RawMapSpec`], which is checked.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawMapSpec")]
pub struct MapSpec(RawMapSpec);

/// The values of a [`MapSpec`] before they are checked.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RawMapSpec {
    /// Seed of the noise and of every placement.
    pub seed: u64,
    /// Width (x), height (y) and depth (z) in metres.
    pub size: MapSize,
    /// Density of each feature.
    pub features: Features,
    /// What the ground is like.
    #[serde(default)]
    pub kind: MapKind,
    /// Density of each kind of mover.
    #[serde(default)]
    pub movers: MoverDensities,
    /// Whether ground without an entrance or exit gets a pad or a zip line.
    #[serde(default = "yes")]
    pub repair: bool,
}

fn yes() -> bool {
    true
}

/// What the ground of a generated map is like. Only terrain and open terrain have every feature; the others have
/// devices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum MapKind {
    /// The paper's: rolling and terraced ground with overhangs over a floor of rock.
    #[default]
    Terrain,
    /// Platforms over a void, joined by bridges, beams and stepping stones.
    Islands,
    /// Rooms on several storeys with doorways, stairs and shafts.
    Interior,
    /// Tiles at several levels with ramps, pits, crates and walls.
    Arena,
    /// Towers with ledges that wind up around them.
    Tower,
    /// Terrain whose borders and holes drop into nothing.
    Open,
    /// Towers in moats, whose storeys are joined by ladders through hatches.
    Keep,
    /// Caves whose passages lie under water.
    Flooded,
    /// Rooms joined by vents that are lower than a person.
    Vents,
    /// Roofs with gaps that are too wide to jump, and walls along them.
    Rooftops,
    /// Rocks that are too far from one another to jump, with anchors between them.
    Canyon,
}

impl MapKind {
    /// The kinds that the default body gets about on.
    pub const USUAL: [MapKind; 6] =
        [MapKind::Terrain, MapKind::Islands, MapKind::Interior, MapKind::Arena, MapKind::Tower, MapKind::Open];
    /// The kinds that need moves: those of the body `acrobat`.
    pub const COURSES: [MapKind; 5] =
        [MapKind::Keep, MapKind::Flooded, MapKind::Vents, MapKind::Rooftops, MapKind::Canyon];

    /// All kinds.
    pub fn all() -> impl Iterator<Item = MapKind> {
        Self::USUAL.into_iter().chain(Self::COURSES)
    }

    /// Lower-case name, as in commands and files.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

impl FromStr for MapKind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = || Self::all().map(Self::name).collect::<Vec<_>>().join(", ");
        Self::all().find(|kind| kind.name() == text).ok_or_else(|| format!("no kind `{text}`; there are {}", names()))
    }
}

/// Extent of a map in metres; the map spans `0..width`, `0..height`, `0..depth`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct MapSize {
    /// Along x, `MIN_SIDE_M..=MAX_SIDE_M`.
    pub width: u32,
    /// Along y, `MIN_HEIGHT_M..=MAX_HEIGHT_M`.
    pub height: u32,
    /// Along z, `MIN_SIDE_M..=MAX_SIDE_M`.
    pub depth: u32,
}

/// Declares densities: each with its default.
macro_rules! densities {
    ($(#[$doc:meta])* $name:ident in $path:literal { $($(#[$field_doc:meta])* $field:ident: $default:literal,)+ }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
        pub struct $name {
            $($(#[$field_doc])* pub $field: f32,)+
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $default,)+ }
            }
        }

        impl $name {
            /// All at their usual density.
            pub fn all() -> Self {
                Self { $($field: 1.0,)+ }
            }

            /// None of them.
            pub fn none() -> Self {
                Self { $($field: 0.0,)+ }
            }

            /// Each density with the path of its field inside the spec.
            pub fn named(&self) -> [(&'static str, f32); [$($default),+].len()] {
                { *self }.named_mut().map(|(name, density)| (name, *density))
            }

            fn named_mut(&mut self) -> [(&'static str, &mut f32); [$($default),+].len()] {
                [$((concat!($path, ".", stringify!($field)), &mut self.$field),)+]
            }
        }
    };
}

densities! {
    /// Density of each feature: 0 places none, 1 is the usual amount, at most [`MAX_DENSITY`]. The default is the
    /// paper's set: no ravines, caves, teleporters or jetpacks.
    Features in "features" {
        /// Flat-topped columns of rock.
        plateaus: 1.0,
        /// Houses with storeys and solid blocks.
        buildings: 1.0,
        /// Water pools (drown after five seconds).
        water: 1.0,
        /// Lava pools (burn at once).
        lava: 1.0,
        /// Jump pads; 0 also keeps the generator from adding pads to ground without an entrance or exit.
        pads: 1.0,
        /// Zip lines.
        zip_lines: 1.0,
        /// Winding cuts in the ground.
        ravines: 0.0,
        /// Tunnels through rock.
        caves: 0.0,
        /// Teleporters, one- and two-way.
        teleporters: 0.0,
        /// Jetpack pick-ups.
        jetpacks: 0.0,
    }
}

densities! {
    /// Density of each kind of mover: 0 places none (the default), 1 is the usual amount, at most [`MAX_DENSITY`]. Maps
    /// have fewer where there is no room: a lift needs a cliff, a platform a gap.
    MoverDensities in "movers" {
        /// Doors that open and shut by turns, in gaps between walls.
        doors: 0.0,
        /// Lifts at cliffs and walls.
        lifts: 0.0,
        /// Platforms that go to and fro over gaps.
        platforms: 0.0,
        /// Floors over gaps that are there and away by turns.
        floors: 0.0,
        /// Conveyors on level ground.
        conveyors: 0.0,
        /// Crates on level ground.
        crates: 0.0,
    }
}

impl FromStr for Features {
    type Err = String;

    /// Parses an optional `paper` (the default), `all` or `none`, then changes: `all,lava=0,zip_lines=2`; a bare name
    /// means density 1.
    fn from_str(text: &str) -> Result<Self, String> {
        let presets = [("paper", Self::default()), ("all", Self::all()), ("none", Self::none())];
        parse(text, "feature", &presets, Self::named_mut)
    }
}

impl FromStr for MoverDensities {
    type Err = String;

    /// Parses an optional `none` (the default) or `all`, then changes: `all,doors=0,lifts=2`; a bare name means density
    /// 1.
    fn from_str(text: &str) -> Result<Self, String> {
        parse(text, "kind of mover", &[("all", Self::all()), ("none", Self::none())], Self::named_mut)
    }
}

/// Parses an optional preset, then changes.
fn parse<T: Copy + Default, const N: usize>(
    text: &str,
    what: &str,
    presets: &[(&str, T)],
    named: fn(&mut T) -> [(&'static str, &mut f32); N],
) -> Result<T, String> {
    let mut densities = T::default();
    for (position, word) in text.split(',').map(str::trim).enumerate() {
        match presets.iter().find(|(name, _)| *name == word) {
            Some(_) if position > 0 => return Err(format!("`{word}` can only come first")),
            Some((_, preset)) => densities = *preset,
            None => set_density(what, &mut named(&mut densities), word)?,
        }
    }
    Ok(densities)
}

/// Sets the density that `word` names, such as `lava=2`; a bare name means density 1.
fn set_density(what: &str, densities: &mut [(&'static str, &mut f32)], word: &str) -> Result<(), String> {
    let bare = |field: &'static str| field.split_once('.').map_or(field, |(_, bare)| bare);
    let (name, density) = word.split_once('=').unwrap_or((word, "1"));
    let density: f32 = density.parse().map_err(|_| format!("`{density}` is not a density"))?;
    if !(0.0..=MAX_DENSITY).contains(&density) {
        return Err(format!("{name} is {density}, but must be 0 to {MAX_DENSITY}"));
    }
    match densities.iter_mut().find(|(field, _)| bare(field) == name) {
        Some((_, slot)) => **slot = density,
        None => {
            let names: Vec<&str> = densities.iter().map(|(field, _)| bare(field)).collect();
            return Err(format!("no {what} `{name}`; there are {}", names.join(", ")));
        }
    }
    Ok(())
}

impl MapSize {
    /// The extent as a vector, m.
    pub fn extent(self) -> Vec3 {
        Vec3::new(self.width as f32, self.height as f32, self.depth as f32)
    }
}

impl MapSpec {
    /// The default map of 250 x 80 x 250 m with the paper's set of features.
    pub fn new(seed: u64) -> Self {
        Self(RawMapSpec::new(seed))
    }

    /// A square default map with sides of `side` metres and a height of 80 m.
    ///
    /// # Errors
    /// If `side` is out of range.
    pub fn with_side(seed: u64, side: u32) -> Result<Self, SpecError> {
        Self::new(seed).with(|spec| spec.size = MapSize { width: side, height: 80, depth: side })
    }

    /// Returns a copy of this spec with a change.
    ///
    /// # Errors
    /// Names the first field outside its range.
    pub fn with(&self, change: impl FnOnce(&mut RawMapSpec)) -> Result<Self, SpecError> {
        let mut raw = self.0;
        change(&mut raw);
        raw.try_into()
    }
}

impl Deref for MapSpec {
    type Target = RawMapSpec;

    fn deref(&self) -> &RawMapSpec {
        &self.0
    }
}

impl TryFrom<RawMapSpec> for MapSpec {
    type Error = SpecError;

    fn try_from(raw: RawMapSpec) -> Result<Self, SpecError> {
        raw.check().map(|()| Self(raw))
    }
}

impl RawMapSpec {
    /// The default map: 250 x 80 x 250 m with the paper's set of features.
    pub fn new(seed: u64) -> Self {
        let size = MapSize { width: 250, height: 80, depth: 250 };
        Self {
            seed,
            size,
            features: Features::default(),
            kind: MapKind::default(),
            movers: MoverDensities::default(),
            repair: true,
        }
    }

    fn check(&self) -> Result<(), SpecError> {
        let sides = [
            ("size.width", self.size.width, MIN_SIDE_M, MAX_SIDE_M),
            ("size.height", self.size.height, MIN_HEIGHT_M, MAX_HEIGHT_M),
            ("size.depth", self.size.depth, MIN_SIDE_M, MAX_SIDE_M),
        ];
        for (field, value, min, max) in sides {
            if !(min..=max).contains(&value) {
                return Err(SpecError { field, value: f64::from(value), min: f64::from(min), max: f64::from(max) });
            }
        }
        for (field, value) in self.features.named().into_iter().chain(self.movers.named()) {
            if !(0.0..=MAX_DENSITY).contains(&value) {
                return Err(SpecError { field, value: f64::from(value), min: 0.0, max: f64::from(MAX_DENSITY) });
            }
        }
        Ok(())
    }
}

/// A field of a [`RawMapSpec`] is outside its range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{field} is {value}, but must be {min} to {max}")]
pub struct SpecError {
    /// Path of the field inside the spec.
    pub field: &'static str,
    /// The rejected value.
    pub value: f64,
    /// Smallest allowed value.
    pub min: f64,
    /// Largest allowed value.
    pub max: f64,
}
