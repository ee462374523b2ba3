//! What links connect: the share of pairs of places between which there is a path.

use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Shares of the ordered pairs of different vertices on the NavMesh between which a path leads, in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Connected {
    /// On the NavMesh alone.
    pub without: f64,
    /// With the links.
    pub with: f64,
}

impl Connected {
    /// Counts pairs of vertices, of which each is on an island or off the NavMesh. Each of `joins` leads from an island to another one; those
    /// that begin or end on none do not count.
    pub fn of(islands: &[Option<u32>], joins: impl Iterator<Item = (Option<u32>, Option<u32>)>) -> Self {
        let mut sizes: BTreeMap<u32, u64> = BTreeMap::new();
        islands.iter().flatten().for_each(|island| *sizes.entry(*island).or_default() += 1);
        let mut exits: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
        for (from, to) in joins.filter_map(|(from, to)| from.zip(to)) {
            exits.entry(from).or_default().insert(to);
        }
        let count: u64 = sizes.values().sum();
        let pairs = (count * count.saturating_sub(1)).max(1) as f64;
        let reached = |exits: &BTreeMap<u32, BTreeSet<u32>>| {
            let from = |(&island, &size): (&u32, &u64)| {
                let there: u64 = reached_from(island, exits).iter().filter_map(|island| sizes.get(island)).sum();
                size * (there - 1)
            };
            sizes.iter().map(from).sum::<u64>() as f64 / pairs
        };
        Self { without: reached(&BTreeMap::new()), with: reached(&exits) }
    }
}

/// The islands to which exits lead from one, and itself.
fn reached_from(island: u32, exits: &BTreeMap<u32, BTreeSet<u32>>) -> BTreeSet<u32> {
    let mut reached = BTreeSet::from([island]);
    let mut open = vec![island];
    while let Some(island) = open.pop() {
        let next = exits.get(&island).into_iter().flatten();
        open.extend(next.filter(|next| reached.insert(**next)));
    }
    reached
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_ordered_and_links_lead_one_way() {
        let islands = [Some(0), Some(0), Some(7), None];
        let alone = Connected::of(&islands, std::iter::empty());
        assert!((alone.without - 2.0 / 6.0).abs() < 1.0e-12 && alone.with == alone.without);
        let down = Connected::of(&islands, [(Some(0), Some(7)), (None, Some(0))].into_iter());
        assert!((down.with - 4.0 / 6.0).abs() < 1.0e-12);
        let both = Connected::of(&islands, [(Some(0), Some(5)), (Some(5), Some(7)), (Some(7), Some(0))].into_iter());
        assert_eq!(both.with, 1.0, "an island without vertices may lie between");
        assert_eq!(Connected::of(&[None], std::iter::empty()), Connected::default());
    }
}
