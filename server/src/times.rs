//! How long ticks took, in buckets that are fine enough for percentiles of a whole run.

use std::time::Duration;

/// Buckets; the last one holds whatever is longer.
pub const BUCKETS: usize = 68;
/// Bounds per doubling.
const PER_OCTAVE: f64 = 4.0;
/// Bound of the first bucket, us.
const FIRST_US: f64 = 10.0;

/// Counts of ticks by duration. Bucket `i` holds those below `2^(i/4) x 10 us` that no bucket before holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TickTimes {
    counts: [u64; BUCKETS],
    total_us: u64,
}

impl Default for TickTimes {
    fn default() -> Self {
        Self { counts: [0; BUCKETS], total_us: 0 }
    }
}

impl TickTimes {
    /// From counts as [`TickTimes::counts`] gives them; missing ones are 0. The sum is estimated from the bounds.
    pub fn from_counts(counts: &[u64]) -> Self {
        let mut times = Self::default();
        times.counts.iter_mut().zip(counts).for_each(|(count, given)| *count = *given);
        times.total_us = (0..BUCKETS).map(|idx| times.counts[idx] * Self::bound(idx).as_micros() as u64).sum();
        times
    }

    /// Upper bound of a bucket; the last one has none.
    pub fn bound(idx: usize) -> Duration {
        Duration::from_secs_f64(FIRST_US * 1.0e-6 * f64::powf(2.0, idx as f64 / PER_OCTAVE))
    }

    /// Adds a tick.
    pub fn note(&mut self, took: Duration) {
        let us = took.as_secs_f64() * 1.0e6;
        let idx = if us < FIRST_US { 0 } else { ((us / FIRST_US).log2() * PER_OCTAVE) as usize + 1 };
        self.counts[idx.min(BUCKETS - 1)] += 1;
        self.total_us += us as u64;
    }

    /// Ticks by bucket.
    pub fn counts(&self) -> &[u64; BUCKETS] {
        &self.counts
    }

    /// Ticks in all.
    pub fn count(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Their durations added up.
    pub fn total(&self) -> Duration {
        Duration::from_micros(self.total_us)
    }

    /// Ticks that took less than `limit`, rounded down to a bucket's bound.
    pub fn below(&self, limit: Duration) -> u64 {
        (0..BUCKETS - 1).take_while(|&idx| Self::bound(idx) <= limit).map(|idx| self.counts[idx]).sum()
    }

    /// The bound that this share of ticks stays below, in us; 0 without ticks.
    pub fn quantile_us(&self, share: f64) -> f32 {
        let wanted = (self.count() as f64 * share).ceil().max(1.0) as u64;
        let mut seen = 0;
        for (idx, count) in self.counts.iter().enumerate() {
            seen += count;
            if seen >= wanted {
                return Self::bound(idx).as_secs_f32() * 1.0e6;
            }
        }
        0.0
    }

    /// What came after `before` was taken.
    pub fn since(&self, before: &Self) -> Self {
        let mut times = self.clone();
        times.counts.iter_mut().zip(before.counts).for_each(|(count, old)| *count = count.saturating_sub(old));
        times.total_us = self.total_us.saturating_sub(before.total_us);
        times
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_duration_lies_below_the_bound_of_its_bucket_and_not_below_the_one_before() {
        for us in [0.0, 9.9, 10.1, 11.9, 12.0, 999.0, 16_667.0, 40_000.0, 600_000.0] {
            let took = Duration::from_secs_f64(us * 1.0e-6);
            let mut times = TickTimes::default();
            times.note(took);
            let idx = times.counts().iter().position(|count| *count == 1).unwrap();
            assert!(took < TickTimes::bound(idx), "{us} us in bucket {idx}");
            assert!(idx == 0 || took >= TickTimes::bound(idx - 1), "{us} us in bucket {idx}");
        }
    }

    #[test]
    fn quantiles_are_at_most_a_bucket_too_high() {
        let mut times = TickTimes::default();
        (1..=1000).for_each(|us| times.note(Duration::from_micros(us * 10)));
        for (share, exact) in [(0.5, 5000.0), (0.99, 9900.0)] {
            let found = times.quantile_us(share);
            assert!((exact..exact * 1.2).contains(&found), "{share}: {found}");
        }
        assert_eq!(times.count(), 1000);
        assert_eq!(TickTimes::default().quantile_us(0.99), 0.0);
    }
}
