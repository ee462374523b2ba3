//! What a build needs: the site, the settings, and the executor of probes.

use super::probe::ProbeExecutor;
use super::progress::Progress;
use crate::settings::{BuildSettings, Site};

/// Builds and updates graphs.
#[derive(Clone, Copy)]
pub struct Builder<'a> {
    /// The map and the character.
    pub site: &'a Site,
    /// Settings of the build.
    pub settings: &'a BuildSettings,
    /// Runs the probes.
    pub executor: &'a dyn ProbeExecutor,
    /// Number of threads for work other than probing.
    pub thread_count: usize,
    /// Returns the seconds since some fixed moment, for the statistics; this crate has no clock of its own.
    pub clock: &'a dyn Fn() -> f64,
    /// Progress of the build.
    pub progress: &'a Progress,
}
