//! Settles which side of a level's faces is solid: shells that were modelled inside out are turned, and surfaces
//! without thickness become plates that hold from both sides.
//!
//! Bodies collide with the front of a face, and tell by fronts and backs whether a place lies inside something solid.
//! Renderers often draw both sides, so that levels look right whose faces are not.

use crate::inspect::{cube, weld};
use std::collections::HashMap;
use surefoot_world::Vec3;
use surefoot_world::mesh::Mesh;

/// Thickness of a plate, m: behind the front of the surface.
const PLATE_M: f32 = 0.05;
/// Upright component of the normal, downwards, from which a face is a ceiling.
const UPRIGHT: f32 = 0.5;
/// Triangles of an open surface that are looked at, and the share of their area behind which bodies may come that makes
/// it a plate.
const SAMPLES: usize = 256;
const BARE_SHARE: f64 = 0.5;
/// Distance behind a face from which, and up to which, other faces are looked for, m.
const CLEARANCE_M: f32 = 0.02;
const SIGHT_M: f32 = 100.0;
/// Mean thickness below which a closed shell is no room, m: twice its volume over its area.
const ROOM_M: f64 = 1.0;
/// Share of the level's area from which a shell is the level itself.
const LEVEL_SHARE: f64 = 0.5;
/// Times as many faces as look up that must look down for the level itself to be inside out: ground is modelled in more
/// detail than what is below it, or than ceilings.
const GROUND_DETAIL: f64 = 1.5;
/// Most other shells that are looked for inside one.
const MAX_OTHERS: usize = 4096;

/// What was turned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Turned {
    /// Closed shells that were inside out.
    pub shells: usize,
    /// Triangles whose neighbours faced the other way.
    pub triangles: usize,
}

/// Turns what is inside out in `meshes`, each of which is a list of triangles, m, counter-clockwise seen from the
/// front. Also returns the surfaces that are not closed.
pub(super) fn turn(meshes: &mut [&mut Vec<[Vec3; 3]>]) -> (Turned, Vec<Surface>) {
    let mut turned = Turned::default();
    let mut shells: Vec<(usize, Shell)> = Vec::new();
    for (mesh, triangles) in meshes.iter_mut().enumerate() {
        shells.extend(shells_of(triangles, &mut turned.triangles).into_iter().map(|shell| (mesh, shell)));
    }
    let mut open = Vec::new();
    for ((mesh, shell), is_inside_out) in shells.iter().zip(inside_out(&shells, meshes)) {
        let triangles = &mut *meshes[*mesh];
        if is_inside_out {
            shell.triangles.iter().for_each(|&idx| triangles[idx as usize].swap(1, 2));
            turned.shells += 1;
        } else if !shell.is_closed {
            open.push(Surface(shell.triangles.iter().map(|&idx| triangles[idx as usize]).collect()));
        }
    }
    (turned, open)
}

/// The triangles of a surface that is not closed, m.
pub(super) struct Surface(Vec<[Vec3; 3]>);

impl Surface {
    /// The backs of the surface's triangles, if bodies may come behind it on `mesh`, which holds the surface moved by
    /// `shift`.
    pub fn backs(&self, shift: Vec3, mesh: &Mesh) -> Option<Vec<[Vec3; 3]>> {
        let step = self.0.len().div_ceil(SAMPLES);
        let (mut bare, mut total) = (0.0, 0.0);
        for corners in self.0.iter().step_by(step) {
            let area = double_area(corners);
            total += area;
            bare += if is_bare_behind(corners.map(|corner| corner + shift), mesh) { area } else { 0.0 };
        }
        (bare > BARE_SHARE * total).then(|| plate(&self.0))
    }
}

/// Whether bodies may come behind a triangle: the first face in sight from there is seen from its front. Behind ground,
/// walls and ceilings of something solid, faces are seen from their backs, or there is nothing at all.
fn is_bare_behind([a, b, c]: [Vec3; 3], mesh: &Mesh) -> bool {
    let normal = (b - a).cross(c - a).normalize_or_zero();
    if normal.y < -UPRIGHT {
        // Ground that faces down, or the ceiling of something that is open elsewhere: it holds what comes from above.
        return true;
    }
    let origin = (a + b + c) / 3.0 - normal * CLEARANCE_M;
    let ways = [-normal, (-normal - Vec3::Y).normalize_or_zero()];
    ways.into_iter().filter(|way| *way != Vec3::ZERO).any(|way| {
        let hit = mesh.cast_ray(origin, way, SIGHT_M);
        hit.is_some_and(|hit| mesh.triangles()[hit.triangle_idx as usize].normal().dot(way) < 0.0)
    })
}

