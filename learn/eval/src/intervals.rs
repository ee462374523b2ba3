//! Intervals over maps and models.
//!
//! Goals of one map are no independent draws: what makes a map hard makes all its goals hard. So maps are resampled,
//! not goals, and with several models of different training seeds the models as well.

use super::maps::MapName;
use super::unit::Unit;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use surefoot_world::End;

/// Number of resamples; the bounds are their percentiles 2.5 and 97.5.
const RESAMPLES: usize = 4000;

/// A share of successes, or a difference of two, with its 95 % bootstrap interval over maps and models.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// Mean over all maps and models, 0 to 1.
    pub mean: f64,
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
    /// Standard deviation between maps, models averaged.
    pub between_maps: f64,
    /// Standard deviation between models, maps averaged; absent with one model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub between_models: Option<f64>,
    /// Number of maps.
    pub maps: usize,
    /// Number of models.
    pub models: usize,
}

impl Interval {
    /// The success of one model; `None` with fewer than two maps.
    pub fn of(units: &[Unit]) -> Option<Self> {
        Self::of_models(&[units])
    }

    /// The success of several models on the same maps; `None` with fewer than two maps.
    pub fn of_models(models: &[&[Unit]]) -> Option<Self> {
        let maps = maps_of(models.first()?);
        Self::bootstrap(&models.iter().map(|units| rates(units, &maps)).collect::<Vec<_>>())
    }

    /// How much more `units` succeed than `others` on the same maps; `None` with fewer than two maps.
    pub fn of_difference(units: &[Unit], others: &[Unit]) -> Option<Self> {
        let maps = maps_of(units);
        let pairs = rates(units, &maps).into_iter().zip(rates(others, &maps));
        Self::bootstrap(&[pairs.map(|(one, other)| one - other).collect::<Vec<_>>()])
    }

    /// The mean of a table with one row for each model and one column for each map.
    fn bootstrap(table: &[Vec<f64>]) -> Option<Self> {
        let (models, maps) = (table.len(), table.first()?.len());
        if maps < 2 {
            return None;
        }
        let mean_of = |rows: &[usize], columns: &[usize]| {
            let sum: f64 = rows.iter().map(|row| columns.iter().map(|column| table[*row][*column]).sum::<f64>()).sum();
            sum / (rows.len() * columns.len()) as f64
        };
        let (all_models, all_maps): (Vec<usize>, Vec<usize>) = ((0..models).collect(), (0..maps).collect());
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let mut draw = |count: usize| (0..count).map(|_| rng.random_range(0..count)).collect::<Vec<usize>>();
        let mut means: Vec<f64> = (0..RESAMPLES).map(|_| mean_of(&draw(models), &draw(maps))).collect();
        means.sort_unstable_by(f64::total_cmp);
        let percentile = |share: f64| means[(share * (RESAMPLES - 1) as f64).round() as usize];
        let by_map: Vec<f64> = all_maps.iter().map(|map| mean_of(&all_models, &[*map])).collect();
        let by_model: Vec<f64> = all_models.iter().map(|model| mean_of(&[*model], &all_maps)).collect();
        Some(Self {
            mean: mean_of(&all_models, &all_maps),
            low: percentile(0.025),
            high: percentile(0.975),
            between_maps: deviation(&by_map),
            between_models: (models > 1).then(|| deviation(&by_model)),
            maps,
            models,
        })
    }

    /// Mean and bounds in percent, such as `97.1 (96.2 to 97.9)`.
    pub fn percent(&self) -> String {
        format!("{:.1} ({:.1} to {:.1})", 100.0 * self.mean, 100.0 * self.low, 100.0 * self.high)
    }

    /// Mean and bounds in points, such as `+1.2 (+0.4 to +1.9)`.
    pub fn points(&self) -> String {
        format!("{:+.1} ({:+.1} to {:+.1})", 100.0 * self.mean, 100.0 * self.low, 100.0 * self.high)
    }
}

fn maps_of(units: &[Unit]) -> Vec<MapName> {
    let mut maps = Vec::new();
    for unit in units {
        if !maps.contains(&unit.map) {
            maps.push(unit.map.clone());
        }
    }
    maps
}

/// Share of successes on each of these maps.
fn rates(units: &[Unit], maps: &[MapName]) -> Vec<f64> {
    let of = |map: &MapName| {
        let ends = || units.iter().filter(|unit| unit.map == *map).flat_map(|unit| &unit.attempts).map(|it| it.end);
        ends().filter(|end| *end == End::Reached).count() as f64 / ends().count().max(1) as f64
    };
    maps.iter().map(of).collect()
}

/// Sample standard deviation.
fn deviation(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
    (squares / (values.len() as f64 - 1.0).max(1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_is_that_of_maps_and_not_of_goals() {
        // Ten maps, on half of which everything succeeds.
        let table = vec![(0..10).map(|map| f64::from(map % 2)).collect::<Vec<_>>()];
        let it = Interval::bootstrap(&table).unwrap();
        assert!((it.mean - 0.5).abs() < 1.0e-12 && it.low <= 0.2 && it.high >= 0.8, "{it:?}");
        assert!((it.between_maps - (10.0f64 * 0.25 / 9.0).sqrt()).abs() < 1.0e-12);
        assert_eq!(it.between_models, None);
        let even = Interval::bootstrap(&[vec![0.7; 10]]).unwrap();
        assert!((even.low - 0.7).abs() < 1.0e-12 && (even.high - 0.7).abs() < 1.0e-12);
        assert_eq!(Interval::bootstrap(&[vec![0.7]]), None);
    }

    #[test]
    fn models_that_differ_widen_the_interval() {
        let maps = |rate: f64| vec![rate; 20];
        let alike = Interval::bootstrap(&[maps(0.9), maps(0.9), maps(0.9)]).unwrap();
        let different = Interval::bootstrap(&[maps(0.8), maps(0.9), maps(1.0)]).unwrap();
        assert!(different.high - different.low > 0.1 && alike.high - alike.low < 1.0e-9);
        assert!((different.between_models.unwrap() - 0.1).abs() < 1.0e-9 && different.between_maps < 1.0e-9);
    }
}
