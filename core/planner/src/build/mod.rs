//! The build of a graph: its stages in order, and their statistics.
//!
//! [`Builder::build`] places vertices ([`placement`]), selects candidate edges ([`candidates`]), probes them through a
//! [`probe::ProbeExecutor`] guided by a predictor, and keeps the edges that are proved. An [`interim`] graph shows the
//! result so far. `stitch` and `join` add what it takes to connect islands, and `cuts` probes again what nothing
//! replaces. Where probes are dear, [`Builder::build_rehearsed`] has a draft proved elsewhere; `confirm` proves again
//! what plans use of it.

mod builder;
pub mod candidates;
mod confirm;
mod cuts;
pub mod interim;
mod join;
pub mod placement;
mod predictor;
pub mod probe;
mod progress;
mod prove;
mod stitch;
mod ways;

pub use builder::Builder;
pub use predictor::is_perilous;
pub use progress::Progress;

use crate::evidence::Evidence;
use crate::graph::NavGraph;
use crate::grid::GrowingGrid;
use crate::needs::Needs;
use crate::ride_stops::RideStops;
use crate::settings::{BuildError, MAX_VERTICES, Placement, Probing, Site};
use candidates::Candidate;
use placement::PlacementContext;
use probe::ProbeExecutor;
use prove::Prover;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};
use std::sync::atomic::Ordering;
use surefoot_world::{Ability, MoverAt, Vec3};

/// A finished build.
#[derive(Debug, Clone)]
pub struct Built {
    /// The graph.
    pub graph: NavGraph,
    /// Statistics of the build.
    pub stats: BuildStats,
}

/// A finished build of which the draft was proved elsewhere.
#[derive(Debug, Clone)]
pub struct Rehearsed {
    /// The build.
    pub built: Built,
    /// Number of edges that are as in the draft.
    pub of_draft: u64,
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

impl<'a> Builder<'a> {
    /// Builds a graph.
    ///
    /// # Errors
    /// If the map has no navigable ground, its movers have too many ride stops, or `progress.cancel` was set.
    pub fn build(&self) -> Result<Built, BuildError> {
        self.build_in_stages(None).map(|done| done.built)
    }

    /// Builds a graph whose draft `rehearsal` proves. The executor proves again what plans use of it, all that connects
    /// islands, and what nothing replaces; exhaustive probing leaves the rehearsal out.
    ///
    /// # Errors
    /// Same as [`Self::build`].
    pub fn build_rehearsed(&self, rehearsal: &dyn ProbeExecutor) -> Result<Rehearsed, BuildError> {
        self.build_in_stages(Some(rehearsal).filter(|_| self.settings.probing == Probing::Frugal))
    }

    fn build_in_stages(&self, rehearsal: Option<&dyn ProbeExecutor>) -> Result<Rehearsed, BuildError> {
        let Self { site, settings, executor, progress, .. } = *self;
        let started_s = (self.clock)();
        let ride_stops = RideStops::on(&site.map, &site.profile);
        let (vertices, ride_stop_count) = (settings.vertices, ride_stops.places().len());
        if vertices + ride_stop_count > MAX_VERTICES {
            return Err(BuildError::TooManyRideStops { vertices, ride_stops: ride_stop_count });
        }
        let placing = PlacementContext { site, settings, ride_stops: &ride_stops, executor, progress };
        let draft = placement::place(&placing)?;
        progress.done.store(0, Ordering::Relaxed);
        let placing_s = (self.clock)() - started_s;
        let (candidates, special) = match draft.candidates {
            Some(candidates) => (candidates, 0),
            None => candidates::find(site, settings, &draft.vertices),
        };
        let mut probed = Probed::new(*self, &draft.vertices, candidates);
        if settings.placement == Placement::Trajectories {
            probed.evidence = probed.candidates.iter().map(|candidate| draft.seen[candidate]).collect();
        } else if let Some(rehearsal) = rehearsal {
            probed.builder.executor = rehearsal;
            self.probe(&mut probed)?;
            probed.builder.executor = executor;
            confirm::confirm(&mut probed)?;
        } else {
            self.probe(&mut probed)?;
        }
        let seconds = (self.clock)() - started_s;
        let stats = BuildStats {
            candidates: probed.candidates.len() as u64,
            special,
            untried: untried(&probed.evidence),
            probes: draft.episodes + progress.done.load(Ordering::Relaxed),
            placing_s,
            probing_s: seconds - placing_s,
            seconds,
        };
        let graph = probed.graph();
        let of_draft = graph.edges().filter(|edge| probed.draft_index(edge.key).is_some()).count() as u64;
        Ok(Rehearsed { built: Built { graph, stats }, of_draft })
    }

    /// Probes the candidates, and adds candidates where islands are left.
    fn probe(&self, probed: &mut Probed<'_>) -> Result<(), BuildError> {
        let (prover, evidence) = probed.prover();
        *evidence = prover.run(self.settings.probing)?;
        probed.try_ride_stops()?;
        if self.settings.probing == Probing::Frugal {
            if self.settings.special_moves {
                stitch::stitch(probed)?;
            }
            join::join_islands(probed)?;
            cuts::prove_cuts(probed)?;
            let (prover, evidence) = probed.prover();
            prover.prove_on_foot(evidence)?;
            prover.expect_deaths(evidence)?;
            cuts::keep_lifelines(probed);
        }
        Ok(())
    }

