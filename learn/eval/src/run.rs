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
pub fn run_units(
    policy: &Policy,
    config: &EvalConfig,
    mut progress: impl FnMut(usize, usize),
) -> Result<Vec<Unit>, EvalError> {
    let (mut done, total) = (0, config.maps.len() * config.seeds.len() * config.goals);
    let units = run_cases(&[(policy, config)], || {
        done += config.goals;
        progress(done, total);
    })?;
    Ok(units.into_iter().flatten().collect())
}

/// Runs all cases on the maps and seeds of the first, map by map and seed by seed, so that they share surveys and
/// graphs. Returns the units of each case. Calls `finished` after each unit.
pub(crate) fn run_cases(
    cases: &[(&Policy, &EvalConfig)],
    mut finished: impl FnMut(),
) -> Result<Vec<Vec<Unit>>, EvalError> {
    let Some((_, EvalConfig { maps, seeds, .. })) = cases.first() else { return Ok(Vec::new()) };
    let mut units = vec![Vec::new(); cases.len()];
    for choice in maps {
        // Made for the first unit that is not loaded.
        let mut ground = None;
        for &seed in seeds {
            for ((policy, config), units) in cases.iter().zip(&mut units) {
                units.push(site::load_or_run(policy, config, choice, seed, &mut ground)?);
                finished();
            }
        }
    }
    Ok(units)
}
