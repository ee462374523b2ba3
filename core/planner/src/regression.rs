//! Small ridge regressions: the normal equations are solved by Gaussian elimination.

/// Weight of the ridge penalty, in samples.
const RIDGE: f64 = 1.0;
/// Maximum number of Newton steps of a logistic fit.
const NEWTON_STEPS: usize = 12;

/// Linear least squares on `N` features.
#[derive(Debug, Clone)]
pub struct Linear<const N: usize> {
    products: [[f64; N]; N],
    targets: [f64; N],
}

impl<const N: usize> Default for Linear<N> {
    fn default() -> Self {
        Self { products: [[0.0; N]; N], targets: [0.0; N] }
    }
}

impl<const N: usize> Linear<N> {
    /// Adds a sample.
    pub fn add(&mut self, features: [f64; N], target: f64) {
        for (row, (x, sum)) in self.products.iter_mut().zip(features.iter().zip(&mut self.targets)) {
            row.iter_mut().zip(&features).for_each(|(product, y)| *product += x * y);
            *sum += x * target;
        }
    }

    /// Returns the coefficients.
    pub fn fit(&self) -> [f64; N] {
        let mut products = self.products;
        (0..N).for_each(|idx| products[idx][idx] += RIDGE);
        solve(products, self.targets)
    }
}

/// Logistic regression on `N` features, the first of which is constant.
#[derive(Debug, Clone)]
pub struct Logistic<const N: usize> {
    /// Features, number of successes, number of failures.
    samples: Vec<([f64; N], f64, f64)>,
}

impl<const N: usize> Default for Logistic<N> {
    fn default() -> Self {
        Self { samples: Vec::new() }
    }
}

impl<const N: usize> Logistic<N> {
    /// Adds a sample with its numbers of successes and failures.
    pub fn add(&mut self, features: [f64; N], successes: f64, failures: f64) {
        self.samples.push((features, successes, failures));
    }

    /// Returns the coefficients of the log-odds of success, by Newton's method on the likelihood with a ridge penalty.
    pub fn fit(&self) -> [f64; N] {
        let mut weights = [0.0; N];
        for _ in 0..NEWTON_STEPS {
            let mut curvature = [[0.0; N]; N];
            let mut slope = [0.0; N];
            for (features, successes, failures) in &self.samples {
                let count = successes + failures;
                let chance = sigmoid(dot(&weights, features));
                let (error, weight) = (successes - count * chance, (count * chance * (1.0 - chance)).max(1.0e-9));
                for (row, (x, slope)) in curvature.iter_mut().zip(features.iter().zip(&mut slope)) {
                    row.iter_mut().zip(features).for_each(|(value, y)| *value += weight * x * y);
                    *slope += error * x;
                }
            }
            for idx in 0..N {
                curvature[idx][idx] += RIDGE;
                slope[idx] -= RIDGE * weights[idx];
            }
            let step = solve(curvature, slope);
            // Steps are limited, because long ones overshoot where classes hardly overlap.
            let length = step.iter().map(|value| value * value).sum::<f64>().sqrt();
            let scale = (4.0 / length.max(4.0)).min(1.0);
            weights.iter_mut().zip(step).for_each(|(weight, step)| *weight += scale * step);
            if length < 1.0e-6 {
                break;
            }
        }
        weights
    }
}

/// The logistic function.
pub fn sigmoid(value: f64) -> f64 {
    1.0 / (1.0 + libm::exp(-value))
}

/// Returns the scalar product.
pub fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Solves a positive definite system of linear equations.
fn solve<const N: usize>(mut rows: [[f64; N]; N], mut values: [f64; N]) -> [f64; N] {
    for pivot in 0..N {
        let best = (pivot..N).max_by(|&a, &b| rows[a][pivot].abs().total_cmp(&rows[b][pivot].abs())).unwrap_or(pivot);
        rows.swap(pivot, best);
        values.swap(pivot, best);
        let (pivot_row, pivot_value) = (rows[pivot], values[pivot]);
        for (row, value) in rows.iter_mut().zip(&mut values).skip(pivot + 1) {
            let factor = row[pivot] / pivot_row[pivot];
            row.iter_mut().zip(&pivot_row).for_each(|(cell, above)| *cell -= factor * above);
            *value -= factor * pivot_value;
        }
    }
    let mut solution = [0.0; N];
    for row in (0..N).rev() {
        let known: f64 = (row + 1..N).map(|column| rows[row][column] * solution[column]).sum();
        solution[row] = (values[row] - known) / rows[row][row];
    }
    solution
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_fit_recovers_its_coefficients() {
        let mut fit = Linear::<3>::default();
        for idx in 0..2000 {
            let (x, y) = (f64::from(idx % 37) / 7.0, f64::from(idx % 11) / 3.0);
            fit.add([1.0, x, y], 4.0 - 2.0 * x + 0.5 * y);
        }
        let found = fit.fit();
        for (value, expected) in found.iter().zip([4.0, -2.0, 0.5]) {
            assert!((value - expected).abs() < 0.02, "{found:?}");
        }
    }

    #[test]
    fn a_logistic_fit_recovers_its_coefficients_even_where_classes_hardly_overlap() {
        for slope in [1.5, 12.0] {
            let mut fit = Logistic::<2>::default();
            for idx in -200..=200 {
                let x = f64::from(idx) / 50.0;
                let chance = sigmoid(0.5 + slope * x);
                fit.add([1.0, x], 5000.0 * chance, 5000.0 * (1.0 - chance));
            }
            let found = fit.fit();
            assert!((found[0] - 0.5).abs() < 0.1 && (found[1] / slope - 1.0).abs() < 0.05, "{slope}: {found:?}");
        }
    }
}