    /// Prepares the probing of `candidates` between `vertices`.
    pub(crate) fn prover<'b>(&self, vertices: &'b [Vec3], candidates: &'b [Candidate]) -> Prover<'b>
    where
        'a: 'b,
    {
        let ride_stops = RideStops::on(&self.site.map, &self.site.profile).of_vertices(vertices);
        Prover { builder: *self, vertices, candidates, ride_stops: Cow::Owned(ride_stops) }
    }
}

/// What a build has so far.
pub(crate) struct Probed<'a> {
    builder: Builder<'a>,
    /// The vertices.
    pub places: GrowingGrid,
    /// The ride stop of each vertex. Vertices that are added after the placement keep clear of movers: they are beyond
    /// the end.
    ride_stops: Vec<Option<MoverAt>>,
    /// Candidate edges.
    pub candidates: Vec<Candidate>,
    /// Evidence of each candidate.
    pub evidence: Vec<Evidence>,
    index: HashMap<Candidate, u32>,
    /// Indices of the candidates that stay although they succeed too rarely to be proved.
    lifelines: BTreeSet<u32>,
    /// Indices of the candidates whose evidence comes from a draft.
    of_draft: BTreeSet<u32>,
}

impl<'a> Probed<'a> {
    fn new(builder: Builder<'a>, vertices: &[Vec3], candidates: Vec<Candidate>) -> Self {
        let Site { map, profile } = builder.site;
        let places = GrowingGrid::new(map.extent(), placement::even_spacing(map, vertices.len()), vertices);
        let ride_stops = RideStops::on(map, profile).of_vertices(vertices);
        let index = candidates.iter().copied().zip(0..).collect();
        let (evidence, [lifelines, of_draft]) = (Vec::new(), Default::default());
        Self { builder, places, ride_stops, candidates, evidence, index, lifelines, of_draft }
    }

    /// The map and the character.
    pub fn site(&self) -> &'a Site {
        self.builder.site
    }

    /// Number of threads for work other than probing.
    pub fn thread_count(&self) -> usize {
        self.builder.thread_count
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
    pub fn graph(&self) -> NavGraph {
        let is_chosen = |idx: usize| self.is_proved(idx) || self.lifelines.contains(&(idx as u32));
        let graph = NavGraph::choose(self.vertices().to_vec(), &self.candidates, &self.evidence, is_chosen);
        graph.with_moves(self.builder.site.profile.moves.clone())
    }

    fn is_proved(&self, candidate: usize) -> bool {
        self.evidence[candidate].proves(self.builder.settings.threshold)
    }

    /// Makes all evidence that of a draft: candidates that it does not prove have none any more, but what it expects of
    /// them.
    pub fn doubt(&mut self) {
        self.lifelines.clear();
        let is_kept =
            |idx: &u32| self.is_proved(*idx as usize) && self.evidence[*idx as usize].needs == Needs::default();
        let all = 0..self.candidates.len() as u32;
        let lost: Vec<u32> = all.clone().filter(|idx| !is_kept(idx)).collect();
        self.of_draft = all.collect();
        lost.into_iter().for_each(|idx| self.doubt_edge(idx));
    }

    /// Drops the evidence that comes from a draft of edges with this ability.
    pub fn doubt_ability(&mut self, ability: Ability) {
        let is_doubted = |idx: &u32| self.evidence[*idx as usize].ability == ability;
        let doubted: Vec<u32> = self.of_draft.iter().copied().filter(is_doubted).collect();
        doubted.into_iter().for_each(|idx| self.doubt_edge(idx));
    }

    /// Drops the evidence of a candidate if it comes from a draft.
    fn doubt_edge(&mut self, idx: u32) {
        if self.of_draft.remove(&idx) {
            let own = &mut self.evidence[idx as usize];
            *own = own.as_prior();
        }
    }

    /// The index of a candidate whose evidence comes from a draft.
    pub fn draft_index(&self, key: Candidate) -> Option<u32> {
        self.index.get(&key).copied().filter(|idx| self.of_draft.contains(idx))
    }

    /// Probes each listed candidate once per listing.
    pub fn try_once_each(&mut self, which: &[u32]) -> Result<(), BuildError> {
        which.iter().for_each(|&idx| self.doubt_edge(idx));
        let (prover, evidence) = self.prover();
        prover.try_once_each(which, evidence)
    }

    /// Probes on the run those of the listed candidates beside which a miss is fatal.
    pub fn prove_on_the_run(&mut self, which: impl IntoIterator<Item = u32>) -> Result<(), BuildError> {
        let (prover, evidence) = self.prover();
        prover.prove_on_the_run(&which.into_iter().collect::<Vec<u32>>(), evidence)
    }

    /// Probes all edges to and from ride stops, which the predictor cannot judge: once, and again up to the number of
    /// repeats if the first probe succeeds.
    fn try_ride_stops(&mut self) -> Result<(), BuildError> {
        let is_on_mover = |key: &Candidate| [key.from, key.to].iter().any(|end| self.ride_stops[end.idx()].is_some());
        let on_movers: Vec<u32> =
            (0..).zip(&self.candidates).filter(|(_, key)| is_on_mover(key)).map(|(idx, _)| idx).collect();
        for repeat in 0..self.builder.settings.repeats {
            let is_due = |idx: &u32| {
                let own = &self.evidence[*idx as usize];
                own.tries == repeat && (repeat == 0 || own.successes > 0)
            };
            let due: Vec<u32> = on_movers.iter().copied().filter(is_due).collect();
            self.try_once_each(&due)?;
        }
        Ok(())
    }

    fn prover(&mut self) -> (Prover<'_>, &mut Vec<Evidence>) {
        let (vertices, candidates) = (self.places.points(), &self.candidates);
        let ride_stops = Cow::Borrowed(&self.ride_stops[..]);
        (Prover { builder: self.builder, vertices, candidates, ride_stops }, &mut self.evidence)
    }
}

/// Returns the number of candidate edges that were never probed.
pub(crate) fn untried(evidence: &[Evidence]) -> u64 {
    evidence.iter().filter(|evidence| evidence.tries == 0).count() as u64
}
