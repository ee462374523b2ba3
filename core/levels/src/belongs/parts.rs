//! Splits a level into parts, and finds where most of it lies.

use crate::belongs::bounds::Bounds;
use crate::belongs::figures::SkyName;
use crate::inspect::weld;
use crate::joined::Joined;
use crate::scene::Node;
use glam::DVec3;

/// Upright component of the normal from which a face can be stood on, and from which it is level.
const WALKABLE: f64 = 0.5;
const LEVEL: f64 = 0.9999;
/// Most shells into which a node is split.
const MOST_SHELLS: usize = 100_000;
/// Distance from the main part, in multiples of its diagonal and in metres, beyond which parts do not belong to it;
/// cards stand nearer.
const GAP: f64 = 3.0;
const CARD_GAP: f64 = 1.0;
const GAP_M: f64 = 100.0;
/// Most passes over the parts that are not near the main part yet.
const MOST_SWEEPS: usize = 16;
/// Largest shares of the main part's area, and of its walkable area, that stray parts have together.
const STRAY_AREA: f64 = 0.01;
const STRAY_WALKABLE: f64 = 0.001;
/// Share of a part's area up to which its walkable faces do not count.
const CARD: f64 = 0.05;
/// The same for parts with the name of a sky or backdrop: half of a sphere could be stood on.
const NAMED_CARD: f64 = 0.6;

/// A node, or a piece of one that is not joined to the rest of it.
pub(super) struct Part {
    pub(super) node: usize,
    /// Indices of its triangles among the node's; `None` for all.
    pub(super) triangles: Option<Vec<u32>>,
    pub(super) bounds: Bounds,
    /// Area of its faces, of those that can be stood on from one side, and of those that are level, m2.
    pub(super) area: f64,
    pub(super) walkable: f64,
    pub(super) level: f64,
    /// What its node's name says.
    pub(super) name: SkyName,
}

impl Part {
    pub(super) fn new(nodes: &[Node<DVec3>], node: usize, triangles: Option<Vec<u32>>, name: SkyName) -> Self {
        let mut part = Self { node, triangles, bounds: Bounds::NONE, area: 0.0, walkable: 0.0, level: 0.0, name };
        let (mut bounds, mut areas) = (Bounds::NONE, [0.0; 3]);
        for &[a, b, c] in part.each(nodes) {
            bounds = bounds.union(Bounds::around([a, b, c]));
            let normal = (b - a).cross(c - a) * 0.5;
            let area = normal.length();
            for (sum, upright) in areas.iter_mut().zip([0.0, WALKABLE, LEVEL]) {
                *sum += if normal.y.abs() >= upright * area { area } else { 0.0 };
            }
        }
        part.bounds = bounds;
        [part.area, part.walkable, part.level] = areas;
        part
    }

    /// Number of its triangles.
    pub(super) fn count(&self, nodes: &[Node<DVec3>]) -> usize {
        self.triangles.as_ref().map_or(nodes[self.node].triangles.len(), Vec::len)
    }

    /// Its triangles.
    pub(super) fn each<'a>(&'a self, nodes: &'a [Node<DVec3>]) -> impl Iterator<Item = &'a [DVec3; 3]> {
        let all = &nodes[self.node].triangles;
        let at = |place: usize| self.triangles.as_ref().map_or(place, |indices| indices[place] as usize);
        (0..self.count(nodes)).map(move |place| &all[at(place)])
    }

    /// Whether it is only to be looked at: next to nothing of it can be stood on, or little and its name says so.
    pub(super) fn is_card(&self) -> bool {
        let most = if self.name == SkyName::Other { CARD } else { NAMED_CARD };
        self.area > 0.0 && self.walkable <= most * self.area
    }
}

