//! Settles which side of a level's faces is solid: shells that were modelled inside out are turned, and surfaces without thickness become
//! plates that hold from both sides.
//!
//! Bodies collide with the front of a face, and tell by fronts and backs whether a place lies inside something solid. Renderers often draw
//! both sides, so that levels look right whose faces are not.

use crate::Vec3;
use std::collections::{BTreeMap, HashMap};

/// Side of a cube whose corners are welded into one vertex, m.
const WELD_M: f32 = 0.001;
/// Thickness of a plate, m: behind the front of the surface.
const PLATE_M: f32 = 0.05;
/// Upright component of the normal from which a face is ground.
const UPRIGHT: f32 = 0.3;
/// Share of the area of an open surface that is ground with nothing below, from which it is terrain: nobody comes behind it.
const TERRAIN_SHARE: f64 = 0.95;
/// Side of the columns in which the lowest point of the level is noted, m, and the room that makes a place below another one.
const COLUMN_M: f32 = 2.0;
const BELOW_M: f32 = 0.75;
/// Mean thickness below which a closed shell is no room, m: twice its volume over its area.
const ROOM_M: f64 = 1.0;
/// Share of the level's area from which a shell that is inside out is the level itself, seen from within.
const LEVEL_SHARE: f64 = 0.5;
/// Most other shells that are looked for inside one.
const MAX_OTHERS: usize = 4096;

/// What was changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Changes {
    /// Closed shells that were inside out.
    pub turned_shells: usize,
    /// Triangles whose neighbours faced the other way.
    pub turned_triangles: usize,
    /// Triangles of surfaces without thickness.
    pub plates: usize,
}

/// Settles the sides of all `meshes`, each of which is a list of triangles, m, counter-clockwise seen from the front.
pub(super) fn settle(meshes: &mut [&mut Vec<[Vec3; 3]>]) -> Changes {
    let mut changes = Changes::default();
    let mut shells: Vec<(usize, Shell)> = Vec::new();
    for (mesh, triangles) in meshes.iter_mut().enumerate() {
        for shell in shells_of(triangles, &mut changes) {
            shells.push((mesh, shell));
        }
    }
    let is_turned = inside_out(&shells, meshes);
    let lowest = lowest_by_column(meshes);
    for ((mesh, shell), is_turned) in shells.iter().zip(is_turned) {
        let triangles = &mut *meshes[*mesh];
        if is_turned {
            shell.triangles.iter().for_each(|&idx| triangles[idx as usize].swap(1, 2));
            changes.turned_shells += 1;
        } else if !shell.is_closed && !is_terrain(shell, triangles, &lowest) {
            changes.plates += shell.triangles.len();
            let backs = shell.backs(triangles);
            triangles.extend(backs);
        }
    }
    changes
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

/// Splits a mesh into shells, and turns triangles that face another way than most of their shell. Triangles without area are left out.
fn shells_of(triangles: &mut [[Vec3; 3]], changes: &mut Changes) -> Vec<Shell> {
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
    let mut neighbours: Vec<Vec<(u32, bool)>> = vec![Vec::new(); triangles.len()];
    let mut is_open = vec![false; triangles.len()];
    for shared in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        if let &[(_, _, one, one_rises), (_, _, other, other_rises)] = shared {
            let is_turned = one_rises == other_rises;
            neighbours[one as usize].push((other, is_turned));
            neighbours[other as usize].push((one, is_turned));
        } else {
            shared.iter().for_each(|&(_, _, triangle, _)| is_open[triangle as usize] = true);
        }
    }
    let mut shells = Vec::new();
    let mut is_seen: Vec<bool> = vertices.iter().map(|&corners| !is_sound(corners)).collect();
    for first in 0..triangles.len() as u32 {
        if is_seen[first as usize] {
            continue;
        }
        let (members, is_consistent) = flood(first, &neighbours, &mut is_seen);
        let area = |&(idx, _): &(u32, bool)| double_area(&triangles[idx as usize]);
        let (turned, kept): (Vec<_>, Vec<_>) = members.iter().copied().partition(|&(_, is_turned)| is_turned);
        let minority = if turned.iter().map(area).sum::<f64>() > kept.iter().map(area).sum() { &kept } else { &turned };
        if is_consistent {
            minority.iter().for_each(|&(idx, _)| triangles[idx as usize].swap(1, 2));
            changes.turned_triangles += minority.len();
        }
        let members: Vec<u32> = members.into_iter().map(|(idx, _)| idx).collect();
        let is_closed = is_consistent && members.iter().all(|&idx| !is_open[idx as usize]);
        shells.push(Shell::new(members, is_closed, triangles));
    }
    shells
}