/// Triangles that are joined by edges of exactly two, all of which face the same way.
struct Shell {
    triangles: Vec<u32>,
    /// Whether each edge joins two triangles.
    is_closed: bool,
    /// Volume inside, m3, negative if the fronts face inwards; meaningful if it is closed.
    volume: f64,
    area: f64,
    low: Vec3,
    high: Vec3,
}

/// The triangles beyond a triangle's edges, each with whether it faces the other way.
type Neighbours = [Option<(u32, bool)>; 3];

/// Splits a mesh into shells, and turns triangles that face another way than most of their shell. Triangles without
/// area are left out.
fn shells_of(triangles: &mut [[Vec3; 3]], turned_count: &mut usize) -> Vec<Shell> {
    let vertices = weld(triangles);
    // Each edge: its lower vertex, its higher vertex, the triangle, and whether it runs from low to high.
    let mut edges: Vec<(u32, u32, u32, bool)> = Vec::with_capacity(3 * triangles.len());
    let is_sound = |[a, b, c]: [u32; 3]| a != b && b != c && c != a;
    for (triangle, &corners) in (0..).zip(&vertices).filter(|(_, corners)| is_sound(**corners)) {
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let (from, to) = (corners[from], corners[to]);
            edges.push((from.min(to), from.max(to), triangle, from < to));
        }
    }
    edges.sort_unstable();
    let mut neighbours: Vec<Neighbours> = vec![[None; 3]; triangles.len()];
    let mut is_open = vec![false; triangles.len()];
    for shared in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        if let &[(_, _, one, one_rises), (_, _, other, other_rises)] = shared {
            let is_turned = one_rises == other_rises;
            for (own, neighbour) in [(one, other), (other, one)] {
                let free = neighbours[own as usize].iter_mut().find(|it| it.is_none());
                *free.expect("a triangle has three edges") = Some((neighbour, is_turned));
            }
        } else {
            shared.iter().for_each(|&(_, _, triangle, _)| is_open[triangle as usize] = true);
        }
    }
    let mut shells = Vec::new();
    let mut sides: Vec<Option<bool>> = vec![None; triangles.len()];
    for first in 0..triangles.len() as u32 {
        if sides[first as usize].is_some() || !is_sound(vertices[first as usize]) {
            continue;
        }
        let (members, is_consistent) = flood(first, &neighbours, &mut sides);
        let area = |&idx: &u32| double_area(&triangles[idx as usize]);
        let (turned, kept): (Vec<u32>, Vec<u32>) =
            members.iter().copied().partition(|&idx| sides[idx as usize] == Some(true));
        let minority = if turned.iter().map(area).sum::<f64>() > kept.iter().map(area).sum() { &kept } else { &turned };
        if is_consistent {
            minority.iter().for_each(|&idx| triangles[idx as usize].swap(1, 2));
            *turned_count += minority.len();
        }
        let is_closed = is_consistent && members.iter().all(|&idx| !is_open[idx as usize]);
        shells.push(Shell::new(members, is_closed, triangles));
    }
    shells
}

/// The triangles that are joined to `first`, in ascending order, and whether all ways round agree on which of them face
/// another way than `first`. That is noted in `sides`, where triangles that were not met yet have `None`.
fn flood(first: u32, neighbours: &[Neighbours], sides: &mut [Option<bool>]) -> (Vec<u32>, bool) {
    let (mut members, mut is_consistent) = (vec![first], true);
    sides[first as usize] = Some(false);
    let mut next = 0;
    while let Some(&idx) = members.get(next) {
        next += 1;
        for &(other, is_turned) in neighbours[idx as usize].iter().flatten() {
            let side = sides[idx as usize].map(|side| side != is_turned);
            if sides[other as usize].is_none() {
                sides[other as usize] = side;
                members.push(other);
            }
            is_consistent &= sides[other as usize] == side;
        }
    }
    members.sort_unstable();
    (members, is_consistent)
}

fn double_area(&[a, b, c]: &[Vec3; 3]) -> f64 {
    f64::from((b - a).cross(c - a).length())
}

impl Shell {
    fn new(members: Vec<u32>, is_closed: bool, triangles: &[[Vec3; 3]]) -> Self {
        let corners = || members.iter().flat_map(|&idx| triangles[idx as usize]);
        let low = corners().fold(Vec3::INFINITY, Vec3::min);
        let high = corners().fold(Vec3::NEG_INFINITY, Vec3::max);
        let signed = |&idx: &u32| {
            let [a, b, c] = triangles[idx as usize].map(|corner| corner - low);
            f64::from(a.dot(b.cross(c))) / 6.0
        };
        Self {
            volume: members.iter().map(signed).sum(),
            area: members.iter().map(|&idx| 0.5 * double_area(&triangles[idx as usize])).sum(),
            triangles: members,
            is_closed,
            low,
            high,
        }
    }

