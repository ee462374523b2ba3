//! The square tiles of built maps.

use surefoot_world::Vec3;

/// Square tiles that fit into a map.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tiles {
    /// Side of a tile, m.
    pub(super) pitch: f32,
    /// Numbers of columns and rows.
    pub(super) counts: [usize; 2],
    /// Corner of the first tile, m.
    pub(super) corner: [f32; 2],
}

impl Tiles {
    /// Column and row of each tile, row by row.
    pub(super) fn all(self) -> impl Iterator<Item = [usize; 2]> {
        (0..self.counts[1]).flat_map(move |row| (0..self.counts[0]).map(move |column| [column, row]))
    }

    /// Middle of a tile at height 0, m.
    pub(super) fn middle(self, tile: [usize; 2]) -> Vec3 {
        let [x, z] = [0, 1].map(|axis| self.corner[axis] + (tile[axis] as f32 + 0.5) * self.pitch);
        Vec3::new(x, 0.0, z)
    }

    /// Index of the tile so many columns and rows from another in the order of [`all`](Self::all), if there is one.
    pub(super) fn beside(self, tile: [usize; 2], steps: [isize; 2]) -> Option<usize> {
        let at = |axis: usize| tile[axis].checked_add_signed(steps[axis]).filter(|it| *it < self.counts[axis]);
        Some(at(1)? * self.counts[0] + at(0)?)
    }
}