/// The number of the welded vertex at each corner.
fn weld(triangles: &[[Vec3; 3]]) -> Vec<[u32; 3]> {
    let mut numbers: HashMap<[i32; 3], u32> = HashMap::with_capacity(triangles.len());
    let mut number = |corner: Vec3| {
        let cube = (corner / WELD_M).round().to_array().map(|value| value as i32);
        let next = numbers.len() as u32;
        *numbers.entry(cube).or_insert(next)
    };
    triangles.iter().map(|corners| corners.map(&mut number)).collect()
}

/// The triangles that are joined to `first`, each with whether it faces another way than `first`; and whether all ways round agree.
fn flood(first: u32, neighbours: &[Vec<(u32, bool)>], is_seen: &mut [bool]) -> (Vec<(u32, bool)>, bool) {
    let mut sides: BTreeMap<u32, bool> = BTreeMap::from([(first, false)]);
    let mut open = vec![first];
    let mut is_consistent = true;
    is_seen[first as usize] = true;
    while let Some(idx) = open.pop() {
        let side = sides[&idx];
        for &(other, is_turned) in &neighbours[idx as usize] {
            if !std::mem::replace(&mut is_seen[other as usize], true) {
                sides.insert(other, side != is_turned);
                open.push(other);
            } else {
                is_consistent &= sides[&other] == (side != is_turned);
            }
        }
    }
    (sides.into_iter().collect(), is_consistent)
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

    /// The backs of all triangles, behind their fronts by the thickness of a plate.
    fn backs(&self, triangles: &[[Vec3; 3]]) -> Vec<[Vec3; 3]> {
        let mut normals: HashMap<[i32; 3], Vec3> = HashMap::new();
        let place = |corner: Vec3| (corner / WELD_M).round().to_array().map(|value| value as i32);
        let normal = |&[a, b, c]: &[Vec3; 3]| (b - a).cross(c - a).normalize_or_zero();
        let own = || self.triangles.iter().map(|&idx| &triangles[idx as usize]);
        for corners in own() {
            corners.iter().for_each(|&corner| *normals.entry(place(corner)).or_default() += normal(corners));
        }
        let behind = |corner: Vec3, normal: Vec3| {
            let mean = normals[&place(corner)].normalize_or_zero();
            // At a sharp edge the faces' mean tells nothing.
            corner - PLATE_M * if mean.dot(normal) > 0.3 { mean } else { normal }
        };
        own()
            .map(|corners| {
                let [a, b, c] = corners.map(|corner| behind(corner, normal(corners)));
                [a, c, b]
            })
            .collect()
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

/// For each shell, whether it is a solid whose fronts face inwards, not a room.
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
        let (_, shell) = &shells[idx];
        let is_thin = -2.0 * shell.volume / shell.area < ROOM_M;
        is_candidate && (is_habit || is_thin || shell.area < LEVEL_SHARE * total)
    };
    candidates.into_iter().enumerate().map(is_turned).collect()
}

type Columns = HashMap<(i32, i32), f32>;

fn column_of(at: Vec3) -> (i32, i32) {
    ((at.x / COLUMN_M).floor() as i32, (at.z / COLUMN_M).floor() as i32)
}

/// The lowest corner or centre of a triangle in each column.
fn lowest_by_column(meshes: &[&mut Vec<[Vec3; 3]>]) -> Columns {
    let mut lowest = Columns::new();
    for [a, b, c] in meshes.iter().flat_map(|triangles| triangles.iter()) {
        let centre = (*a + *b + *c) / 3.0;
        for at in [*a, *b, *c, centre, (*a + *b) * 0.5, (*b + *c) * 0.5, (*c + *a) * 0.5] {
            let low = lowest.entry(column_of(at)).or_insert(at.y);
            *low = low.min(at.y);
        }
    }
    lowest
}

/// Whether nearly all of an open surface is ground with nothing below.
fn is_terrain(shell: &Shell, triangles: &[[Vec3; 3]], lowest: &Columns) -> bool {
    let is_ground = |&&idx: &&u32| {
        let corners @ [a, b, c] = &triangles[idx as usize];
        let upright = (*b - *a).cross(*c - *a).normalize_or_zero().y;
        let bottom = a.y.min(b.y).min(c.y);
        let centre = (*a + *b + *c) / 3.0;
        let mut ends = corners.iter().chain([&centre]);
        upright > UPRIGHT && ends.all(|&at| lowest.get(&column_of(at)).is_none_or(|&low| low > bottom - BELOW_M))
    };
    let area = |idx: &u32| 0.5 * double_area(&triangles[*idx as usize]);
    shell.triangles.iter().filter(is_ground).map(area).sum::<f64>() >= TERRAIN_SHARE * shell.area
}
