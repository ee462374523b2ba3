//! Finds what of a level does not belong to it: skies, backdrops, strays, figures, and what is held before a camera.
//!
//! Judges sizes and distances by the level's own main part (`parts`), since its unit may be wrong. What could be walked
//! on, or be a wall, stays when in doubt. Start reading at [`judge`].

mod bounds;
mod cut;
mod figures;
mod parts;

use self::bounds::{Bounds, without_each};
use self::cut::{clip, touches};
use self::figures::{Look, SkyName};
use self::parts::{Main, Part, main_of, shells};
use crate::scene::Node;
use glam::DVec3;
use std::fmt;
use surefoot_world::Vec3;
use surefoot_world::mesh::{Surface, Triangle};

/// Times as large as the main part, by its diagonal, that a part must be which is not of it; with a name that says so.
const OUTER: f64 = 1.5;
const OUTER_NAMED: f64 = 1.2;
/// Distance from the main part that a sky keeps, as a share of the main part's size and of its own, and that a backdrop
/// keeps, as a share of the main part's.
const CLEARANCE: f64 = 0.05;
const OWN_CLEARANCE: f64 = 0.02;
const BACKDROP: f64 = 0.5;
/// Least size of such a part, m, and least walkable area of the main part, m2, without such a name: lamps in a room
/// touch nothing either.
const OUTER_M: f64 = 60.0;
const LEVEL_M2: f64 = 25.0;
/// Times as large as the main part, along its longer side, and metres that a plane must be to be clipped.
const PLANE: f64 = 6.0;
const PLANE_M: f64 = 500.0;
/// Side from which a plane on which the level stands is clipped, m: smaller ones fit on a map.
const CLIPPED_M: f64 = 1000.0;
/// Height over side below which a shell without a name may be a hall around what hangs in it.
const HALL: f64 = 0.3;
/// Height of a plane over its side, and share of its faces that are level.
const PLANE_HEIGHT: f64 = 0.02;
const PLANE_LEVEL: f64 = 0.95;
/// Ground that is left around the main part, as a share of its side, and at least, m.
const MARGIN: f64 = 0.25;
const MARGIN_M: f64 = 20.0;
/// Most parts around the main part, and most times that others are looked for inside them.
const MOST_OUTER: usize = 64;
const MOST_ROUNDS: usize = 8;
/// Share of the level's size from which a node is split.
const WIDE: f64 = 0.5;
/// Least share of the main part's size that a sky has by its name.
const NAMED_SKY: f64 = 0.25;
/// Share of its longest side by which the level shrinks without the node that makes it too large.
const SHRINKS: f64 = 0.25;
/// Directions upwards and around in which a sky is looked for; askew, so that none runs along an edge.
const WAYS: [[f32; 3]; 9] = [
    [0.031, 1.0, 0.017],
    [1.0, 0.6, 0.23],
    [-1.0, 0.6, 0.31],
    [0.27, 0.6, 1.0],
    [0.19, 0.6, -1.0],
    [0.8, 0.5, 0.7],
    [-0.8, 0.5, 0.71],
    [0.79, 0.5, -0.7],
    [-0.8, 0.5, -0.69],
];

/// Why a node, or a part of it, is no part of the level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reason {
    /// It encloses the level from afar.
    Sky,
    /// It stands far outside and cannot be walked on, or lies far above or below.
    Backdrop,
    /// It lies far from everything else, and is small.
    Far,
    /// It is a figure, or belongs to one.
    Figure,
    /// It is held before a camera.
    Held,
}

impl From<Look> for Reason {
    fn from(look: Look) -> Self {
        match look {
            Look::Figure => Self::Figure,
            Look::Held => Self::Held,
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Sky => "it is a sky around the level",
            Self::Backdrop => "it is a backdrop far outside the level",
            Self::Far => "it is far from the rest of the level",
            Self::Figure => "it is a figure by its name and its shape",
            Self::Held => "it is held before a camera",
        })
    }
}

/// What should become of triangles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Verdict {
    LeftOut(Reason),
    /// They are ground that reaches far beyond the level, and end at the sides of this box.
    Clipped(Bounds),
}

/// A node, or some of its triangles, that should not remain as it is.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Finding {
    pub(super) node: usize,
    /// Indices of the triangles, in ascending order; `None` for all.
    pub(super) triangles: Option<Vec<u32>>,
    pub(super) verdict: Verdict,
}