/// The pieces of a node that share no corners, in the order of their first triangles, as indices of triangles.
pub(super) fn shells(triangles: &[[DVec3; 3]]) -> Vec<Vec<u32>> {
    let low = Bounds::around(triangles.iter().flatten().copied()).low;
    let near: Vec<_> = triangles.iter().map(|corners| corners.map(|corner| (corner - low).as_vec3())).collect();
    let vertices = weld(&near);
    let vertex_count = vertices.iter().flatten().max().map_or(0, |&most| most as usize + 1);
    let mut joined = Joined::new(vertex_count);
    for &[a, b, c] in &vertices {
        joined.join(a, b);
        joined.join(a, c);
    }
    let mut numbers: Vec<Option<usize>> = vec![None; vertex_count];
    let mut shells: Vec<Vec<u32>> = Vec::new();
    for (idx, &[a, _, _]) in (0..).zip(&vertices) {
        let number = *numbers[joined.root(a) as usize].get_or_insert(shells.len());
        if number == MOST_SHELLS {
            return vec![(0..triangles.len() as u32).collect()];
        }
        match shells.get_mut(number) {
            Some(shell) => shell.push(idx),
            None => shells.push(vec![idx]),
        }
    }
    shells
}

/// Where most of a level lies.
pub(super) struct Main {
    pub(super) bounds: Bounds,
    /// Walkable area, m2.
    pub(super) walkable: f64,
    /// The parts far outside that the level does not need: strays, and cards that cannot be stood on.
    pub(super) beyond: Vec<usize>,
}

/// Where most of `members` lies, which are indices of `parts`: grows from its middle over everything that is not far
/// away. Clusters far away belong to it as well if they are more than strays.
pub(super) fn main_of(parts: &[Part], members: &[usize], nodes: &[Node<DVec3>]) -> Main {
    let mut bounds = seed(parts, members, nodes);
    let mut beyond: Vec<usize> = members.to_vec();
    beyond.sort_by(|&a, &b| bounds.distance(parts[a].bounds).total_cmp(&bounds.distance(parts[b].bounds)));
    for _ in 0..MOST_SWEEPS {
        let before = beyond.len();
        beyond.retain(|&idx| {
            let part = &parts[idx];
            let gap = (if part.is_card() { CARD_GAP } else { GAP } * bounds.size()).max(GAP_M);
            let is_far = bounds.distance(part.bounds) > gap;
            bounds = if is_far { bounds } else { bounds.union(part.bounds) };
            is_far
        });
        if beyond.len() == before {
            break;
        }
    }
    let sum = |of: &[usize], area: fn(&Part) -> f64| -> f64 { of.iter().map(|&idx| area(&parts[idx])).sum() };
    let strays: Vec<usize> = beyond.iter().copied().filter(|&idx| !parts[idx].is_card()).collect();
    let is_at_most = |share: f64, area: fn(&Part) -> f64| {
        let stray = sum(&strays, area);
        // What is not beyond is the rest.
        stray <= share * (sum(members, area) - sum(&beyond, area))
    };
    if !is_at_most(STRAY_AREA, |part| part.area) || !is_at_most(STRAY_WALKABLE, |part| part.walkable) {
        beyond.clear();
        bounds = members.iter().fold(Bounds::NONE, |bounds, &idx| bounds.union(parts[idx].bounds));
    }
    let walkable = sum(members, |part| part.walkable) - sum(&beyond, |part| part.walkable);
    Main { bounds, walkable, beyond }
}

/// The box of the parts in the middle: between the quartiles of all triangles along each axis.
fn seed(parts: &[Part], members: &[usize], nodes: &[Node<DVec3>]) -> Bounds {
    let total: usize = members.iter().map(|&idx| parts[idx].count(nodes)).sum();
    let mut middle = Bounds::NONE;
    for axis in 0..3 {
        let mut places: Vec<(f64, usize)> =
            members.iter().map(|&idx| (parts[idx].bounds.centre()[axis], parts[idx].count(nodes))).collect();
        places.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let quartile = |quarters: usize| {
            let mut left = quarters * total / 4;
            let is_there = |&&(_, count): &&(f64, usize)| {
                let is_there = left < count;
                left = left.saturating_sub(count);
                is_there
            };
            places.iter().find(is_there).map_or(f64::NAN, |place| place.0)
        };
        (middle.low[axis], middle.high[axis]) = (quartile(1), quartile(3));
    }
    let in_middle = members.iter().map(|&idx| parts[idx].bounds).filter(|own| {
        let centre = own.centre();
        centre.cmpge(middle.low).all() && centre.cmple(middle.high).all()
    });
    in_middle.reduce(Bounds::union).unwrap_or(middle)
}
