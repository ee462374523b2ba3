//! What bodies find on a map, by its geometry.

use surefoot_world::reach::Reach;
use surefoot_world::{CharacterProfile, Map, Vec3};

/// What a body finds on a map.
#[derive(Debug, Clone)]
pub struct Survey {
    /// The body.
    pub body: CharacterProfile,
    /// Number of places where it can stand, on a grid of 1.25 m.
    pub places: usize,
    /// Number of islands of places that are connected on foot.
    pub islands: usize,
    /// Share of ordered pairs of places that are connected on foot, in [0, 1].
    pub connected_on_foot: f64,
    /// Share of ordered pairs of places that are connected by every means, in [0, 1].
    pub connected: f64,
    /// Number of places that cannot be reached from the largest region of places that lead to each other.
    pub cut_off_places: usize,
    /// Some of them, spread evenly, m.
    pub cut_off: Vec<Vec3>,
}

impl Survey {
    /// Surveys `map` for a body, on one thread, so that worlds keep stepping. Lists at most `max_cut_off` places.
    pub fn of(map: &Map, body: CharacterProfile, max_cut_off: usize) -> Self {
        let reach = Reach::survey(map, &body, 1);
        let regions = reach.regions(|_| true);
        let reached = regions.reachable_from(regions.largest());
        let is_cut_off = |island: u32| !reached[regions.of_island[island as usize] as usize];
        let cells = reach.ground.cells();
        let cut_off: Vec<Vec3> = cells.iter().filter(|cell| is_cut_off(cell.island)).map(|cell| cell.feet).collect();
        let stride = cut_off.len().div_ceil(max_cut_off.max(1)).max(1);
        Self {
            body,
            places: cells.len(),
            islands: reach.ground.islands().len(),
            connected_on_foot: if cells.is_empty() { 0.0 } else { reach.share_on_foot() },
            connected: reach.share_by(|_| true),
            cut_off_places: cut_off.len(),
            cut_off: cut_off.into_iter().step_by(stride).take(max_cut_off).collect(),
        }
    }
}