impl Finding {
    /// Whether nothing is left of the node.
    pub(super) fn is_whole(&self) -> bool {
        self.triangles.is_none() && matches!(self.verdict, Verdict::LeftOut(_))
    }

    /// Why the node became what it did, for the report.
    pub(super) fn reason(&self) -> String {
        match self.verdict {
            Verdict::LeftOut(reason) if self.is_whole() => reason.to_string(),
            _ => self.text("it"),
        }
    }

    /// The warning, in which `label` names the node.
    pub(super) fn text(&self, label: &str) -> String {
        let what = match &self.triangles {
            None => format!("{label} was"),
            Some(triangles) => format!("{} triangles of {label} were", triangles.len()),
        };
        match self.verdict {
            Verdict::LeftOut(reason) => format!("{what} left out: {reason}"),
            Verdict::Clipped(Bounds { low, high }) => {
                let (width, depth) = (high.x - low.x, high.z - low.z);
                format!("{what} clipped to {width:.0} x {depth:.0} m: it is a plane that reaches far beyond the level")
            }
        }
    }
}

/// Finds what does not belong to a level. `solid` says which nodes are to be judged. Points are in metres, y up.
pub(super) fn judge(nodes: &[Node<DVec3>], solid: &[bool], ignore_names: bool) -> Vec<Finding> {
    let (looks, names) = if ignore_names {
        (vec![None; nodes.len()], vec![SkyName::Other; nodes.len()])
    } else {
        (figures::find(nodes, solid), figures::sky_names(nodes))
    };
    let mut level = Level { nodes, parts: Vec::new(), verdicts: Vec::new() };
    for node in (0..nodes.len()).filter(|&node| solid[node] && !nodes[node].triangles.is_empty()) {
        level.parts.push(Part::new(nodes, node, None, names[node]));
        level.verdicts.push(looks[node].map(|look| Verdict::LeftOut(look.into())));
    }
    // Nodes are judged as wholes first: a sky may have a sun.
    level.judge();
    level.split();
    level.judge();
    level.findings()
}

/// Leaves out and clips what was found.
pub(super) fn apply(nodes: &mut [Node<DVec3>], findings: &[Finding]) {
    for of_node in findings.chunk_by(|a, b| a.node == b.node) {
        let triangles = &mut nodes[of_node[0].node].triangles;
        let mut is_kept = vec![true; triangles.len()];
        let mut clipped = Vec::new();
        for finding in of_node {
            let indices = finding.triangles.clone().unwrap_or_else(|| (0..triangles.len() as u32).collect());
            indices.iter().for_each(|&idx| is_kept[idx as usize] = false);
            if let Verdict::Clipped(within) = finding.verdict {
                let whole: Vec<[DVec3; 3]> = indices.iter().map(|&idx| triangles[idx as usize]).collect();
                clipped.extend(clip(&whole, within));
            }
        }
        let mut is_kept = is_kept.into_iter();
        triangles.retain(|_| is_kept.next() == Some(true));
        triangles.extend(clipped);
    }
}

/// The node that makes a level so large: the level is much smaller without it. `kept` says which nodes count.
pub(super) fn largest<P: Copy + Into<DVec3>>(nodes: &[Node<P>], kept: &[bool]) -> Option<usize> {
    let bounds = |(node, is_kept): (&Node<P>, &bool)| {
        Bounds::around(node.triangles.iter().flatten().filter(|_| *is_kept).map(|corner| (*corner).into()))
    };
    let bounds: Vec<Bounds> = nodes.iter().zip(kept).map(bounds).collect();
    let longest = |bounds: Bounds| (bounds.high - bounds.low).max_element();
    let whole = longest(bounds.iter().copied().fold(Bounds::NONE, Bounds::union));
    let without = without_each(&bounds).into_iter().map(longest).enumerate();
    let (node, rest) = without.min_by(|a, b| a.1.total_cmp(&b.1))?;
    (rest > 0.0 && rest <= (1.0 - SHRINKS) * whole).then_some(node)
}

/// A level while it is judged.
struct Level<'a> {
    nodes: &'a [Node<DVec3>],
    parts: Vec<Part>,
    /// One for each part; `None` for what belongs so far.
    verdicts: Vec<Option<Verdict>>,
}

