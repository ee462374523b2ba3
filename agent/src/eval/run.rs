//! An evaluation: unit by unit, then summed up.

use super::config::{EvalConfig, EvalError};
use super::report::{self, Report};
use super::unit::{self, Unit};
use surefoot_policy::Policy;

/// Runs the protocol; `progress` gets the attempts finished and their total.
///
/// # Errors
/// If a map, its goals or a graph cannot be made, or a unit cannot be kept.
pub fn evaluate(policy: &Policy, config: &EvalConfig, progress: impl FnMut(usize, usize)) -> Result<Report, EvalError> {
    Ok(report::summarise(policy, config, &run_units(policy, config, progress)?))
}

/// The same, as the units themselves, map by map and seed by seed.
///
/// # Errors
/// As for [`evaluate`].
pub fn run_units(
    policy: &Policy,
    config: &EvalConfig,
    mut progress: impl FnMut(usize, usize),
) -> Result<Vec<Unit>, EvalError> {
    let total = config.maps.len() * config.seeds.len() * config.goals;
    let mut units = Vec::with_capacity(config.maps.len() * config.seeds.len());
    for spec in &config.maps {
        // Generated at the first unit that has to be run.
        let mut map = None;
        for &seed in &config.seeds {
            units.push(unit::load_or_run(policy, config, spec, seed, &mut map)?);
            progress(units.len() * config.goals, total);
        }
    }
    Ok(units)
}
