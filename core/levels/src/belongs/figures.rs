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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SkyName {
    /// It is the name of a sky.
    Sky,
    /// It has a word of a sky or backdrop.
    Backdrop,
    Other,
}

pub(super) fn sky_name(nodes: &[Node<DVec3>], node: usize) -> SkyName {
    let mut found = SkyName::Other;
    for node in line(nodes, node) {
        let words = words(&node.name);
        if is_plain(&words, &SKY, &SKY_SHAPES) {
            return SkyName::Sky;
        }
        if has(&words, &BACKDROP) || has(&words, &SKY) {
            found = SkyName::Backdrop;
        }
    }
    found
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
    for (idx, node) in nodes.iter().enumerate().filter(|&(idx, _)| is_judged[idx] && is_small[idx]) {
        let own = words(&node.name);
        let above: Vec<Vec<String>> = line(nodes, idx).map(|node| words(&node.name)).collect();
        let any = |of: &[&str]| above.iter().any(|words| has(words, of));
        if any(&CAMERA) && (node.is_skinned || any(&HELD)) {
            reasons[idx] = Some(Look::Held);
        } else if node.is_skinned && any(&FIGURE) {
            reasons[idx] = Some(Look::Figure);
            mark_rig(nodes, idx, &mut is_rig);
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

/// Marks the nearest node, from `idx` upwards, that is named as a figure.
fn mark_rig(nodes: &[Node<DVec3>], idx: usize, is_rig: &mut [bool]) {
    let mut next = Some(idx);
    while let Some(idx) = next {
        is_rig[idx] = has(&words(&nodes[idx].name), &FIGURE);
        next = if is_rig[idx] { None } else { nodes[idx].parent };
    }
}

fn is_upright(bounds: Bounds) -> bool {
    bounds.high.y - bounds.low.y >= UPRIGHT * bounds.side()
}

/// A node and the nodes above it.
fn line(nodes: &[Node<DVec3>], node: usize) -> impl Iterator<Item = &Node<DVec3>> {
    std::iter::successors(Some(&nodes[node]), |node| node.parent.map(|parent| &nodes[parent]))
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
