//! How the duration of work grows with its size. Each case is timed at n, 2n and 4n, and the exponent of a power law is
//! fitted to the three times. Quadratic work has the exponent 2.

mod core;
mod planner;
mod service;

use super::{Figure, line_through, median, timed, timed_with};

/// Largest allowed exponent. Sorting and cache misses explain values above 1.
const MAX_EXPONENT: f64 = 1.2;
/// How often each size is timed; the median counts.
const ROUNDS: usize = 3;

/// Work whose size can be chosen.
struct Case {
    name: &'static str,
    /// Unit of the size.
    of: &'static str,
    /// The smallest of the three sizes.
    size: usize,
    /// Prepares the work of this size, and returns the time that it takes, s.
    seconds: Box<dyn FnMut(usize) -> anyhow::Result<f64>>,
}

impl Case {
    fn new(
        name: &'static str,
        of: &'static str,
        size: usize,
        seconds: impl FnMut(usize) -> anyhow::Result<f64> + 'static,
    ) -> Self {
        Self { name, of, size, seconds: Box::new(seconds) }
    }

    fn figures(mut self) -> anyhow::Result<Vec<Figure>> {
        let Self { name, of, size, .. } = self;
        let mut points = Vec::new();
        let mut figures = Vec::new();
        for count in [size, 2 * size, 4 * size] {
            let times = (0..ROUNDS).map(|_| (self.seconds)(count)).collect::<anyhow::Result<_>>()?;
            let seconds = median(times);
            points.push([(count as f64).ln(), seconds.ln()]);
            figures.push(Figure::new(format!("{name}_{count}_ms"), 1.0e3 * seconds, "ms").on(of));
        }
        let exponent = Figure::new(format!("{name}_exponent"), line_through(&points)[1], "");
        figures.push(exponent.at_most(MAX_EXPONENT).on(of));
        Ok(figures)
    }
}

/// All figures of `bench growth`.
pub fn figures() -> anyhow::Result<Vec<Figure>> {
    let mut figures = Vec::new();
    for case in core::cases().into_iter().chain(planner::cases()).chain(service::cases()?) {
        let name = case.name;
        figures.extend(case.figures()?);
        // A run takes minutes, so each exponent is shown as soon as it is known.
        eprintln!("{name}: {:.2}", figures.last().map_or(f64::NAN, |exponent: &Figure| exponent.value));
    }
    Ok(figures)
}
