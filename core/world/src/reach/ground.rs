//! Places to stand on a grid, joined into islands by walking.

use crate::character::{CharacterProfile, MoveScratch, is_clear};
use crate::float::horizontal;
use crate::map::CollisionMap;
use crate::{Vec3, navigable};
use petgraph::unionfind::UnionFind;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

/// Spacing of the grid, m.
pub const SPACING_M: f32 = 1.25;
/// Offset of the grid, m, so that no ray runs along the edges of the terrain's lattice.
const OFFSET_M: f32 = 0.61;
/// Points checked between two neighbouring places.
const INTERMEDIATE_COUNT: usize = 3;
/// Heights above the feet at which the path between two places must be clear, m.
const CLEAR_HEIGHTS_M: [f32; 2] = [0.45, 1.3];
/// Height above the feet from which the ground between two places is looked for, m.
const GROUND_BELOW_M: f32 = 1.2;
/// Share of the height of a body that crouches up to which the survey looks.
const CROUCHED_SHARE: f32 = 0.8;
/// Penetration up to which a body passes an obstacle, m.
const SLOP_M: f32 = 0.05;

/// Obstacles that keep two places apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Obstacles {
    /// Those on the line from one place to the other.
    OnLine,
    /// Those in the way of the whole body.
    OfBody,
}

/// One place to stand.
#[derive(Debug, Clone, Copy)]
pub struct Cell {
    /// Position of the feet, m.
    pub feet: Vec3,
    /// Index of the island that the place belongs to.
    pub island: u32,
}

/// Places joined by walking.
#[derive(Debug, Clone, Copy)]
pub struct Island {
    /// Number of places.
    pub cell_count: u32,
}

/// All places to stand on a map.
#[derive(Debug)]
pub struct Ground {
    columns: i32,
    rows: i32,
    /// Index of the first cell of each grid column, and a sentinel at the end.
    starts: Vec<u32>,
    cells: Vec<Cell>,
    islands: Vec<Island>,
    /// For each cell, bit n is set if a walk leads to its n-th neighbour of [`NEIGHBOURS`].
    walkable: Vec<u8>,
}

/// Offsets (columns, rows) of the eight neighbours; the second half mirrors the first.
pub const NEIGHBOURS: [(i32, i32); 8] = [(1, 0), (0, 1), (1, 1), (1, -1), (-1, 0), (0, -1), (-1, -1), (-1, 1)];

impl Ground {
    /// Finds all places and islands.
    pub(super) fn survey(map: &CollisionMap, profile: &CharacterProfile, obstacles: Obstacles) -> Self {
        let extent = map.extent();
        let (columns, rows) = ((extent.x / SPACING_M) as i32, (extent.z / SPACING_M) as i32);
        let find = |scratch: &mut MoveScratch, row: i32| find_row(map, profile, columns, row, scratch);
        let found: Vec<_> = (0..rows).into_par_iter().map_init(MoveScratch::default, find).collect();
        let mut starts = vec![0];
        let mut cells = Vec::new();
        for (row_cells, counts) in found {
            for count in counts {
                starts.push(starts[starts.len() - 1] + count);
            }
            cells.extend(row_cells.into_iter().map(|feet| Cell { feet, island: 0 }));
        }
        let mut ground = Self { columns, rows, starts, cells, islands: Vec::new(), walkable: Vec::new() };
        ground.join_on_foot(map, profile, obstacles);
        ground
    }

    /// All places, row by row and column by column.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// All islands, the largest first.
    pub fn islands(&self) -> &[Island] {
        &self.islands
    }

    /// Column and row nearest to a point.
    pub fn column_of(&self, point: Vec3) -> (i32, i32) {
        let idx = |value: f32| ((value - OFFSET_M) / SPACING_M).round() as i32;
        (idx(point.x), idx(point.z))
    }

