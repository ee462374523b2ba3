//! Maps that a command line names: seeds, ranges of seeds, splits, files, and patterns of names of files.

use anyhow::{Context, anyhow, bail};
use std::ops::Range;
use std::path::{Path, PathBuf};
use surefoot_net::levels::folder::is_level;
use surefoot_world::MapSpec;

/// Seeds of the named splits.
pub const SPLITS: [(&str, Range<u64>); 4] =
    [("training", 0..128), ("validation", 1000..1004), ("test", 2000..2004), ("benchmark", 5000..5064)];
/// Most seeds of a range.
const MAX_RANGE: u64 = 10_000;
/// Similarity (Jaro-Winkler) from which a name may be another one that was mistyped.
const SIMILAR: f64 = 0.85;

/// A map that a command line names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SeedOrFile {
    /// A generated map.
    Seed(u64),
    /// A level or a saved map.
    File(PathBuf),
}

impl SeedOrFile {
    /// The map of a text. A seed is a seed even if a file has that name.
    pub fn parse(text: &str) -> anyhow::Result<Self> {
        match text.parse() {
            Ok(seed) => Ok(Self::Seed(seed)),
            Err(_) if is_file(text) => Ok(Self::File(text.into())),
            Err(_) => Err(unknown(text, "neither a seed nor a file")),
        }
    }
}

/// The maps of lists such as `7,0..4`, `hall.glb,yard.obj` or `levels/*.glb`. Names of files may contain commas. A file
/// counts once, however often it is named.
pub fn parse_maps(lists: &[impl AsRef<str>]) -> anyhow::Result<Vec<SeedOrFile>> {
    let mut maps = Vec::new();
    for list in lists {
        add_list(list.as_ref(), &mut maps)?;
    }
    Ok(maps)
}

/// The same, where the name of a split is a list too.
pub fn parse_maps_or_splits(lists: &[impl AsRef<str>]) -> anyhow::Result<Vec<SeedOrFile>> {
    let mut maps = Vec::new();
    for list in lists {
        let list = list.as_ref();
        match split(list) {
            Some(seeds) => maps.extend(seeds.map(SeedOrFile::Seed)),
            None => add_list(list, &mut maps)
                .context("--maps takes training, validation, test, benchmark, seeds such as 7 or 0..4, or files")?,
        }
    }
    Ok(maps)
}

/// The seeds of a list such as `5`, `5,7` or `0..4,9`.
pub fn parse_seeds(list: &str) -> anyhow::Result<Vec<u64>> {
    let mut seeds = Vec::new();
    for word in list.split(',') {
        seeds.extend(seeds_of(word).with_context(|| format!("`{word}` is not a seed"))??);
    }
    Ok(seeds)
}

/// Specs of the maps of a split, or of a list of seeds.
pub fn parse_specs(text: &str, side: u32) -> anyhow::Result<Vec<MapSpec>> {
    let seeds = split(text).map_or_else(|| parse_seeds(text), |seeds| Ok(seeds.collect()))?;
    seeds.into_iter().map(|seed| spec(seed, side)).collect()
}

/// The spec of a map of that side, m.
pub fn spec(seed: u64, side: u32) -> anyhow::Result<MapSpec> {
    MapSpec::with_side(seed, side).context("--size")
}

/// The seeds of maps that must all be generated ones.
pub fn seeds_only(maps: Vec<SeedOrFile>) -> anyhow::Result<Vec<u64>> {
    let seed = |map| match map {
        SeedOrFile::Seed(seed) => Ok(seed),
        SeedOrFile::File(file) => bail!("`{}` is a file: give only seeds", file.display()),
    };
    maps.into_iter().map(seed).collect()
}

/// The files of maps of which none may be a generated one.
pub fn files_only(maps: Vec<SeedOrFile>) -> anyhow::Result<Vec<PathBuf>> {
    let file = |map| match map {
        SeedOrFile::Seed(seed) => bail!("`{seed}` is a seed: give only files"),
        SeedOrFile::File(file) => Ok(file),
    };
    maps.into_iter().map(file).collect()
}

/// Whether a file has the name of a saved map.
pub(super) fn is_saved(file: &Path) -> bool {
    file.extension().is_some_and(|it| it.eq_ignore_ascii_case("sfmap"))
}