    /// Whether many more faces look down than up.
    fn looks_down(&self, triangles: &[[Vec3; 3]]) -> bool {
        let upright = |&idx: &u32| {
            let [a, b, c] = triangles[idx as usize];
            (b - a).cross(c - a).normalize_or_zero().y
        };
        let count = |sign: f32| self.triangles.iter().map(upright).filter(|y| y * sign > UPRIGHT).count() as f64;
        count(-1.0) > GROUND_DETAIL * count(1.0)
    }

    /// Whether a point lies inside a closed shell, by the faces that a ray passes.
    fn contains(&self, point: Vec3, triangles: &[[Vec3; 3]]) -> bool {
        if point.cmple(self.low).any() || point.cmpge(self.high).any() {
            return false;
        }
        let direction = Vec3::new(0.617_3, 0.341_7, 0.708_9);
        let crosses = |&&idx: &&u32| {
            let [a, b, c] = triangles[idx as usize].map(|corner| corner - point);
            let (u, v, w) = (direction.dot(c.cross(b)), direction.dot(a.cross(c)), direction.dot(b.cross(a)));
            let is_ahead = |scale: f32| (u * a + v * b + w * c).dot(direction) * scale > 0.0;
            (u > 0.0 && v > 0.0 && w > 0.0 && is_ahead(1.0)) || (u < 0.0 && v < 0.0 && w < 0.0 && is_ahead(-1.0))
        };
        self.triangles.iter().filter(crosses).count() % 2 == 1
    }
}

/// For each shell, whether its fronts face the wrong way: inwards, unless it is a room; or, if it is the level itself,
/// mostly down.
fn inside_out(shells: &[(usize, Shell)], meshes: &[&mut Vec<[Vec3; 3]>]) -> Vec<bool> {
    let total: f64 = shells.iter().map(|(_, shell)| shell.area).sum();
    let holds_others = |own: usize| {
        let (mesh, shell) = &shells[own];
        // What merely sticks in a solid does not lie inside.
        let is_within = |other: &Shell| other.low.cmpgt(shell.low).all() && other.high.cmplt(shell.high).all();
        shells.iter().step_by(shells.len().div_ceil(MAX_OTHERS)).any(|(other_mesh, other)| {
            let [a, b, c] = meshes[*other_mesh][other.triangles[0] as usize];
            is_within(other) && shell.contains((a + b + c) / 3.0, meshes[*mesh])
        })
    };
    let suspects: Vec<bool> = shells.iter().map(|(_, shell)| shell.is_closed && shell.volume < 0.0).collect();
    let is_held = |idx: usize| suspects[idx] && !holds_others(idx);
    let candidates: Vec<bool> = (0..shells.len()).map(is_held).collect();
    let candidate_count = candidates.iter().filter(|&&it| it).count();
    let closed_count = shells.iter().filter(|(_, shell)| shell.is_closed).count();
    // Who turned most of the level inside out did so with all of it.
    let is_habit = candidate_count >= 3 && 2 * candidate_count > closed_count;
    let is_turned = |(idx, is_candidate): (usize, bool)| {
        let (mesh, shell) = &shells[idx];
        let is_thin = -2.0 * shell.volume / shell.area < ROOM_M;
        let is_level = shell.area >= LEVEL_SHARE * total;
        is_candidate && (is_habit || is_thin || !is_level) || is_level && shell.looks_down(meshes[*mesh])
    };
    candidates.into_iter().enumerate().map(is_turned).collect()
}

/// The backs of all triangles of a surface, behind their fronts by the thickness of a plate.
fn plate(triangles: &[[Vec3; 3]]) -> Vec<[Vec3; 3]> {
    let mut normals: HashMap<[i32; 3], Vec3> = HashMap::new();
    let normal = |&[a, b, c]: &[Vec3; 3]| (b - a).cross(c - a).normalize_or_zero();
    for corners in triangles {
        corners.iter().for_each(|&corner| *normals.entry(cube(corner)).or_default() += normal(corners));
    }
    let behind = |corner: Vec3, normal: Vec3| {
        let mean = normals[&cube(corner)].normalize_or_zero();
        // At a sharp edge the faces' mean tells nothing.
        corner - PLATE_M * if mean.dot(normal) > 0.3 { mean } else { normal }
    };
    let back = |corners: &[Vec3; 3]| {
        let [a, b, c] = corners.map(|corner| behind(corner, normal(corners)));
        [a, c, b]
    };
    triangles.iter().map(back).collect()
}
