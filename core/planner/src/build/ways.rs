//! The ways that the survey finds: walks over its cells and links between its islands, and the shortest of them between
//! vertices.

use crate::search::frontier::Frontier;
use crate::settings::Site;
use std::cmp::Reverse;
use surefoot_world::Vec3;
use surefoot_world::character::MoveScratch;
use surefoot_world::csr::Csr;
use surefoot_world::reach::Reach;
use surefoot_world::reach::ground::{Ground, NEIGHBOURS, SPACING_M};

/// Factor on the length of a step between cells if one of them is at an edge or a wall.
const BORDER_WEIGHT: f32 = 2.0;
/// Length that is added to the distance between the ends of a link, m.
const LINK_M: f32 = 8.0;

/// The cells of a survey as a directed graph.
#[derive(Debug)]
pub(crate) struct Ways<'a> {
    site: &'a Site,
    ground: &'a Ground,
    /// For each cell, the cells to which it leads and how far they are, m.
    exits: Csr<(u32, f32)>,
    /// For each cell, the cells that lead to it and how far they are, m.
    entrances: Csr<(u32, f32)>,
}

/// For each cell, the nearest vertex in one direction, how far it is, and the next cell towards it.
#[derive(Debug)]
pub(crate) struct Nearest {
    vertex: Vec<Option<u32>>,
    frontier: Frontier<f32>,
    next: Vec<Option<u32>>,
}

/// A way from one vertex to another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Way {
    /// Index of the first vertex.
    pub from: u32,
    /// Index of the last vertex.
    pub to: u32,
    /// The last cell that is nearest to `from`, and the next cell of the way.
    pub border: (u32, u32),
    /// Weighted length, m.
    pub length_m: f32,
}

impl<'a> Ways<'a> {
    pub fn new(site: &'a Site, reach: &'a Reach) -> Self {
        let ground = &reach.ground;
        let cells = ground.cells();
        let directions = 0..NEIGHBOURS.len();
        let is_border: Vec<bool> =
            (0..cells.len()).map(|cell| !directions.clone().all(|to| ground.walks_to(cell, to))).collect();
        let steps = (0..cells.len()).flat_map(|cell| {
            let is_border = &is_border;
            directions.clone().filter_map(move |to| ground.neighbour(cell, to)).map(move |to| {
                let weight = if is_border[cell] || is_border[to] { BORDER_WEIGHT } else { 1.0 };
                (cell, (to as u32, weight * cells[cell].feet.distance(cells[to].feet)))
            })
        });
        let links = reach.links.iter().map(|link| {
            let (from, to) = (cells[link.takeoff as usize].feet, cells[link.landing as usize].feet);
            (link.takeoff as usize, (link.landing, LINK_M + from.distance(to)))
        });
        let exits = Csr::group(cells.len(), steps.chain(links));
        let arcs = (0..).zip(exits.rows()).flat_map(|(from, row)| row.iter().map(move |arc| (from, arc)));
        let entrances = Csr::group(cells.len(), arcs.map(|(from, &(to, length))| (to as usize, (from, length))));
        Self { site, ground, exits, entrances }
    }

    /// The cell to which a walk leads from each vertex, if there is one.
    pub fn cells_of(&self, vertices: &[Vec3]) -> Vec<Option<usize>> {
        let (Site { map, profile }, mut scratch) = (self.site, MoveScratch::default());
        vertices.iter().map(|&feet| self.ground.walk_from(map, profile, feet, &mut scratch)).collect()
    }

    /// Finds for each cell the vertex, by its cell, with the shortest way to it.
    pub fn nearest_before(&self, vertices: &[Option<usize>]) -> Nearest {
        self.spread(vertices, &self.exits)
    }

    /// Finds for each cell the vertex, by its cell, with the shortest way from it.
    pub fn nearest_after(&self, vertices: &[Option<usize>]) -> Nearest {
        self.spread(vertices, &self.entrances)
    }

    fn spread(&self, vertices: &[Option<usize>], exits: &Csr<(u32, f32)>) -> Nearest {
        let count = self.ground.cells().len();
        let mut frontier = Frontier::new(count);
        let (mut nearest_vertex, mut next) = (vec![None; count], vec![None; count]);
        for (vertex, &cell) in (0..).zip(vertices) {
            if let Some(cell) = cell
                && frontier.offer(cell as u32, 0.0)
            {
                nearest_vertex[cell] = Some(vertex);
            }
        }
        while let Some((cell, so_far)) = frontier.settle(f32::INFINITY) {
            for &(to, length) in exits.row(cell as usize) {
                if frontier.offer(to, so_far + length) {
                    nearest_vertex[to as usize] = nearest_vertex[cell as usize];
                    next[to as usize] = Some(cell);
                }
            }
        }
        Nearest { vertex: nearest_vertex, frontier, next }
    }

