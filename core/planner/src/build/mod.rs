//! The build of a graph: its stages in order, and their statistics.
//!
//! [`Builder::build`] places vertices, finds candidate edges, probes them, and keeps those that are proved.

pub mod candidates;
pub mod interim;
mod join;
pub mod placement;
mod predictor;
pub mod probe;
mod progress;
mod prove;
mod stitch;
mod ways;

pub use predictor::is_perilous;
pub use progress::Progress;

use crate::build::candidates::Candidate;
use crate::build::placement::PlacementContext;
use crate::build::probe::ProbeExecutor;
use crate::build::prove::ProbeRun;
use crate::evidence::Evidence;
use crate::graph::NavGraph;
use crate::grid::GrowingGrid;
use crate::needs::Ride;
use crate::ride_stops::RideStops;
use crate::settings::Site;
use crate::settings::{BuildError, BuildSettings, MAX_VERTICES, Placement, Probing};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};
use std::sync::atomic::Ordering;
use surefoot_world::{MoverAt, Vec3};

/// A finished build.
#[derive(Debug, Clone)]
pub struct Built {
    /// The graph.
    pub graph: NavGraph,
    /// Statistics of the build.
    pub stats: BuildStats,
}

/// Statistics of a build.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct BuildStats {
    /// Number of candidate edges.
    pub candidates: u64,
    /// Candidate edges that come from devices and ledges.
    pub special: u64,
    /// Candidate edges that were never probed.
    pub untried: u64,
    /// Number of episodes that were run, including those of the placement.
    pub probes: u64,
    /// Time spent on placing vertices, s.
    pub placing_s: f64,
    /// Time spent on finding candidate edges and probing them, s.
    pub probing_s: f64,
    /// Duration of the whole build, s.
    pub seconds: f64,
}

/// What a build has so far.
#[derive(Debug)]
pub(crate) struct Probed {
    /// The vertices.
    pub places: GrowingGrid,
    /// The ride_stop of each vertex; vertices that are added to those that were placed keep clear of movers.
    pub ride_stops: Vec<Option<MoverAt>>,
    /// Candidate edges.
    pub candidates: Vec<Candidate>,
    /// Evidence of each candidate.
    pub evidence: Vec<Evidence>,
    index: HashMap<Candidate, u32>,
}

impl Probed {
    fn new(
        places: GrowingGrid,
        ride_stops: Vec<Option<MoverAt>>,
        candidates: Vec<Candidate>,
        evidence: Vec<Evidence>,
    ) -> Self {
        let index = candidates.iter().copied().zip(0..).collect();
        Self { places, ride_stops, candidates, evidence, index }
    }

    /// Positions of the vertices, m.
    pub fn vertices(&self) -> &[Vec3] {
        self.places.points()
    }

    /// The index of a candidate, which is added with that prior if it is new.
    pub fn index_of(&mut self, key: Candidate, prior: f32) -> u32 {
        *self.index.entry(key).or_insert_with(|| {
            self.candidates.push(key);
            self.evidence.push(Evidence::with_prior(prior));
            self.candidates.len() as u32 - 1
        })
    }

    /// Number of probes of a candidate.
    pub fn tries(&self, key: Candidate) -> u32 {
        self.index.get(&key).map_or(0, |&idx| self.evidence[idx as usize].tries)
    }

    /// The graph that is proved so far.
    pub fn graph(&self, threshold: f64) -> NavGraph {
        NavGraph::prove(self.vertices().to_vec(), &self.candidates, &self.evidence, threshold)
    }
}

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