    /// Indices of the places in a grid column; empty outside the map.
    pub fn column(&self, column: i32, row: i32) -> std::ops::Range<usize> {
        if column < 0 || row < 0 || column >= self.columns || row >= self.rows {
            return 0..0;
        }
        let idx = (row * self.columns + column) as usize;
        self.starts[idx] as usize..self.starts[idx + 1] as usize
    }

    /// Indices of the places at most `span` columns and rows from a point, row by row.
    pub fn around(&self, point: Vec3, span: i32) -> impl Iterator<Item = usize> {
        let (column, row) = self.column_of(point);
        let columns = move |z: i32| (column - span..=column + span).map(move |x| (x, z));
        (row - span..=row + span).flat_map(columns).flat_map(|(x, z)| self.column(x, z))
    }

    /// The place nearest to `feet`, at most one column away and less than 0.8 m higher or lower.
    pub fn at(&self, feet: Vec3) -> Option<&Cell> {
        self.index_at(feet).map(|idx| &self.cells[idx])
    }

    /// Index of the place nearest to `feet`, as for [`at`](Self::at).
    pub fn index_at(&self, feet: Vec3) -> Option<usize> {
        let near = self.around(feet, 1).filter(|&idx| (self.cells[idx].feet.y - feet.y).abs() < 0.8);
        let distance = |idx: &usize| self.cells[*idx].feet.distance_squared(feet);
        near.min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    /// Index of the nearest place to which a character can walk from `feet`, at most one column away. Unlike
    /// [`index_at`](Self::index_at), it is on the same side of walls and rims.
    pub fn walk_from(
        &self,
        map: &CollisionMap,
        profile: &CharacterProfile,
        feet: Vec3,
        scratch: &mut MoveScratch,
    ) -> Option<usize> {
        let mut near: Vec<usize> = self.around(feet, 1).collect();
        near.sort_by(|a, b| {
            let [a, b] = [a, b].map(|idx| self.cells[*idx].feet.distance_squared(feet));
            a.total_cmp(&b)
        });
        let mut walk = Walk::new(map, profile, Obstacles::OfBody, scratch);
        near.into_iter().find(|&idx| walk.leads(feet, self.cells[idx].feet))
    }

    /// Index of the cell to which one can walk from a cell in the direction `NEIGHBOURS[neighbour]`: the one nearest in
    /// height.
    pub fn neighbour(&self, cell_idx: usize, neighbour: usize) -> Option<usize> {
        if !self.walks_to(cell_idx, neighbour) {
            return None;
        }
        let feet = self.cells[cell_idx].feet;
        let ((column, row), (dx, dz)) = (self.column_of(feet), NEIGHBOURS[neighbour]);
        let rise = |idx: &usize| (self.cells[*idx].feet.y - feet.y).abs();
        self.column(column + dx, row + dz).min_by(|a, b| rise(a).total_cmp(&rise(b)))
    }

    /// Whether a walk leads from a cell to its neighbour `NEIGHBOURS[neighbour]`.
    pub fn walks_to(&self, cell_idx: usize, neighbour: usize) -> bool {
        self.walkable[cell_idx] & (1 << neighbour) != 0
    }

    /// Whether a walk of at most `metres` over places leads from one point to another; false if a point is at no place.
    pub fn walks_within(&self, from: Vec3, to: Vec3, metres: f32) -> bool {
        let (Some(start), Some(goal)) = (self.index_at(from), self.index_at(to)) else { return false };
        if self.cells[start].island != self.cells[goal].island {
            return false;
        }
        // Lengths are not negative, so their bits have the same order.
        let mut best: BTreeMap<usize, f32> = BTreeMap::from([(start, 0.0)]);
        let mut open = BinaryHeap::from([Reverse((0u32, start))]);
        while let Some(Reverse((bits, cell))) = open.pop() {
            let walked = f32::from_bits(bits);
            if cell == goal {
                return true;
            }
            if best.get(&cell).is_some_and(|&least| walked > least) {
                continue;
            }
            for next in (0..NEIGHBOURS.len()).filter_map(|neighbour| self.neighbour(cell, neighbour)) {
                let then = walked + self.cells[cell].feet.distance(self.cells[next].feet);
                let is_hopeful = then + self.cells[next].feet.distance(self.cells[goal].feet) <= metres;
                if is_hopeful && best.get(&next).is_none_or(|&least| then < least) {
                    best.insert(next, then);
                    open.push(Reverse((then.to_bits(), next)));
                }
            }
        }
        false
    }

    fn join_on_foot(&mut self, map: &CollisionMap, profile: &CharacterProfile, obstacles: Obstacles) {
        let join = |scratch: &mut MoveScratch, row: i32| {
            self.joins_of_row(&mut Walk::new(map, profile, obstacles, scratch), row)
        };
        let joins: Vec<Vec<(u32, u32, u8)>> =
            (0..self.rows).into_par_iter().map_init(MoveScratch::default, join).collect();
        let mut joined = UnionFind::<u32>::new(self.cells.len());
        self.walkable = vec![0; self.cells.len()];
        for (a, b, neighbour) in joins.into_iter().flatten() {
            self.walkable[a as usize] |= 1 << neighbour;
            self.walkable[b as usize] |= 1 << (neighbour + 4);
            joined.union(a, b);
        }
        self.number_islands(joined.into_labeling());
    }

    /// The pairs of neighbouring cells between which a walk leads, for one row of the grid, with the direction.
    fn joins_of_row(&self, walk: &mut Walk<'_>, row: i32) -> Vec<(u32, u32, u8)> {
        let mut joins = Vec::new();
        for (column, cell) in (0..self.columns).flat_map(|column| self.column(column, row).map(move |it| (column, it)))
        {
            // The other half of the directions follows by symmetry.
            for (neighbour, &(dx, dz)) in (0..).zip(&NEIGHBOURS[..4]) {
                let others = self.column(column + dx, row + dz);
                let walks = others.filter(|other| walk.leads(self.cells[cell].feet, self.cells[*other].feet));
                joins.extend(walks.map(|other| (cell as u32, other as u32, neighbour)));
            }
        }
        joins
    }

    /// Numbers the islands: the largest comes first, and of equally large ones the one whose first cell comes first.
    fn number_islands(&mut self, labels: Vec<u32>) {
        // Number of cells and first cell of each label.
        let mut found: BTreeMap<u32, (u32, usize)> = BTreeMap::new();
        for (cell, &label) in labels.iter().enumerate() {
            found.entry(label).or_insert((0, cell)).0 += 1;
        }
        let mut order: Vec<(u32, (u32, usize))> = found.into_iter().collect();
        order.sort_by_key(|&(_, (count, first))| (Reverse(count), first));
        self.islands = order.iter().map(|&(_, (cell_count, _))| Island { cell_count }).collect();
        let island_of: BTreeMap<u32, u32> = order.iter().map(|(label, _)| *label).zip(0..).collect();
        for (cell, label) in self.cells.iter_mut().zip(labels) {
            cell.island = island_of[&label];
        }
    }
}

/// Places of one row of the grid, and the number of places in each column.
fn find_row(
    map: &CollisionMap,
    profile: &CharacterProfile,
    columns: i32,
    row: i32,
    scratch: &mut MoveScratch,
) -> (Vec<Vec3>, Vec<u32>) {
    let (mut found, mut counts) = (Vec::new(), Vec::new());
    for column in 0..columns {
        let (x, z) = (column as f32 * SPACING_M + OFFSET_M, row as f32 * SPACING_M + OFFSET_M);
        let before = found.len();
        let (floors, floor_count) = navigable::floors(map, profile, x, z);
        for (floor, normal) in &floors[..floor_count] {
            // A capsule on a slope touches beside its lowest point.
            let feet = *floor + Vec3::new(0.0, profile.radius * (1.0 / normal.y - 1.0) + 0.01, 0.0);
            let dry = map.liquid_at(feet, -0.1).is_none();
            if dry && map.device_at(feet).is_none() && is_clear(map.mesh(), profile, feet, 0.03, scratch) {
                found.push(feet);
            }
        }
        counts.push((found.len() - before) as u32);
    }
    (found, counts)
}

/// Whether a straight walk of at most about 2 m leads from one place to another, and back.
pub fn walks_straight(
    map: &CollisionMap,
    profile: &CharacterProfile,
    from: Vec3,
    to: Vec3,
    scratch: &mut MoveScratch,
) -> bool {
    Walk::new(map, profile, Obstacles::OfBody, scratch).leads(from, to)
}

/// Walks of a character between neighbouring places.
struct Walk<'a> {
    map: &'a CollisionMap,
    profile: &'a CharacterProfile,
    obstacles: Obstacles,
    /// The part of the body above the steps that it can take, and its height above the feet, m.
    torso: CharacterProfile,
    lift: f32,
    scratch: &'a mut MoveScratch,
}