impl Level<'_> {
    fn judge(&mut self) {
        for _ in 0..MOST_ROUNDS {
            let is_any_named = self.find_named_skies();
            if !self.find_outer() && !is_any_named {
                break;
            }
        }
        let main = self.main(&self.members());
        // What could not be a level by itself does not tell what belongs to one.
        for idx in main.beyond.into_iter().filter(|_| main.walkable >= LEVEL_M2) {
            let reason = if self.parts[idx].is_card() { Reason::Backdrop } else { Reason::Far };
            self.verdicts[idx] = Some(Verdict::LeftOut(reason));
        }
    }

    /// The parts that are not left out so far.
    fn members(&self) -> Vec<usize> {
        let is_in = |&idx: &usize| !matches!(self.verdicts[idx], Some(Verdict::LeftOut(_)));
        (0..self.parts.len()).filter(is_in).collect()
    }

    fn main(&self, members: &[usize]) -> Main {
        main_of(&self.parts, members, self.nodes)
    }

    /// Leaves out what has the name of a sky and encloses the middle of the level. Returns whether there was any.
    fn find_named_skies(&mut self) -> bool {
        let (named, others): (Vec<usize>, Vec<usize>) =
            self.members().into_iter().partition(|&idx| self.parts[idx].name == SkyName::Sky);
        if named.is_empty() || others.is_empty() {
            return false;
        }
        let main = self.main(&others);
        let is_sky = |&idx: &usize| {
            let part = &self.parts[idx];
            let is_large = part.bounds.size() >= NAMED_SKY * main.bounds.size();
            self.verdicts[idx].is_none() && is_large && self.encloses(part, main.bounds.centre())
        };
        let skies: Vec<usize> = named.into_iter().filter(is_sky).collect();
        skies.iter().for_each(|&idx| self.verdicts[idx] = Some(Verdict::LeftOut(Reason::Sky)));
        !skies.is_empty()
    }

    /// Finds the largest parts if each is much larger than all others together and can be judged to be no part of the
    /// level. Returns whether there are any.
    fn find_outer(&mut self) -> bool {
        let mut order = self.members();
        order.sort_by(|&a, &b| self.parts[b].bounds.size().total_cmp(&self.parts[a].bounds.size()));
        for count in (1..order.len().min(MOST_OUTER + 1)).rev() {
            let (outer, rest) = order.split_at(count);
            let last = outer[count - 1];
            if self.parts[last].bounds.size() < self.outer(last) * self.parts[rest[0]].bounds.size() {
                continue;
            }
            let main = self.main(rest);
            let verdicts: Option<Vec<Verdict>> = outer.iter().map(|&idx| self.verdict(idx, &main)).collect();
            if let Some(verdicts) = verdicts {
                for (&idx, verdict) in outer.iter().zip(verdicts) {
                    self.settle(idx, verdict);
                }
                return true;
            }
        }
        false
    }

    fn settle(&mut self, idx: usize, verdict: Verdict) {
        self.verdicts[idx] = Some(verdict);
        if let Verdict::Clipped(within) = verdict {
            let bounds = &mut self.parts[idx].bounds;
            let (low, high) = (bounds.low.max(within.low), bounds.high.min(within.high));
            *bounds = Bounds { low: low.with_y(bounds.low.y), high: high.with_y(bounds.high.y) };
        }
    }

    /// Times as large as the main part that a part must be which is not of it.
    fn outer(&self, idx: usize) -> f64 {
        if self.parts[idx].name == SkyName::Other { OUTER } else { OUTER_NAMED }
    }

    /// What a part is that is much larger than all others, of which `main` is the main part.
    fn verdict(&self, idx: usize, main: &Main) -> Option<Verdict> {
        let part = &self.parts[idx];
        let (size, main_size) = (part.bounds.size(), main.bounds.size());
        if self.verdicts[idx].is_some() || size < self.outer(idx) * main_size {
            return None;
        }
        let height = part.bounds.high.y - part.bounds.low.y;
        if height <= PLANE_HEIGHT * part.bounds.side() && part.level >= PLANE_LEVEL * part.area {
            // A ring around the level has nothing that could be left.
            return plane(part.bounds, main.bounds).filter(|verdict| match verdict {
                Verdict::LeftOut(_) => true,
                Verdict::Clipped(Bounds { low, high }) => {
                    let column = Bounds { low: low.with_y(part.bounds.low.y), high: high.with_y(part.bounds.high.y) };
                    part.each(self.nodes).any(|triangle| touches(triangle, column))
                }
            });
        }
        let is_named = part.name != SkyName::Other;
        if !is_named && (size < OUTER_M || main.walkable < LEVEL_M2) {
            return None;
        }
        // Halls are low; skies are not.
        if !is_named && height < HALL * part.bounds.side() {
            return None;
        }
        let enters = |distance: f64| {
            let near = main.bounds.widened(distance);
            part.each(self.nodes).any(|triangle| touches(triangle, near))
        };
        if enters(if is_named { 0.0 } else { (CLEARANCE * main_size).max(OWN_CLEARANCE * size) }) {
            return None;
        }
        if self.encloses(part, main.bounds.centre()) {
            return Some(Verdict::LeftOut(Reason::Sky));
        }
        let is_backdrop = part.is_card() && !enters(BACKDROP * main_size);
        is_backdrop.then_some(Verdict::LeftOut(Reason::Backdrop))
    }

    /// Whether a part is seen in nearly all directions from a point, upwards and around.
    fn encloses(&self, part: &Part, point: DVec3) -> bool {
        let facing = |corners: &[DVec3; 3]| Triangle::new(corners.map(|it| (it - point).as_vec3()), Surface::Ground);
        let triangles: Vec<Triangle> = part.each(self.nodes).filter_map(facing).collect();
        let is_seen = |way: &&[f32; 3]| {
            let way = Vec3::from_array(**way);
            triangles.iter().any(|triangle| triangle.ray(Vec3::ZERO, way, 0.0, f32::INFINITY).is_some())
        };
        WAYS.iter().filter(is_seen).count() + 1 >= WAYS.len()
    }

    /// Splits wide parts into shells.
    fn split(&mut self) {
        let members = self.members();
        let whole = members.iter().fold(Bounds::NONE, |all, &idx| all.union(self.parts[idx].bounds));
        let (parts, verdicts) = (std::mem::take(&mut self.parts), std::mem::take(&mut self.verdicts));
        for (part, verdict) in parts.into_iter().zip(verdicts) {
            let is_wide = verdict.is_none() && part.bounds.size() >= WIDE * whole.size();
            let shells = if is_wide { shells(&self.nodes[part.node].triangles) } else { Vec::new() };
            if shells.len() < 2 {
                self.parts.push(part);
                self.verdicts.push(verdict);
                continue;
            }
            for shell in shells {
                self.parts.push(Part::new(self.nodes, part.node, Some(shell), part.name));
                self.verdicts.push(None);
            }
        }
    }

    /// What does not belong, by nodes. A level is never left empty.
    fn findings(self) -> Vec<Finding> {
        if !self.members().iter().any(|&idx| self.parts[idx].area > 0.0) {
            return Vec::new();
        }
        let mut findings: Vec<Finding> = Vec::new();
        for (part, verdict) in self.parts.into_iter().zip(self.verdicts) {
            let Some(verdict) = verdict else { continue };
            let mut of_node = findings.iter_mut().rev().take_while(|finding| finding.node == part.node);
            match of_node.find(|finding| finding.verdict == verdict) {
                Some(Finding { triangles: Some(triangles), .. }) => {
                    triangles.extend(part.triangles.unwrap_or_default())
                }
                _ => findings.push(Finding { node: part.node, triangles: part.triangles, verdict }),
            }
        }
        for finding in &mut findings {
            let count = self.nodes[finding.node].triangles.len();
            finding.triangles = finding.triangles.take().filter(|triangles| triangles.len() < count);
            finding.triangles.iter_mut().for_each(|triangles| triangles.sort_unstable());
        }
        findings
    }
}

/// What a plane is that is much larger than the main part of a level.
fn plane(own: Bounds, main: Bounds) -> Option<Verdict> {
    let is_over = |axis: usize| own.low[axis] < main.high[axis] && own.high[axis] > main.low[axis];
    if !is_over(0) || !is_over(2) || own.side() < (PLANE * main.side()).max(PLANE_M) {
        return None;
    }
    let is_above = own.low.y > main.high.y + CLEARANCE * main.size();
    if is_above || own.high.y < main.low.y - BACKDROP * main.size() {
        return Some(Verdict::LeftOut(Reason::Backdrop));
    }
    let clipped = || Verdict::Clipped(main.widened((MARGIN * main.side()).max(MARGIN_M)));
    (own.side() >= CLIPPED_M).then(clipped)
}

#[cfg(test)]
mod tests;
