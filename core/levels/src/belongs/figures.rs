//! What the names of nodes say about skies, figures, and what is held before a camera.
//!
//! A name alone decides nothing: figures also have a skin or a figure's shape, and all of them are small.

use crate::belongs::bounds::{Bounds, without_each};
use crate::scene::Node;
use glam::DVec3;

/// Words of skies, and words beside them that leave a name one of a sky.
const SKY: [&str; 4] = ["sky", "skybox", "skydome", "skysphere"];
const SKY_SHAPES: [&str; 12] =
    ["box", "dome", "sphere", "ball", "cube", "mesh", "model", "cloud", "clouds", "day", "night", "hemisphere"];
/// Words of backdrops.
const BACKDROP: [&str; 8] = ["cloud", "clouds", "backdrop", "background", "horizon", "stars", "sun", "moon"];
/// Words of figures, and words beside them that leave a name one of a figure.
const FIGURE: [&str; 5] = ["player", "character", "hero", "avatar", "mannequin"];
const FIGURE_SHAPES: [&str; 5] = ["body", "mesh", "model", "capsule", "skin"];
/// Words of a first person's camera, and of what is held before it.
const CAMERA: [&str; 4] = ["camera", "cam", "fps", "viewmodel"];
const HELD: [&str; 7] = ["arms", "hands", "weapon", "gun", "rifle", "pistol", "sword"];
/// Largest share of the level's size that figures have, and least height of those without a skin over their width.
const SMALL: f64 = 0.25;
const UPRIGHT: f64 = 1.5;

/// What the name of a node, or of a node above it, says about skies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum SkyName {
    Other,
    /// It has a word of a sky or backdrop.
    Backdrop,
    /// It is the name of a sky.
    Sky,
}

/// What the names of all nodes say about skies.
pub(super) fn sky_names(nodes: &[Node<DVec3>]) -> Vec<SkyName> {
    let mut names: Vec<SkyName> = Vec::with_capacity(nodes.len());
    // Parents come before their children.
    for node in nodes {
        let words = words(&node.name);
        let own = match () {
            () if is_plain(&words, &SKY, &SKY_SHAPES) => SkyName::Sky,
            // `Sky_Lounge` and `Cloud_City` are names of places.
            () if is_plain(&words, &BACKDROP, &SKY_SHAPES) => SkyName::Backdrop,
            () => SkyName::Other,
        };
        let above = node.parent.map_or(SkyName::Other, |parent| names[parent]);
        names.push(own.max(above));
    }
    names
}

/// What a node looks like that moves with the player.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Look {
    /// A figure, or something that belongs to one.
    Figure,
    /// Something that is held before a camera.
    Held,
}

/// Finds figures, and what is held before a camera, among the nodes that `is_judged` names.
pub(super) fn find(nodes: &[Node<DVec3>], is_judged: &[bool]) -> Vec<Option<Look>> {
    let bounds = |(node, is_judged): (&Node<DVec3>, &bool)| {
        Bounds::around(node.triangles.iter().flatten().copied().filter(|_| *is_judged))
    };
    let bounds: Vec<Bounds> = nodes.iter().zip(is_judged).map(bounds).collect();
    let others = without_each(&bounds);
    let is_small: Vec<bool> =
        bounds.iter().zip(others).map(|(own, others)| own.size() <= SMALL * others.size()).collect();
    let mut reasons: Vec<Option<Look>> = vec![None; nodes.len()];
    // The nodes that are named as figures and have a skin somewhere below.
    let mut is_rig = vec![false; nodes.len()];
    let mut lines: Vec<Line> = Vec::with_capacity(nodes.len());
    for (idx, node) in nodes.iter().enumerate() {
        let own = words(&node.name);
        let above = node.parent.map_or(Line::default(), |parent| lines[parent]);
        let line = Line {
            camera: above.camera || has(&own, &CAMERA),
            held: above.held || has(&own, &HELD),
            figure: if has(&own, &FIGURE) { Some(idx) } else { above.figure },
        };
        lines.push(line);
        if !is_judged[idx] || !is_small[idx] {
            continue;
        }
        if line.camera && (node.is_skinned || line.held) {
            reasons[idx] = Some(Look::Held);
        } else if let Some(figure) = line.figure.filter(|_| node.is_skinned) {
            reasons[idx] = Some(Look::Figure);
            is_rig[figure] = true;
        } else if is_plain(&own, &FIGURE, &FIGURE_SHAPES) && is_upright(bounds[idx]) {
            reasons[idx] = Some(Look::Figure);
        }
    }
    for idx in 0..nodes.len() {
        is_rig[idx] |= nodes[idx].parent.is_some_and(|parent| is_rig[parent]);
        if is_rig[idx] && is_judged[idx] && is_small[idx] {
            reasons[idx] = reasons[idx].or(Some(Look::Figure));
        }
    }
    reasons
}

/// What the names of a node and of those above it say.
#[derive(Clone, Copy, Default)]
struct Line {
    camera: bool,
    held: bool,
    /// The nearest node that is named as a figure.
    figure: Option<usize>,
}

fn is_upright(bounds: Bounds) -> bool {
    bounds.high.y - bounds.low.y >= UPRIGHT * bounds.side()
}

fn has(words: &[String], any: &[&str]) -> bool {
    words.iter().any(|word| any.contains(&word.as_str()))
}

/// Whether the words of a name include one of `any`, and all others are of `beside`.
fn is_plain(words: &[String], any: &[&str], beside: &[&str]) -> bool {
    let is_known = |word: &String| any.contains(&word.as_str()) || beside.contains(&word.as_str());
    has(words, any) && words.iter().all(is_known)
}

/// The words of a name in lower case, without numbers: `SkySphere_01` is sky and sphere.
fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut was_lower = false;
    for letter in name.chars() {
        if !letter.is_alphabetic() || letter.is_uppercase() && was_lower {
            words.push(String::new());
        }
        was_lower = letter.is_lowercase();
        if let (true, Some(word)) = (letter.is_alphabetic(), words.last_mut()) {
            word.extend(letter.to_lowercase());
        }
    }
    words.retain(|word| !word.is_empty());
    words
}
