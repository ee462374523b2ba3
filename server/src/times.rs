//! A histogram of tick durations, fine enough for percentiles of a whole run.

use std::time::Duration;

/// Number of buckets; the last one holds all longer ticks.
pub const BUCKETS: usize = 68;
/// Buckets per doubling of the duration.
const PER_OCTAVE: f64 = 4.0;
/// Upper bound of the first bucket, us.
const FIRST_US: f64 = 10.0;

/// Counts of ticks by duration. Bucket `i` counts ticks below `2^(i/4) x 10 us` that no bucket before it counts.
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
    /// Creates a histogram from counts as [`TickTimes::counts`] returns them; missing counts are 0. The total is
    /// estimated from the bounds.
    pub fn from_counts(counts: &[u64]) -> Self {
        let mut times = Self::default();
        times.counts.iter_mut().zip(counts).for_each(|(count, given)| *count = *given);
        times.total_us = (0..BUCKETS).map(|idx| times.counts[idx] * Self::bound(idx).as_micros() as u64).sum();
        times
    }

    /// Returns the upper bound of a bucket. The value for the last bucket is not a bound of its ticks.
    pub fn bound(idx: usize) -> Duration {
        Duration::from_secs_f64(FIRST_US * 1.0e-6 * f64::powf(2.0, idx as f64 / PER_OCTAVE))
    }

    /// Counts a tick that took `took`.
    pub fn note(&mut self, took: Duration) {
        let us = took.as_secs_f64() * 1.0e6;
        let idx = if us < FIRST_US { 0 } else { ((us / FIRST_US).log2() * PER_OCTAVE) as usize + 1 };
        self.counts[idx.min(BUCKETS - 1)] += 1;
        self.total_us += us as u64;
    }

    /// Returns the number of ticks in each bucket.
    pub fn counts(&self) -> &[u64; BUCKETS] {
        &self.counts
    }

    /// Returns the number of all ticks.
    pub fn count(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Returns the sum of all durations.
    pub fn total(&self) -> Duration {
        Duration::from_micros(self.total_us)
    }

    /// Returns the number of ticks below `limit`, rounded down to the bound of a bucket.
    pub fn below(&self, limit: Duration) -> u64 {
        (0..BUCKETS - 1).take_while(|&idx| Self::bound(idx) <= limit).map(|idx| self.counts[idx]).sum()
    }

    /// Returns the bound below which a share of ticks (0 to 1) stays, us; 0 if there are no ticks.
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

    /// Returns the ticks counted since `before`, an earlier copy of this histogram.
    pub fn since(&self, before: &Self) -> Self {
        let mut times = self.clone();
        times.counts.iter_mut().zip(before.counts).for_each(|(count, old)| *count = count.saturating_sub(old));
        times.total_us = self.total_us.saturating_sub(before.total_us);
        times
    }
}