    /// The ways between vertices whose surroundings meet, in the order of their cells.
    pub fn meetings<'b>(&'b self, before: &'b Nearest, after: &'b Nearest) -> impl Iterator<Item = Way> + 'b {
        (0..).zip(self.exits.rows()).flat_map(move |(cell, targets): (u32, _)| {
            targets.iter().filter_map(move |&(next, length)| {
                let (from, to) = before.vertex[cell as usize].zip(after.vertex[next as usize])?;
                let length_m = before.frontier.cost(cell) + length + after.frontier.cost(next);
                (from != to).then_some(Way { from, to, border: (cell, next), length_m })
            })
        })
    }

    /// Splits a way into legs, each with the cells that it passes. The ends of a leg are at most `leg_m` apart and
    /// joined by a straight walk, or the leg is a single step or leap.
    pub fn legs(&self, way: &Way, before: &Nearest, after: &Nearest, leg_m: f32) -> Vec<Vec<u32>> {
        let mut cells: Vec<u32> = trace(way.border.0, &before.next);
        cells.reverse();
        cells.extend(trace(way.border.1, &after.next));
        let mut legs = Vec::new();
        let mut here = 0;
        while here + 1 < cells.len() {
            let is_leg = |&to: &usize| {
                self.feet(cells[here]).distance(self.feet(cells[to])) <= leg_m
                    && self.walks_straight(cells[here], cells[to])
            };
            let next = (here + 2..cells.len()).rev().find(is_leg).unwrap_or(here + 1);
            legs.push(cells[here..=next].to_vec());
            here = next;
        }
        legs
    }

    /// Position of the feet on a cell, m.
    pub fn feet(&self, cell: u32) -> Vec3 {
        self.ground.cells()[cell as usize].feet
    }

    /// Lengthens the steps of a leg that failed, so that other ways are preferred.
    pub fn discourage(&mut self, leg: &[u32]) {
        /// Factor on the length of each step.
        const FACTOR: f32 = 4.0;
        for step in leg.windows(2) {
            let ends = [(step[0], step[1]), (step[1], step[0])];
            for ((from, to), arcs) in ends.into_iter().zip([&mut self.exits, &mut self.entrances]) {
                arcs.row_mut(from as usize).iter_mut().filter(|arc| arc.0 == to).for_each(|arc| arc.1 *= FACTOR);
            }
        }
    }

    /// Places without a straight walk from any of `vertices`. Each is chosen to have straight walks from many other
    /// such places. The iterator ends when only few are left.
    pub fn uncovered<'b>(&'b self, vertices: &[Vec3], reach_m: f32) -> impl Iterator<Item = Vec3> + 'b {
        /// Places that are compared before one is chosen.
        const CHOICES: usize = 24;
        /// Fewest places that a chosen place must cover.
        const FEWEST: usize = 6;
        let mut is_covered = vec![false; self.ground.cells().len()];
        for cell in self.cells_of(vertices).into_iter().flatten() {
            self.covered_from(cell, reach_m).for_each(|idx| is_covered[idx] = true);
        }
        std::iter::from_fn(move || {
            let open: Vec<usize> = (0..is_covered.len()).filter(|&cell| !is_covered[cell]).collect();
            let count = |cell: usize| self.covered_from(cell, reach_m).filter(|&idx| !is_covered[idx]).count();
            let choices = open.iter().step_by(open.len().div_ceil(CHOICES).max(1));
            let (count, best) =
                choices.map(|&cell| (count(cell), cell)).max_by_key(|&(count, cell)| (count, Reverse(cell)))?;
            self.covered_from(best, reach_m).for_each(|idx| is_covered[idx] = true);
            (count >= FEWEST).then(|| self.ground.cells()[best].feet)
        })
    }

    /// The cells within `reach_m` to which a straight walk leads from `cell`, itself included.
    fn covered_from(&self, cell: usize, reach_m: f32) -> impl Iterator<Item = usize> {
        let feet = self.ground.cells()[cell].feet;
        self.ground
            .around(feet, (reach_m / SPACING_M) as i32)
            .filter(move |&idx| self.ground.cells()[idx].feet.distance(feet) <= reach_m)
            .filter(move |&idx| self.walks_straight(cell as u32, idx as u32))
    }

    /// Whether a straight walk leads from one cell to another.
    fn walks_straight(&self, from: u32, to: u32) -> bool {
        let feet = |cell: usize| self.ground.cells()[cell].feet;
        let ((column, row), (last_column, last_row)) =
            (self.ground.column_of(feet(from as usize)), self.ground.column_of(feet(to as usize)));
        let (columns, rows) = (last_column - column, last_row - row);
        let steps = columns.abs().max(rows.abs());
        let (mut cell, mut place) = (from as usize, (column, row));
        for step in 1..=steps {
            let part = |total: i32| (total as f32 * step as f32 / steps as f32).round() as i32;
            let next = (column + part(columns), row + part(rows));
            let direction = (next.0 - place.0, next.1 - place.1);
            let neighbour = NEIGHBOURS.iter().position(|&it| it == direction);
            let Some(reached) = neighbour.and_then(|neighbour| self.ground.neighbour(cell, neighbour)) else {
                return false;
            };
            (cell, place) = (reached, next);
        }
        cell == to as usize
    }
}

/// The cells from `cell` to a vertex.
fn trace(cell: u32, next: &[Option<u32>]) -> Vec<u32> {
    std::iter::successors(Some(cell), |&cell| next[cell as usize]).collect()
}
