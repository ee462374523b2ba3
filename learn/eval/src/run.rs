//! Runs an evaluation unit by unit and summarises it.

use super::config::{EvalConfig, EvalError};
use super::maps::EvalMap;
use super::report::{self, Report};
use super::site;
use super::unit::Unit;
use surefoot_policy::Policy;

/// Runs an evaluation and returns its report. `progress` gets the numbers of finished and of all attempts.
///
/// # Errors
/// If goals cannot be drawn, a graph cannot be built, or a unit cannot be saved.
pub fn evaluate(policy: &Policy, config: &EvalConfig, progress: impl FnMut(usize, usize)) -> Result<Report, EvalError> {
    Ok(report::summarise(policy, config, &run_units(policy, config, progress)?))
}

/// The maps and seeds without a saved unit, map by map and seed by seed.
pub fn missing(policy: &Policy, config: &EvalConfig) -> Vec<(EvalMap, u64)> {
    let of_map = |choice| config.seeds.iter().map(move |&seed| (choice, seed));
    let all = config.maps.iter().flat_map(of_map);
    let missing = all.filter(|&(choice, seed)| !site::is_kept(policy, config, choice, seed));
    missing.map(|(choice, seed)| (choice.clone(), seed)).collect()
}

/// Like [`evaluate`], but returns the units, map by map and seed by seed.
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
    for choice in &config.maps {
        // Made for the first unit that is not loaded.
        let mut ground = None;
        for &seed in &config.seeds {
            units.push(site::load_or_run(policy, config, choice, seed, &mut ground)?);
            progress(units.len() * config.goals, total);
        }
    }
    Ok(units)
}
