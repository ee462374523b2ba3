//! What the nodes of a level stand for: by the sidecar, by their properties, by their names, and by their animations,
//! in this order.
//!
//! A name has a meaning only if it begins with a whole word, followed by its end, a digit or a separator: `water_01`
//! and `Water2`, but not `Waterfront`. Case does not matter.
//!
//! - `lava` and `water` fill their bounding box.
//! - `pad` and `jetpack` stand at the centre of the bottom of their bounding box.
//! - `zip_line*:from` and `:to`, `teleporter*:from` and `:to` pair up by the name before the end (`_from` works like
//!   `:from`, for tools that do not allow colons).
//! - `ladder` can be climbed as its smallest upright box, `climb` as it is.
//! - `spawn`, `spawnpoint`, `player_start`, `playerstart` and `info_player` are places where play begins.
//! - `anchor` is a place to which bodies pull themselves, `move_TAG` one for moves at such spots; `move_TAG:from` and
//!   `:to` pair up like the ends of zip lines.
//! - What moves is described in `moving`.
//! - Helpers are left out: `navmesh`, `trigger`, `occluder`, what ends in `-navmesh`, `-noimp` or `-occonly` (Godot),
//!   and the simple colliders `UCX_*`, `UBX_*`, `UCP_*` and `USP_*` (Unreal), whose meshes are solid themselves.
//!
//! Features and their children are not solid. The position of a node without a mesh is its origin; with feature nodes
//! below it, it is only a group.

use crate::extras::Extras;
use crate::faults::{ImportError, Warning};
use crate::meaning::{Kind, Meaning};
use crate::moving::{self, Paths, Whole};
use crate::pairs::split_end;
use crate::scene::{Node, node_label};
use crate::sidecar::{NodeAs, Sidecar};
use glam::DVec3;
use std::collections::HashMap;
use surefoot_world::Aabb;
use surefoot_world::map::spot::{ANCHOR, SPAWN, is_tag};
use surefoot_world::map::{DeviceKind, Liquid, MoverKind};

/// Words with which the names of features and helpers begin.
const WORDS: [(&str, Word); 27] = [
    ("lava", Word::Pool(Liquid::Lava)),
    ("water", Word::Pool(Liquid::Water)),
    ("pad", Word::Device(DeviceKind::Pad)),
    ("zip_line", Word::Device(DeviceKind::ZipLine)),
    ("zip line", Word::Device(DeviceKind::ZipLine)),
    ("zipline", Word::Device(DeviceKind::ZipLine)),
    ("teleporter", Word::Device(DeviceKind::Teleporter)),
    ("jetpack", Word::Device(DeviceKind::Jetpack)),
    ("door", Word::Mover(MoverKind::Door)),
    ("lift", Word::Mover(MoverKind::Lift)),
    ("elevator", Word::Mover(MoverKind::Lift)),
    ("platform", Word::Mover(MoverKind::Platform)),
    ("vanish", Word::Mover(MoverKind::Floor)),
    ("pushable", Word::Mover(MoverKind::Crate)),
    ("conveyor", Word::Mover(MoverKind::Conveyor)),
    ("ladder", Word::Ladder),
    ("climb", Word::Climb),
    (ANCHOR, Word::Spot(ANCHOR)),
    ("spawnpoint", Word::Spot(SPAWN)),
    (SPAWN, Word::Spot(SPAWN)),
    ("playerstart", Word::Spot(SPAWN)),
    ("player_start", Word::Spot(SPAWN)),
    ("info_player", Word::Spot(SPAWN)),
    ("move", Word::Tagged),
    ("navmesh", Word::Helper),
    ("trigger", Word::Helper),
    ("occluder", Word::Helper),
];

