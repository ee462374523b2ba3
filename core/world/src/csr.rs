//! Compressed sparse rows: lists of items, one list for each row, in a single array.

use std::ops::Range;

/// Items by row; the rows count from 0.
#[derive(Debug, Clone)]
pub struct Csr<T> {
    /// First item of each row, followed by the number of items.
    starts: Vec<u32>,
    items: Vec<T>,
}

impl<T> Default for Csr<T> {
    fn default() -> Self {
        Self { starts: vec![0], items: Vec::new() }
    }
}

impl<T: Copy> Csr<T> {
    /// Groups items by their row. The items of a row keep their order.
    pub fn group(row_count: usize, items: impl Iterator<Item = (usize, T)> + Clone) -> Self {
        let mut starts = vec![0_u32; row_count + 1];
        items.clone().for_each(|(row, _)| starts[row + 1] += 1);
        (0..row_count).for_each(|row| starts[row + 1] += starts[row]);
        let mut next = starts.clone();
        let mut grouped: Vec<T> = items.clone().map(|(_, item)| item).collect();
        for (row, item) in items {
            grouped[next[row] as usize] = item;
            next[row] += 1;
        }
        Self { starts, items: grouped }
    }
}

impl<T> Csr<T> {
    /// Appends a row.
    pub fn push_row(&mut self, row: impl IntoIterator<Item = T>) {
        self.items.extend(row);
        self.starts.push(u32::try_from(self.items.len()).expect("rows hold fewer than 2^32 items"));
    }

    /// Number of rows.
    pub fn row_count(&self) -> usize {
        self.starts.len() - 1
    }

    /// Iterates over all rows.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[T]> + Clone {
        (0..self.row_count()).map(|row| self.row(row))
    }

    /// The items of a row.
    pub fn row(&self, row: usize) -> &[T] {
        &self.items[self.range(row)]
    }

    /// The items of a row, to change them.
    pub fn row_mut(&mut self, row: usize) -> &mut [T] {
        let range = self.range(row);
        &mut self.items[range]
    }

    /// The items of a row as a range of [`items`](Self::items).
    pub fn range(&self, row: usize) -> Range<usize> {
        self.starts[row] as usize..self.starts[row + 1] as usize
    }

    /// All items, row by row.
    pub fn items(&self) -> &[T] {
        &self.items
    }

    /// Size in memory, bytes.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(&self.starts[..]) + size_of_val(&self.items[..])
    }
}

impl<T> FromIterator<Vec<T>> for Csr<T> {
    fn from_iter<R: IntoIterator<Item = Vec<T>>>(rows: R) -> Self {
        let mut csr = Self::default();
        rows.into_iter().for_each(|row| csr.push_row(row));
        csr
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_are_grouped_by_row_in_their_order() {
        let csr = Csr::group(4, [(2, 'a'), (0, 'b'), (2, 'c'), (3, 'd')].into_iter());
        let rows: Vec<&[char]> = csr.rows().collect();
        assert_eq!(rows, [&['b'][..], &[], &['a', 'c'], &['d']]);
        let pushed: Csr<char> = rows.iter().map(|row| row.to_vec()).collect();
        assert_eq!((pushed.rows().collect::<Vec<_>>(), pushed.range(2)), (rows, 1..3));
    }
}
