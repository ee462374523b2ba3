//! A whole build: stages in a row, with their statistics.
//!
//! [`Builder::build`] reads top to bottom: place vertices, find candidates, prove them, keep what holds.

use crate::candidates::{self, Candidate};
use crate::evidence::Evidence;
use crate::graph::NavGraph;
use crate::placement::{self, Placing};
use crate::probe::ProbeExecutor;
use crate::prove::Proving;
use crate::settings::{BuildError, BuildSettings, Placement};
use crate::site::Site;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use surefoot_world::Vec3;

/// A finished build.
#[derive(Debug, Clone)]
pub struct Built {
    /// The graph.
    pub graph: NavGraph,
    /// What it took.
    pub stats: BuildStats,
}

/// What a build took, stage by stage.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct BuildStats {
    /// Candidates.
    pub candidates: u64,
    /// Those of them that come from devices and ledges.
    pub special: u64,
    /// Candidates that were never tried.
    pub untried: u64,
    /// Episodes run, those of the placement included.
    pub probes: u64,
    /// Time to place vertices, s.
    pub placing_s: f64,
    /// Time to probe, s.
    pub probing_s: f64,
    /// Time of the whole build, s.
    pub seconds: f64,
}

/// Progress of a build, shared with its watchers.
#[derive(Debug, Default)]
pub struct Progress {
    /// Probes finished.
    pub done: AtomicU64,
    /// Probes that are known to be needed; grows while a build finds out more, 0 while vertices are placed.
    pub total: AtomicU64,
    /// Set to stop.
    pub cancel: AtomicBool,
}

/// What builds and updates graphs.
#[derive(Clone, Copy)]
pub struct Builder<'a> {
    /// The map and the character.
    pub site: &'a Site,
    /// What is built.
    pub settings: &'a BuildSettings,
    /// Runs the probes.
    pub executor: &'a dyn ProbeExecutor,
    /// Threads for what is not probing.
    pub thread_count: usize,
    /// Seconds since some fixed moment, for the statistics: this crate has no clock of its own.
    pub clock: &'a dyn Fn() -> f64,
    /// Where the build stands.
    pub progress: &'a Progress,
}

impl Builder<'_> {
    /// Builds a graph.
    ///
    /// # Errors
    /// If the map has no ground, or `progress.cancel` was set.
    pub fn build(&self) -> Result<Built, BuildError> {
        let started_s = (self.clock)();
        let draft = placement::place(&self.placing())?;
        self.progress.done.store(0, Ordering::Relaxed);
        let placing_s = (self.clock)() - started_s;
        let (candidates, special) = match draft.candidates {
            Some(candidates) => (candidates, 0),
            None => find_candidates(self.site, self.settings, &draft.vertices),
        };
        let tests_edges = self.settings.placement != Placement::Trajectories;
        let evidence: Vec<Evidence> = if tests_edges {
            let proving = self.proving(&draft.vertices, &candidates);
            proving.run(self.settings.probing).ok_or(BuildError::Cancelled)?
        } else {
            candidates.iter().map(|candidate| draft.seen[candidate]).collect()
        };
        let seconds = (self.clock)() - started_s;
        let stats = BuildStats {
            candidates: candidates.len() as u64,
            special,
            untried: untried(&evidence),
            probes: draft.episodes + self.progress.done.load(Ordering::Relaxed),
            placing_s,
            probing_s: seconds - placing_s,
            seconds,
        };
        let graph = NavGraph::prove(draft.vertices, &candidates, &evidence, self.settings.threshold);
        Ok(Built { graph, stats })
    }

    fn placing(&self) -> Placing<'_> {
        let Self { site, settings, executor, progress, .. } = *self;
        Placing { site, settings, executor, progress: &progress.done, cancel: &progress.cancel }
    }

    /// What it takes to prove `candidates` between `vertices`.
    pub(crate) fn proving<'b>(&'b self, vertices: &'b [Vec3], candidates: &'b [Candidate]) -> Proving<'b> {
        Proving {
            map: &self.site.map,
            vertices,
            candidates,
            repeats: self.settings.repeats,
            seed: self.settings.seed,
            thread_count: self.thread_count,
            executor: self.executor,
            progress: &self.progress.done,
            total: &self.progress.total,
            cancel: &self.progress.cancel,
        }
    }
}

/// How many candidates were never tried.
pub(crate) fn untried(evidence: &[Evidence]) -> u64 {
    evidence.iter().filter(|evidence| evidence.tries == 0).count() as u64
}

/// Each vertex's nearest and, if asked for, what devices and ledges join; and how many the latter are.
pub fn find_candidates(site: &Site, settings: &BuildSettings, vertices: &[Vec3]) -> (Vec<Candidate>, u64) {
    let mut candidates = candidates::nearest(vertices, settings.neighbours);
    if !settings.special_moves {
        return (candidates, 0);
    }
    let mut known = candidates.clone();
    known.sort_unstable();
    let special = candidates::by_features(&site.map, &site.profile, vertices, &known);
    candidates.extend(&special);
    (candidates, special.len() as u64)
}
