//! Places to stand on a map, and the steps between them, which searches for walks have found.

use crate::Vec3;
use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

/// Most columns that are kept for a body, about 100 bytes each.
const MAX_COLUMNS: usize = 100_000;
/// Most bodies for which places are kept.
const MAX_BODIES: usize = 8;
/// Steps from a place.
pub(crate) const STEP_COUNT: usize = 8;

/// The places of a map that searches have found, for each body.
#[derive(Debug, Default)]
pub(crate) struct KeptPlaces(Mutex<Vec<(Shape, Columns)>>);

/// What of a body decides where it stands and steps: bits of its height, radius, steepest slope and step height.
pub(crate) type Shape = [u32; 4];

/// The places of each column of a grid, from top to bottom.
pub(crate) type Columns = HashMap<(i32, i32), Vec<Standing>>;

/// A place to stand.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Standing {
    /// m.
    pub feet: Vec3,
    /// For each step, the number of the place that it reaches in the next column. The outer `None` is an untried step.
    pub steps: [Option<Option<u8>>; STEP_COUNT],
}

impl KeptPlaces {
    /// Calls a function with the places for a body.
    pub fn with<T>(&self, shape: Shape, search: impl FnOnce(&mut Columns) -> T) -> T {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let idx = kept.iter().position(|(other, _)| *other == shape).unwrap_or_else(|| {
            if kept.len() >= MAX_BODIES {
                kept.remove(0);
            }
            kept.push((shape, Columns::new()));
            kept.len() - 1
        });
        let columns = &mut kept[idx].1;
        if columns.len() > MAX_COLUMNS {
            columns.clear();
        }
        search(columns)
    }
}
