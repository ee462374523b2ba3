//! The index of bodies through which NPCs see others. The first observation after a tick builds it.

use crate::Vec3;
use crate::cells::CellKey;
use crate::sense::Other;
use crate::slot::BodySlot;
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// Side of a cell, m.
const CELL_M: f32 = 8.0;

/// Bodies by cell, in no order within a cell.
#[derive(Debug, Default)]
pub(crate) struct Neighbours {
    /// Empty until the first observation.
    listed: OnceLock<BTreeMap<CellKey, Vec<(BodySlot, Other)>>>,
}

impl Neighbours {
    /// Drops the index, because every body may have moved.
    pub fn forget(&mut self) {
        self.listed.take();
    }

    /// Adds a body that has appeared or moved.
    pub fn add(&mut self, body: BodySlot, other: Other) {
        if let Some(listed) = self.listed.get_mut() {
            listed.entry(CellKey::at(other.feet, CELL_M)).or_default().push((body, other));
        }
    }

    /// Removes a body from its cell.
    pub fn remove(&mut self, body: BodySlot, other: Other) {
        let cell = CellKey::at(other.feet, CELL_M);
        if let Some(cell) = self.listed.get_mut().and_then(|listed| listed.get_mut(&cell)) {
            cell.retain(|(listed, _)| *listed != body);
        }
    }

    /// All bodies within a horizontal distance of `reach`, m, and some farther ones, in no order. `bodies` are all
    /// bodies of the world.
    pub fn around(
        &self,
        place: Vec3,
        reach: f32,
        bodies: impl Iterator<Item = (BodySlot, Other)>,
    ) -> impl Iterator<Item = (BodySlot, Other)> {
        let listed = self.listed.get_or_init(|| {
            let mut listed: BTreeMap<CellKey, Vec<_>> = BTreeMap::new();
            bodies.for_each(|it| listed.entry(CellKey::at(it.1.feet, CELL_M)).or_default().push(it));
            listed
        });
        let reach = Vec3::new(reach, 0.0, reach);
        let [low, high] = [place - reach, place + reach].map(|corner| CellKey::at(corner, CELL_M));
        let columns = CellKey::rectangle(low, high);
        columns.flat_map(|rows| listed.range(rows)).flat_map(|(_, bodies)| bodies).copied()
    }
}