impl<'a> Walk<'a> {
    fn new(
        map: &'a CollisionMap,
        profile: &'a CharacterProfile,
        obstacles: Obstacles,
        scratch: &'a mut MoveScratch,
    ) -> Self {
        // On a slope, a capsule touches the ground beside its lowest point.
        let beside = profile.radius * (1.0 / libm::cosf(profile.max_slope) - 1.0);
        let lift = profile.step_height.max(beside).min(profile.least_height() - 2.0 * profile.radius).max(0.0);
        Self { map, profile, obstacles, torso: profile.torso(lift), lift, scratch }
    }

    /// Whether the character can walk between two neighbouring places in both directions: the ground is continuous,
    /// dry, nowhere too steep, and free of obstacles.
    fn leads(&mut self, a: Vec3, b: Vec3) -> bool {
        let (map, profile, offset) = (self.map, self.profile, b - a);
        let run = horizontal(offset);
        let slope = libm::tanf(profile.max_slope);
        if offset.y.abs() > run * slope + profile.step_height {
            return false;
        }
        let step = run / (INTERMEDIATE_COUNT + 1) as f32;
        let most = step * slope + profile.step_height + 0.02;
        let mut floors = [Vec3::ZERO; INTERMEDIATE_COUNT];
        let mut last = a.y;
        for (i, floor) in (1..).zip(&mut floors) {
            let above =
                a + offset * (i as f32 / (INTERMEDIATE_COUNT + 1) as f32) + Vec3::Y * room(profile, GROUND_BELOW_M);
            let Some(hit) = map.mesh().cast_ray(above, navigable::DOWN, 2.4) else { return false };
            let height = above.y - hit.distance;
            if !hit.surface.is_solid() || (height - last).abs() > most + 0.08 {
                return false;
            }
            last = height;
            *floor = above.with_y(height);
        }
        (b.y - last).abs() <= most + 0.08
            && is_open_between(map, profile, a, b)
            && (self.obstacles == Obstacles::OnLine || floors.into_iter().all(|floor| self.has_room(floor)))
    }

    /// Whether the body, above the steps that it can take, has room on a floor.
    fn has_room(&mut self, floor: Vec3) -> bool {
        is_clear(self.map.mesh(), &self.torso, floor + Vec3::Y * self.lift, SLOP_M, self.scratch)
    }
}

/// A height above the feet at which the survey looks, m, or the most at which a body that crouches has room.
fn room(profile: &CharacterProfile, height: f32) -> f32 {
    if profile.crouch_height > 0.0 { height.min(CROUCHED_SHARE * profile.crouch_height) } else { height }
}

/// Whether there is no obstacle between two places.
pub(super) fn is_open_between(map: &CollisionMap, profile: &CharacterProfile, a: Vec3, b: Vec3) -> bool {
    let offset = b - a;
    let length = offset.length().max(1.0e-3);
    CLEAR_HEIGHTS_M.iter().all(|&height| {
        let hit = map.mesh().cast_ray(a + Vec3::Y * room(profile, height), offset / length, length);
        hit.is_none_or(|hit| !hit.surface.is_solid())
    })
}
