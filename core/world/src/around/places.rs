//! Places to stand and the steps between them, on a grid. A map keeps what searches have found.

use crate::Vec3;
use crate::arrival::Place;
use crate::character::{CharacterProfile, MoveScratch, is_clear};
use crate::map::Map;
use crate::map::standing::{Columns, STEP_COUNT, Standing};
use crate::movers::Movers;
use crate::navigable::floors;

/// Distance between two columns of the grid, m.
pub(super) const CELL_M: f32 = 0.5;
/// Room that a body keeps to walls besides its radius, as a share of its radius.
const ROOM: f32 = 0.25;
/// Height above the ground at which a body is tried, m: a capsule on a slope touches beside its lowest point.
const LIFT_M: f32 = 0.12;
/// Difference in height up to which the end of a step is the place of its column, m.
const SAME_M: f32 = 0.25;
/// The steps from a place, in columns.
pub(super) const STEPS: [(i32, i32); STEP_COUNT] =
    [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)];

/// A place of the grid: its column, and its number in it, from top to bottom.
pub(super) type PlaceId = ((i32, i32), u8);

/// The places of a map for one body. Searches find the same places in any order.
pub(super) struct Places<'a> {
    place: Place<'a>,
    columns: &'a mut Columns,
    scratch: MoveScratch,
}

/// Calls a function with the places of `map` for a body.
pub(super) fn on<T>(map: &Map, profile: &CharacterProfile, search: impl FnOnce(&mut Places<'_>) -> T) -> T {
    let shape = [profile.height, profile.radius, profile.max_slope, profile.step_height].map(f32::to_bits);
    let place = Place { map, movers: &Movers::default(), profile };
    let search = |columns: &mut Columns| search(&mut Places { place, columns, scratch: MoveScratch::default() });
    map.places().with(shape, search)
}

impl Places<'_> {
    /// The places around `from`, m, to which a body could walk straight from there, and where they are.
    pub fn around(&mut self, from: Vec3) -> Vec<(PlaceId, Vec3)> {
        let column = [from.x, from.z].map(|at| (at / CELL_M).round() as i32);
        let mut found = Vec::new();
        for (x, z) in [(0, 0)].into_iter().chain(STEPS) {
            let cell = (column[0] + x, column[1] + z);
            for idx in 0..self.column(cell).len() as u8 {
                let feet = self.feet((cell, idx));
                let offset = (feet - from).with_y(0.0);
                let (walked, end) = self.place.walkable(from, offset);
                if walked >= offset.length() && (end.y - feet.y).abs() <= SAME_M && self.has_room(end, offset) {
                    found.push(((cell, idx), feet));
                }
            }
        }
        found
    }

    /// The place to which a step leads, and where it is; `None` if a body cannot walk there.
    pub fn step(&mut self, (cell, idx): PlaceId, step: usize) -> Option<(PlaceId, Vec3)> {
        let (x, z) = STEPS[step];
        let next = (cell.0 + x, cell.1 + z);
        let standing = self.column(cell)[usize::from(idx)];
        let led = standing.steps[step].unwrap_or_else(|| {
            let led = self.try_step(standing.feet, Vec3::new(x as f32, 0.0, z as f32) * CELL_M, next);
            self.column(cell)[usize::from(idx)].steps[step] = Some(led);
            led
        });
        led.map(|idx| ((next, idx), self.feet((next, idx))))
    }

    fn try_step(&mut self, from: Vec3, step: Vec3, next: (i32, i32)) -> Option<u8> {
        let (walked, end) = self.place.walkable(from, step);
        if walked < step.length() || !self.has_room(end, step) {
            return None;
        }
        let height = |standing: &Standing| (standing.feet.y - end.y).abs();
        let column = self.column(next);
        let nearest = (0..column.len()).min_by(|a, b| height(&column[*a]).total_cmp(&height(&column[*b])))?;
        (height(&column[nearest]) <= SAME_M).then_some(nearest as u8)
    }

    /// Whether a body that comes along `step` has room on both sides.
    fn has_room(&mut self, feet: Vec3, step: Vec3) -> bool {
        let Place { map, profile, .. } = self.place;
        let room = step.normalize_or_zero().cross(Vec3::Y) * (ROOM * profile.radius);
        let up = feet + Vec3::Y * LIFT_M;
        [up + room, up - room].into_iter().all(|feet| is_clear(map.mesh(), profile, feet, 0.02, &mut self.scratch))
    }

    fn feet(&mut self, (cell, idx): PlaceId) -> Vec3 {
        self.column(cell)[usize::from(idx)].feet
    }

    /// The places of a column, from top to bottom.
    fn column(&mut self, cell: (i32, i32)) -> &mut Vec<Standing> {
        let Place { map, profile, .. } = self.place;
        self.columns.entry(cell).or_insert_with(|| {
            let [x, z] = [cell.0, cell.1].map(|at| at as f32 * CELL_M);
            let (floors, count) = floors(map, profile, x, z);
            floors[..count]
                .iter()
                .map(|(at, _)| Standing { feet: Vec3::new(x, at.y, z), steps: [None; STEP_COUNT] })
                .collect()
        })
    }
}