impl Builder<'_> {
    /// Builds a graph.
    ///
    /// # Errors
    /// If the map has no navigable ground, its movers have too many ride_stops, or `progress.cancel` was set.
    pub fn build(&self) -> Result<Built, BuildError> {
        let started_s = (self.clock)();
        let ride_stops = RideStops::on(&self.site.map, &self.site.profile);
        let (vertices, ride_stop_count) = (self.settings.vertices, ride_stops.places().len());
        if vertices + ride_stop_count > MAX_VERTICES {
            return Err(BuildError::TooManyRideStops { vertices, ride_stops: ride_stop_count });
        }
        let draft = placement::place(&self.placing(&ride_stops))?;
        self.progress.done.store(0, Ordering::Relaxed);
        let placing_s = (self.clock)() - started_s;
        let (candidates, special) = match draft.candidates {
            Some(candidates) => (candidates, 0),
            None => find_candidates(self.site, self.settings, &draft.vertices),
        };
        let probes_edges = self.settings.placement != Placement::Trajectories;
        let ride_stops = ride_stops.of_vertices(&draft.vertices);
        let evidence: Vec<Evidence> = if probes_edges {
            let proving = self.proving_with(&ride_stops, &draft.vertices, &candidates);
            proving.run(self.settings.probing).ok_or(BuildError::Cancelled)?
        } else {
            candidates.iter().map(|candidate| draft.seen[candidate]).collect()
        };
        let spacing = placement::even_spacing(&self.site.map, draft.vertices.len());
        let places = GrowingGrid::new(self.site.map.extent(), spacing, &draft.vertices);
        let mut probed = Probed::new(places, ride_stops, candidates, evidence);
        if probes_edges {
            self.try_ride_stops(&mut probed)?;
        }
        if probes_edges && self.settings.probing == Probing::Frugal {
            if self.settings.special_moves {
                self.stitch(&mut probed)?;
            }
            self.join_islands(&mut probed)?;
            let proving = self.proving_with(&probed.ride_stops, probed.places.points(), &probed.candidates);
            proving.prove_on_foot(&mut probed.evidence, self.settings.threshold).ok_or(BuildError::Cancelled)?;
            proving.expect_deaths(&mut probed.evidence).ok_or(BuildError::Cancelled)?;
        }
        let seconds = (self.clock)() - started_s;
        let stats = BuildStats {
            candidates: probed.candidates.len() as u64,
            special,
            untried: untried(&probed.evidence),
            probes: draft.episodes + self.progress.done.load(Ordering::Relaxed),
            placing_s,
            probing_s: seconds - placing_s,
            seconds,
        };
        Ok(Built { graph: probed.graph(self.settings.threshold), stats })
    }

    fn placing<'b>(&'b self, ride_stops: &'b RideStops) -> PlacementContext<'b> {
        let Self { site, settings, executor, progress, .. } = *self;
        PlacementContext { site, settings, ride_stops, executor, progress }
    }

    /// Probes all edges of ride_stops, of which the predictor knows nothing: once, and again as often as others where they fail at first.
    fn try_ride_stops(&self, probed: &mut Probed) -> Result<(), BuildError> {
        let is_on_mover = |key: &Candidate| [key.from, key.to].iter().any(|end| probed.ride_stops[end.idx()].is_some());
        let on_movers: Vec<u32> =
            (0..).zip(&probed.candidates).filter(|(_, key)| is_on_mover(key)).map(|(idx, _)| idx).collect();
        for repeat in 0..self.settings.repeats {
            let is_due = |idx: &u32| {
                let own = &probed.evidence[*idx as usize];
                own.tries == repeat && (repeat == 0 || own.successes > 0)
            };
            let due: Vec<u32> = on_movers.iter().copied().filter(is_due).collect();
            self.try_once_each(&due, probed)?;
        }
        Ok(())
    }

    /// Probes each listed candidate once per listing.
    pub(crate) fn try_once_each(&self, which: &[u32], probed: &mut Probed) -> Result<(), BuildError> {
        let proving = self.proving_with(&probed.ride_stops, probed.places.points(), &probed.candidates);
        proving.try_once_each(which, &mut probed.evidence).ok_or(BuildError::Cancelled)
    }

    /// Probes those of the listed candidates on the run beside which a miss is fatal.
    pub(crate) fn prove_on_the_run(&self, which: BTreeSet<u32>, probed: &mut Probed) -> Result<(), BuildError> {
        let which: Vec<u32> = which.into_iter().collect();
        let proving = self.proving_with(&probed.ride_stops, probed.places.points(), &probed.candidates);
        proving.prove_on_the_run(&which, &mut probed.evidence).ok_or(BuildError::Cancelled)
    }

    /// Prepares the probing of `candidates` between `vertices`.
    pub(crate) fn proving<'b>(&'b self, vertices: &'b [Vec3], candidates: &'b [Candidate]) -> ProbeRun<'b> {
        let ride_stops = RideStops::on(&self.site.map, &self.site.profile).of_vertices(vertices);
        ProbeRun { ride_stops: Cow::Owned(ride_stops), ..self.proving_with(&[], vertices, candidates) }
    }

    /// Prepares the probing of `candidates` between `vertices`, of which the first have these ride_stops and the others none.
    fn proving_with<'b>(
        &'b self,
        ride_stops: &'b [Option<MoverAt>],
        vertices: &'b [Vec3],
        candidates: &'b [Candidate],
    ) -> ProbeRun<'b> {
        ProbeRun {
            map: &self.site.map,
            vertices,
            candidates,
            ride_stops: Cow::Borrowed(ride_stops),
            repeats: self.settings.repeats,
            seed: self.settings.seed,
            thread_count: self.thread_count,
            executor: self.executor,
            progress: self.progress,
        }
    }
}

/// Returns the number of candidate edges that were never probed.
pub(crate) fn untried(evidence: &[Evidence]) -> u64 {
    evidence.iter().filter(|evidence| evidence.tries == 0).count() as u64
}

/// Finds the candidate edges from each vertex to its nearest neighbours and, if the settings include special moves, those at
/// devices and ledges. Also returns the number of the latter.
pub fn find_candidates(site: &Site, settings: &BuildSettings, vertices: &[Vec3]) -> (Vec<Candidate>, u64) {
    find_candidates_of(0..vertices.len() as u32, site, settings, vertices)
}

/// The same with the nearest neighbours of some vertices only.
pub(crate) fn find_candidates_of(
    some: impl Iterator<Item = u32>,
    site: &Site,
    settings: &BuildSettings,
    vertices: &[Vec3],
) -> (Vec<Candidate>, u64) {
    let mut candidates = candidates::nearest_of(some, vertices, settings.neighbours);
    let ride_stops = RideStops::on(&site.map, &site.profile).of_vertices(vertices);
    if ride_stops.iter().any(Option::is_some) {
        // Nobody leaps from one mover to another.
        candidates.retain(|key| match (ride_stops[key.from.idx()], ride_stops[key.to.idx()]) {
            (Some(from), Some(to)) => Ride::between(from, to).is_some(),
            _ => true,
        });
        let mut known = candidates.clone();
        known.sort_unstable();
        candidates.extend(candidates::by_ride_stops(&ride_stops, vertices, &known));
    }
    if !settings.special_moves {
        return (candidates, 0);
    }
    let mut known = candidates.clone();
    known.sort_unstable();
    let special = candidates::by_features(&site.map, &site.profile, vertices, &known);
    candidates.extend(&special);
    (candidates, special.len() as u64)
}