/// What a word at the beginning of a name stands for.
#[derive(Debug, Clone, Copy)]
enum Word {
    Pool(Liquid),
    Device(DeviceKind),
    Mover(MoverKind),
    Ladder,
    Climb,
    Spot(&'static str),
    /// A spot whose tag follows.
    Tagged,
    Helper,
}

/// Words in the rest of a name that make it speak of something else: a door's frame, a water tower.
const NOT_IT: [(&str, &[&str]); 5] = [
    ("door", &["frame", "way", "step", "arch", "sill", "handle", "wall", "jamb", "mat", "knob", "trim", "lintel"]),
    (
        "water",
        &["tower", "tank", "pipe", "wheel", "mill", "pump", "cooler", "barrel", "bottle", "trough", "fall", "front"],
    ),
    ("lava", &["lamp", "rock", "stone"]),
    ("lift", &["shaft", "frame", "button"]),
    ("elevator", &["shaft", "frame", "button"]),
];

/// Longest side of a device from above, m. What is larger only has its name, as landing pads do.
const MAX_DEVICE_M: f32 = 8.0;
/// Longest side of a spot from above, m. What is larger is scenery, as the anchors of ships are.
const MAX_SPOT_M: f32 = 1.0;
/// How the names of helpers begin and end, in lower case.
const HELPER_STARTS: [&str; 4] = ["ucx_", "ubx_", "ucp_", "usp_"];
const HELPER_ENDS: [&str; 3] = ["-navmesh", "-noimp", "-occonly"];

/// What the beginning of a name says.
enum Beginning {
    /// It is this word.
    Word(&'static str, Word),
    /// It is this word with further letters.
    Near(&'static str),
    Nothing,
}

/// Reads the beginning of a name in lower case.
fn beginning(name: &str) -> Beginning {
    for (word, meaning) in WORDS {
        let Some(rest) = name.strip_prefix(word) else { continue };
        if rest.starts_with(char::is_alphabetic) {
            // `Moved` and `movable` are no misspelt spots.
            return if matches!(meaning, Word::Tagged) { Beginning::Nothing } else { Beginning::Near(word) };
        }
        let parts = rest.split(|letter: char| !letter.is_alphabetic());
        let others = NOT_IT.iter().find(|(it, _)| *it == word).map_or(&[][..], |(_, others)| others);
        let is_other =
            |part: &str| others.contains(&part) || part.strip_suffix('s').is_some_and(|it| others.contains(&it));
        let is_other = parts.into_iter().any(is_other);
        return if is_other { Beginning::Nothing } else { Beginning::Word(word, meaning) };
    }
    Beginning::Nothing
}

/// Whether a name begins with a word, and does not speak of something around it.
pub(super) fn is_called(name: &str, word: &str) -> bool {
    let lower = name.to_lowercase();
    let is_whole = lower.strip_prefix(word).is_some_and(|rest| !rest.starts_with(char::is_alphabetic));
    is_whole && !matches!(beginning(&lower), Beginning::Nothing if word == "door")
}

/// Finds what each node stands for. Incomplete pairs and near misses stay solid, with a warning.
pub(super) fn meanings(
    nodes: &[Node<DVec3>],
    sidecar: &Sidecar,
    ignore_names: bool,
    paths: &Paths,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<Meaning>, ImportError> {
    let whole = with_children(nodes);
    let triangle_count: usize = nodes.iter().map(|node| node.triangles.len()).sum();
    let mut near_misses = Vec::new();
    let mut meanings = Vec::with_capacity(nodes.len());
    for (node, whole) in nodes.iter().zip(&whole) {
        let label = node_label(&node.name, node.file_idx);
        let extras = Extras::new(node, &label)?;
        let declared = declared(node, sidecar, &extras)?;
        meanings.push(match declared {
            Some(meaning) => Meaning { is_declared: true, ..meaning },
            None => {
                let may_move = extras.flag("mover")? != Some(false);
                let named = if ignore_names { None } else { named(node, &extras, paths, &mut near_misses) };
                // What moves has a shape.
                let may_move = may_move && whole.bounds.is_some();
                let is_group = node.triangles.is_empty() && 2 * whole.triangle_count > triangle_count;
                if is_group && named.as_ref().is_some_and(|it| it.kind.is_some()) {
                    warnings.push(Warning::Group { node: node.name.clone() });
                    meanings.push(Meaning { reason: "it holds most of the level".to_owned(), ..Meaning::default() });
                    continue;
                }
                let is_shape = |kind: &Option<Kind>| matches!(kind, Some(Kind::Ladder | Kind::Climb));
                let has_shape = whole.bounds.is_some();
                let named = named.filter(|it| may_move || !matches!(it.kind, Some(Kind::Mover(_))));
                let named = named.filter(|it| has_shape || !is_shape(&it.kind));
                let side = whole.bounds.map_or(0.0, |Aabb { low, high }| (high.x - low.x).max(high.z - low.z));
                if side > MAX_DEVICE_M && matches!(named, Some(Meaning { kind: Some(Kind::Device(..)), .. })) {
                    warnings.push(Warning::LargeDevice { node: node.name.clone(), side });
                    meanings.push(Meaning { reason: "it is too large for a device".to_owned(), ..Meaning::default() });
                    continue;
                }
                if side > MAX_SPOT_M && matches!(named, Some(Meaning { kind: Some(Kind::Spot(..)), .. })) {
                    meanings.push(Meaning { reason: "it is too large for a spot".to_owned(), ..Meaning::default() });
                    continue;
                }
                let animated = || moving::animated_kind(node, paths, whole).filter(|_| may_move);
                let animated = || animated().map(|kind| Meaning::new(Kind::Mover(kind), "its animation moves it"));
                named.or_else(animated).unwrap_or_default()
            }
        });
    }
    if let Some((name, word)) = near_misses.first() {
        let (name, count) = (name.clone(), near_misses.len());
        warnings.push(Warning::NearMiss { name, word, count });
    }
    drop_incomplete_pairs(nodes, &mut meanings, warnings);
    Ok(meanings)
}

/// What the sidecar, the file and the node's properties say; `None` if they say nothing.
fn declared(node: &Node<DVec3>, sidecar: &Sidecar, extras: &Extras<'_>) -> Result<Option<Meaning>, ImportError> {
    if let Some(role) = sidecar.role(&node.name) {
        const SIDECAR: &str = "the sidecar says so";
        return Ok(Some(match role.kind() {
            None if role == NodeAs::Solid => Meaning::solid(SIDECAR),
            None => Meaning::left_out(SIDECAR),
            Some(kind) => Meaning::new(kind, SIDECAR),
        }));
    }
    match sidecar.says_solid(&node.name) {
        Some(true) => return Ok(Some(Meaning::solid("it is one of the sidecar's `colliders`"))),
        Some(false) => return Ok(Some(Meaning::left_out("the sidecar leaves it out"))),
        None => {}
    }
    if let Some(kind) = extras.text("mover") {
        return Ok(Some(Meaning::new(Kind::Mover(moving::kind_named(extras, kind)?), "its property `mover` says so")));
    }
    Ok(match extras.flag("solid")? {
        Some(true) => Some(Meaning::solid("its property `solid` is true")),
        Some(false) => Some(Meaning::left_out("its property `solid` is false")),
        None if node.is_hidden => Some(Meaning::left_out("the file says that it is not visible")),
        None => None,
    })
}

/// What the name of a node says; `None` if it says nothing.
fn named(
    node: &Node<DVec3>,
    extras: &Extras<'_>,
    paths: &Paths,
    near_misses: &mut Vec<(String, &'static str)>,
) -> Option<Meaning> {
    let name = node.name.to_lowercase();
    if moving::path_of(&name).is_some() {
        return Some(Meaning::new(Kind::Path, "its name ends with `path`"));
    }
    if let Some(start) = HELPER_STARTS.iter().find(|start| name.starts_with(*start)) {
        return Some(Meaning::new(Kind::Helper, format!("its name begins with `{}`", start.to_uppercase())));
    }
    // Copies have numbers.
    let stem = name.trim_end_matches(|letter: char| letter.is_ascii_digit() || letter == '.');
    if let Some(end) = HELPER_ENDS.iter().find(|end| stem.ends_with(*end)) {
        return Some(Meaning::new(Kind::Helper, format!("its name ends with `{end}`")));
    }
    let (word, meaning) = match beginning(&name) {
        Beginning::Word(word, meaning) => (word, meaning),
        Beginning::Near(word) => {
            if !node.triangles.is_empty() {
                near_misses.push((node.name.clone(), word));
            }
            return None;
        }
        Beginning::Nothing => return None,
    };
    let kind = match meaning {
        Word::Pool(liquid) => Kind::Pool(liquid),
        Word::Device(kind) => Kind::Device(kind, split_end(&name).filter(|_| kind.is_transport())),
        Word::Mover(kind) => match moving::named_kind(kind, node, extras, paths) {
            Some(kind) => Kind::Mover(kind),
            None => {
                let lacks = if kind == MoverKind::Conveyor { "`velocity`" } else { "path to travel on" };
                return Some(Meaning { reason: format!("it has no {lacks}"), ..Meaning::default() });
            }
        },
        Word::Ladder => Kind::Ladder,
        Word::Climb => Kind::Climb,
        Word::Spot(tag) => Kind::Spot(tag.to_owned(), None),
        Word::Tagged => {
            let end = split_end(&name);
            Kind::Spot(tag_of(&name)?, end)
        }
        Word::Helper => Kind::Helper,
    };
    Some(Meaning::new(kind, format!("its name begins with `{word}`")))
}

/// The tag in the name of a spot, `rope_slide` in `move_rope_slide_2:from`; `None` if there is none.
fn tag_of(name: &str) -> Option<String> {
    let rest = name.strip_prefix("move")?;
    let stem = split_end(name).map_or(rest, |(end, _)| rest.rsplit_once(end.name()).map_or(rest, |(stem, _)| stem));
    let is_end = |letter: char| letter.is_ascii_digit() || !letter.is_alphanumeric();
    let tag = stem.trim_end_matches(is_end).trim_start_matches(|letter: char| !letter.is_alphanumeric());
    let tag = tag.replace(|letter: char| !letter.is_alphanumeric(), "_");
    is_tag(&tag).then_some(tag)
}

/// Leaves ends of zip lines, teleporters and ways solid that have no other end, or whose end is taken already.
fn drop_incomplete_pairs(nodes: &[Node<DVec3>], meanings: &mut [Meaning], warnings: &mut Vec<Warning>) {
    let mut ends: HashMap<String, [Option<usize>; 2]> = HashMap::new();
    for (idx, (node, meaning)) in nodes.iter().zip(&mut *meanings).enumerate() {
        let Some(Kind::Device(_, Some((end, pair))) | Kind::Spot(_, Some((end, pair)))) = &meaning.kind else {
            continue;
        };
        let place = &mut ends.entry(pair.clone()).or_default()[*end as usize];
        if place.is_some() {
            warnings.push(Warning::SecondEnd { node: node.name.clone(), end: end.name() });
            *meaning = Meaning { reason: "its pair has such an end already".to_owned(), ..Meaning::default() };
        } else {
            *place = Some(idx);
        }
    }
    let mut single: Vec<usize> = ends.into_values().filter_map(|pair| pair[0].xor(pair[1])).collect();
    single.sort_unstable();
    for idx in single {
        let name = nodes[idx].name.clone();
        let Some(Kind::Device(_, Some((end, _))) | Kind::Spot(_, Some((end, _)))) = &meanings[idx].kind else {
            continue;
        };
        warnings.push(Warning::NoOtherEnd { missing: end.name_of_other(&name), node: name });
        meanings[idx] = Meaning { reason: "it has no other end".to_owned(), ..Meaning::default() };
    }
}

/// For each node, the index of the feature node that it is or belongs to; `None` for solid nodes. Nodes that do not say
/// which end they are become solid, with a warning, unless they belong to a feature.
pub(super) fn owners(
    nodes: &[Node<DVec3>],
    meanings: &mut [Meaning],
    warnings: &mut Vec<Warning>,
) -> Vec<Option<usize>> {
    let mut has_feature_below = vec![false; nodes.len()];
    for (idx, node) in nodes.iter().enumerate().rev() {
        if let Some(parent) = node.parent {
            let is_feature = matches!(
                meanings[idx].kind,
                Some(Kind::Pool(_) | Kind::Device(..) | Kind::Spot(..) | Kind::Mover(_) | Kind::Ladder | Kind::Climb)
            );
            has_feature_below[parent] |= has_feature_below[idx] || is_feature;
        }
    }
    let mut owners: Vec<Option<usize>> = Vec::with_capacity(nodes.len());
    for (idx, node) in nodes.iter().enumerate() {
        let inherited = node.parent.and_then(|parent| owners[parent]).filter(|_| !meanings[idx].is_declared_solid);
        let is_group = node.triangles.is_empty() && has_feature_below[idx];
        let is_left_out = inherited.is_some_and(|owner| meanings[owner].kind == Some(Kind::LeftOut));
        owners.push(match &meanings[idx].kind {
            None => inherited,
            // What is named below something that is left out is left out with it.
            Some(_) if is_left_out && !meanings[idx].is_declared => inherited,
            Some(kind) if is_group && !kind.has_end() && *kind != Kind::LeftOut => inherited,
            Some(kind) if kind.lacks_end() => {
                if inherited.is_none() {
                    warnings.push(Warning::NoEnd { node: node.name.clone() });
                    meanings[idx] =
                        Meaning { reason: "it does not say which end it is".to_owned(), ..Meaning::default() };
                }
                inherited
            }
            Some(_) => Some(idx),
        });
    }
    owners
}

/// Each node with everything below it.
fn with_children(nodes: &[Node<DVec3>]) -> Vec<Whole> {
    let own = |node: &Node<DVec3>| Whole {
        bounds: Aabb::around(node.triangles.iter().flatten().map(|corner| corner.as_vec3())),
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