/// Name of a level's file, without folders.
pub fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Name of a file in a report on these maps: without folders, unless files of several folders have that name.
pub fn name_among(file: &Path, maps: &[SeedOrFile]) -> String {
    let has_name = |map: &&SeedOrFile| matches!(map, SeedOrFile::File(it) if it.file_name() == file.file_name());
    if maps.iter().filter(has_name).count() > 1 { file.display().to_string() } else { file_name(file) }
}

fn split(name: &str) -> Option<Range<u64>> {
    SPLITS.into_iter().find(|(split, _)| *split == name).map(|(_, seeds)| seeds)
}

/// The seeds of a word such as `7` or `0..4`; `None` if it is another word.
fn seeds_of(word: &str) -> Option<anyhow::Result<Vec<u64>>> {
    let number = |text: &str| text.trim().parse::<u64>().ok();
    let Some((from, to)) = word.split_once("..") else { return number(word).map(|seed| Ok(vec![seed])) };
    let range = number(from)?..number(to)?;
    let is_allowed = !range.is_empty() && range.end - range.start <= MAX_RANGE;
    Some(if is_allowed {
        Ok(range.collect())
    } else {
        Err(anyhow!("`{word}` is not a range of 1 to {MAX_RANGE} seeds"))
    })
}

fn add_list(list: &str, maps: &mut Vec<SeedOrFile>) -> anyhow::Result<()> {
    let words: Vec<&str> = list.split(',').collect();
    let mut seeds: Vec<_> = words.iter().map(|word| seeds_of(word)).collect();
    let mut first = 0;
    while first < words.len() {
        // Of the words from here on, the longest run that names files. Seeds alone name none.
        let rest = first..words.len();
        let named = rest.clone().find(|&idx| seeds[idx].is_none()).and_then(|other| {
            (other..rest.end).rev().find_map(|last| Some((last, files_of(&words[first..=last].join(","))?)))
        });
        if let Some((last, files)) = named {
            let files: Vec<_> = files.into_iter().map(SeedOrFile::File).filter(|it| !maps.contains(it)).collect();
            maps.extend(files);
            first = last + 1;
        } else if let Some(seeds) = seeds[first].take() {
            maps.extend(seeds?.into_iter().map(SeedOrFile::Seed));
            first += 1;
        } else if is_pattern(words[first]) {
            bail!("no level and no saved map matches `{}`", words[first]);
        } else {
            return Err(unknown(words[first], "neither a seed, a range of seeds (0..8) nor a file"));
        }
    }
    Ok(())
}

/// Whether a text is the path of something that can be read; a pipe can.
fn is_file(text: &str) -> bool {
    std::fs::metadata(text).is_ok_and(|it| !it.is_dir())
}

fn is_pattern(text: &str) -> bool {
    text.contains(['*', '?', '['])
}

/// The file of a text, or the levels and saved maps that match it as a pattern, in the order of their names; `None` if
/// there are none.
fn files_of(text: &str) -> Option<Vec<PathBuf>> {
    if let Some(file) = [text, text.trim()].into_iter().find(|it| is_file(it)) {
        return Some(vec![file.into()]);
    }
    if !is_pattern(text) {
        return None;
    }
    let is_map = |path: &PathBuf| is_level(path) || is_saved(path);
    let found: Vec<PathBuf> = glob::glob(text.trim()).ok()?.filter_map(Result::ok).filter(is_map).collect();
    (!found.is_empty()).then_some(found)
}

/// Says that a text is not what was expected, and what was probably meant.
fn unknown(text: &str, expected: &str) -> anyhow::Error {
    let path = Path::new(text);
    if path.is_dir() {
        anyhow!("`{text}` is a folder: name files in it, such as {}", path.join("level.glb").display())
    } else if let Some(similar) = similar_file(path) {
        anyhow!("`{text}` is {expected}; there is {}", similar.display())
    } else {
        anyhow!("`{text}` is {expected}")
    }
}

/// The file in the folder of a path whose name is the most similar.
fn similar_file(path: &Path) -> Option<PathBuf> {
    let name = path.file_name()?.to_str()?;
    let folder = path.parent().filter(|it| !it.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let names = std::fs::read_dir(folder).ok()?.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let scored = names.map(|it| (strsim::jaro_winkler(name, &it), it)).filter(|(score, _)| *score >= SIMILAR);
    let (_, nearest) = scored.max_by(|one, other| one.0.total_cmp(&other.0).then_with(|| other.1.cmp(&one.1)))?;
    Some(path.with_file_name(nearest))
}
