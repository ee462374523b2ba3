//! Which of many items are joined, directly or through others.

/// Disjoint sets of numbers (Tarjan 1975, with path halving).
pub(super) struct Joined {
    parents: Vec<u32>,
}

impl Joined {
    /// `count` items, none of which are joined.
    pub(super) fn new(count: usize) -> Self {
        Self { parents: (0..count as u32).collect() }
    }

    /// The item that stands for all that are joined to `item`.
    pub(super) fn root(&mut self, mut item: u32) -> u32 {
        while self.parents[item as usize] != item {
            let above = self.parents[self.parents[item as usize] as usize];
            self.parents[item as usize] = above;
            item = above;
        }
        item
    }

    pub(super) fn join(&mut self, one: u32, other: u32) {
        let (one, other) = (self.root(one), self.root(other));
        self.parents[other.max(one) as usize] = one.min(other);
    }
}
