//! Probes candidate edges: all of them with all repeats, as in the paper, or only with as many probes as are needed.
//!
//! Frugal probing proceeds in rounds, each with a predictor fitted to the rounds before. The nearest third of each
//! vertex's candidates is probed once, then the middle third, then the farthest. The later rounds omit two kinds of
//! candidates: hopeless ones, which are expected to fail, and needless ones, which no plan would use because proved
//! edges already lead to the same vertex for less. A hopeless candidate is probed after all if no proved edges lead
//! from its one end to the other. Finally, candidates with an outcome that the predictor did not clearly expect are
//! probed again, up to the number of repeats in the settings.
//!
//! Where a miss is fatal, beside a void or lava, edges are then probed as NPCs with a plan use them: on the run, from a
//! preceding edge.

use super::builder::Builder;
use super::candidates::Candidate;
use super::predictor::{Geometry, Predictor, is_perilous, measure};
use super::probe::{EdgeRun, Manner, Outcome, ProbeWatch, Trial};
use super::progress::Progress;
use crate::evidence::Evidence;
use crate::graph::NavGraph;
use crate::ids::{EdgeKey, VertexId};
use crate::legs::{LegModel, death_share};
use crate::needs::Ride;
use crate::price::{Caution, price};
use crate::search::frontier::Frontier;
use crate::settings::{BuildError, Probing, Site};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::atomic::Ordering;
use surefoot_world::arrival::rims;
use surefoot_world::crossings::{approach_between, swims_between};
use surefoot_world::csr::Csr;
use surefoot_world::parallel::with_threads;
use surefoot_world::{Ability, Chance, MoverAt, Vec3};

/// Probes candidate edges between vertices.
pub(crate) struct Prover<'a> {
    pub builder: Builder<'a>,
    /// Positions of the vertices, m.
    pub vertices: &'a [Vec3],
    /// Candidate edges to probe. Among those that leave the same vertex, the nearest come first.
    pub candidates: &'a [Candidate],
    /// The ride stop at which each vertex is; vertices beyond the end are at none.
    pub ride_stops: Cow<'a, [Option<MoverAt>]>,
}

/// Number of rounds in which each vertex's candidates are first probed, from near to far.
const ROUNDS: usize = 3;
/// Least expected chance of a candidate that is probed other than as a bridge between vertices that no proved edges
/// connect.
const MIN_CHANCE_TO_PROBE: f64 = 0.15;
/// Expected chance above which one success settles a candidate.
const SURE: f64 = 0.8;
/// Expected chance below which one failure settles a candidate.
const UNLIKELY: f64 = 0.4;
/// At most one in this many of all candidates is probed as a bridge.
const BRIDGE_SHARE: usize = 8;
/// A candidate is needless if proved edges lead to its end at no more than this share of its expected cost.
const MAX_COST_SHARE: f64 = 0.85;

/// Usual share of deaths among failures on edges beside which a miss is fatal.
const DEATHS_BESIDE_PERIL: f64 = 0.5;
/// Usual share of deaths among failures on all other edges.
const DEATHS_ELSEWHERE: f64 = 0.02;
/// Probes on the run of an edge beside which a miss is fatal.
const RUNS: u32 = 4;
/// Least success rate of an edge that is still probed on the run.
const MIN_RATE_ON_RUN: f64 = 0.5;
/// Least expected chance of an edge along which a steered body has got through: it does not act by chance. The geometry
/// of other edges says little about it.
const PRIOR_OF_STEERED: f64 = 0.9;

impl Prover<'_> {
    /// Probes the candidates and returns the evidence of each, in order.
    pub fn run(&self, probing: Probing) -> Result<Vec<Evidence>, BuildError> {
        let mut evidence = vec![Evidence::default(); self.candidates.len()];
        self.progress().interim.renew(self.vertices, self.candidates, &evidence);
        match probing {
            Probing::Exhaustive => {
                let repeats = 0..self.builder.settings.repeats;
                let all: Vec<u32> = repeats.flat_map(|_| 0..self.candidates.len() as u32).collect();
                self.try_once_each(&all, &mut evidence)?;
            }
            Probing::Frugal => self.frugal(&mut evidence)?,
        }
        Ok(evidence)
    }

    /// Probes each listed candidate once per listing and adds the outcomes to `evidence`.
    pub fn try_once_each(&self, which: &[u32], evidence: &mut [Evidence]) -> Result<(), BuildError> {
        let mut attempts: HashMap<u32, u32> = HashMap::new();
        let tries = which.iter().map(|&idx| {
            let attempt = attempts.entry(idx).or_insert(evidence[idx as usize].tries);
            *attempt += 1;
            (idx, *attempt)
        });
        let trials: Vec<Trial> = tries
            .map(|(idx, attempt)| {
                self.trial(idx, EdgeRun::Probe(attempt), self.manner(idx, attempt, &evidence[idx as usize]))
            })
            .collect();
        let progress = self.progress();
        progress.interim.extend(self.vertices, self.candidates, evidence);
        let mut outcomes = self.run_trials(&trials, &InterimWatch { progress, which })?;
        self.leap_again(&trials, &mut outcomes)?;
        for (&idx, outcome) in which.iter().zip(&outcomes) {
            evidence[idx as usize].note_probe(outcome);
        }
        progress.interim.replace(which, evidence);
        Ok(())
    }

    /// Repeats the free trials that failed without harm at a gap, steered, and keeps the outcomes of those that arrive:
    /// an NPC also leaps in another way where a rehearsal fails. Exhaustive probing, as in the paper, repeats nothing.
    fn leap_again(&self, trials: &[Trial], outcomes: &mut [Outcome]) -> Result<(), BuildError> {
        let Site { map, profile } = self.builder.site;
        let repeats = self.builder.settings.probing == Probing::Frugal && self.builder.executor.steers_leaps();
        if !repeats {
            return Ok(());
        }
        let is_stuck = |idx: &usize| {
            let (trial, outcome) = (&trials[*idx], &outcomes[*idx]);
            trial.manner == Manner::Free && trial.ride.is_none() && !outcome.reached && !outcome.died
        };
        let stuck: Vec<usize> = (0..trials.len()).filter(is_stuck).collect();
        let is_leap =
            self.in_parallel(&stuck, |&idx| rims(map, profile, [trials[idx].start, trials[idx].goal]).is_some())?;
        let leaps: Vec<usize> =
            stuck.into_iter().zip(is_leap).filter_map(|(idx, is_leap)| is_leap.then_some(idx)).collect();
        let again: Vec<Trial> = leaps.iter().map(|&idx| Trial { manner: Manner::Steered, ..trials[idx] }).collect();
        for (idx, outcome) in leaps.into_iter().zip(self.run_trials(&again, self.progress())?) {
            if outcome.reached {
                outcomes[idx] = outcome;
            }
        }
        Ok(())
    }

    /// Probes the proved edges along which every try that arrived has jumped once more, without jumps: most of them can
    /// be walked.
    pub fn prove_on_foot(&self, evidence: &mut [Evidence]) -> Result<(), BuildError> {
        let jumps = |own: &Evidence| Ability::JUMPS.contains(&own.ability);
        let is_due = |own: &Evidence| own.proves(self.builder.settings.threshold) && jumps(own);
        let which: Vec<u32> = (0..).zip(&*evidence).filter(|(_, own)| is_due(own)).map(|(idx, _)| idx).collect();
        let trials: Vec<Trial> = which.iter().map(|&idx| self.trial(idx, EdgeRun::OnFoot, Manner::OnFoot)).collect();
        let outcomes = self.run_trials(&trials, self.progress())?;
        // A failure on foot does not count: NPCs may jump there.
        for (idx, outcome) in which.into_iter().zip(&outcomes).filter(|(_, outcome)| outcome.reached) {
            evidence[idx as usize].note_probe(outcome);
        }
        Ok(())
    }

    /// Probes on the run those of `which` beside which a miss is fatal, each time from another edge that leads to their
    /// start.
    pub fn prove_on_the_run(&self, which: &[u32], evidence: &mut [Evidence]) -> Result<(), BuildError> {
        // On a ride, the body stands still, and a climb begins at its foot.
        let is_free = |own: &Evidence| own.needs.ride.is_none() && Manner::of_edge(own.ability) == Manner::Free;
        let is_run = |own: &Evidence| own.successes > 0 && is_free(own);
        let arrived: Vec<u32> = which.iter().copied().filter(|&idx| is_run(&evidence[idx as usize])).collect();
        let is_beside_peril = self.are_perilous(&arrived)?;
        let perilous: Vec<u32> =
            arrived.into_iter().zip(is_beside_peril).filter_map(|(idx, is_beside)| is_beside.then_some(idx)).collect();
        for run in 0..RUNS {
            let runs = self.run_ups(&perilous, evidence, run);
            let trial = |&(idx, before): &(u32, Option<u32>)| {
                let candidate = self.candidates[idx as usize];
                let start = before.map_or(candidate.from, |before| self.candidates[before as usize].from);
                let [start, at, goal] = [start, candidate.from, candidate.to].map(|vertex| self.position(vertex));
                let trial = Trial::walk(start, goal, EdgeRun::RunUp(run).stream(candidate));
                let (held, arrival) = (self.held(candidate), self.builder.settings.arrival);
                Trial { via: before.map(|_| at), held, arrival, ..trial }
            };
            let outcomes = self.run_trials(&runs.iter().map(trial).collect::<Vec<_>>(), self.progress())?;
            for ((idx, before), outcome) in runs.into_iter().zip(&outcomes) {
                if let Some((before, approach)) = before.zip(outcome.approach.as_deref()) {
                    evidence[before as usize].note_probe(approach);
                }
                if outcome.was_begun() {
                    evidence[idx as usize].note_probe(outcome);
                }
            }
        }
        self.progress().interim.renew(self.vertices, self.candidates, evidence);
        Ok(())
    }

    /// Expects as many of the failures on an edge to be deaths as there are on edges of its class: those beside which a
    /// miss is fatal, or all others.
    pub fn expect_deaths(&self, evidence: &mut [Evidence]) -> Result<(), BuildError> {
        let arrived: Vec<u32> =
            (0..).zip(&*evidence).filter(|(_, own)| own.successes > 0).map(|(idx, _)| idx).collect();
        let is_beside_peril = self.are_perilous(&arrived)?;
        for (class, usual) in [(true, DEATHS_BESIDE_PERIL), (false, DEATHS_ELSEWHERE)] {
            let members = || arrived.iter().zip(&is_beside_peril).filter(|(_, is_beside)| **is_beside == class);
            let share = death_share(members().map(|(&idx, _)| &evidence[idx as usize]), usual);
            members().for_each(|(&idx, _)| evidence[idx as usize].death_share = share as f32);
        }
        self.progress().interim.renew(self.vertices, self.candidates, evidence);
        Ok(())
    }

    fn frugal(&self, evidence: &mut [Evidence]) -> Result<(), BuildError> {
        let geometry = self.measure_all()?;
        self.progress().interim.measure(&geometry);
        let index: HashMap<Candidate, u32> =
            self.candidates.iter().zip(0..).map(|(&candidate, idx)| (candidate, idx)).collect();
        let fit =
            |evidence: &[Evidence]| Predictor::fit(self.vertices.len(), self.candidates, &geometry, &index, evidence);
        let mut hopeless = Vec::new();
        for (round, candidates) in self.by_distance().into_iter().enumerate() {
            if round == 0 {
                self.try_once_each(&candidates, evidence)?;
                continue;
            }
            let predictor = fit(evidence);
            let is_hopeful =
                |idx: &u32| self.is_steered(*idx) || predictor.chance(*idx as usize, evidence) >= MIN_CHANCE_TO_PROBE;
            let (mut hopeful, rejected): (Vec<u32>, Vec<u32>) = candidates.into_iter().partition(is_hopeful);
            hopeless.extend(rejected);
            self.remove_needless(&mut hopeful, evidence, &predictor);
            self.try_once_each(&hopeful, evidence)?;
        }
        self.try_once_each(&self.bridges(&hopeless, evidence), evidence)?;
        let all = 0..self.candidates.len() as u32;
        for attempt in 1..self.builder.settings.repeats {
            let predictor = fit(evidence);
            let is_doubtful = |&idx: &u32| {
                let own = &evidence[idx as usize];
                own.tries == attempt && !is_settled(own, predictor.chance(idx as usize, evidence))
            };
            let doubtful: Vec<u32> = all.clone().filter(is_doubtful).collect();
            self.try_once_each(&doubtful, evidence)?;
        }
        self.prove_on_the_run(&all.collect::<Vec<u32>>(), evidence)?;
        let predictor = fit(evidence);
        let prior = |(idx, own): (usize, &Evidence)| {
            let is_steered = own.successes > 0 && Manner::of_edge(own.ability) == Manner::Steered;
            predictor.chance(idx, evidence).max(if is_steered { PRIOR_OF_STEERED } else { 0.0 })
        };
        let priors: Vec<f64> = evidence.iter().enumerate().map(prior).collect();
        evidence.iter_mut().zip(priors).for_each(|(evidence, prior)| evidence.prior = prior as f32);
        self.expect_deaths(evidence)
    }

    /// Splits the candidates into rounds, from the nearest share of each vertex to the farthest.
    fn by_distance(&self) -> [Vec<u32>; ROUNDS] {
        let mut counts = vec![0usize; self.vertices.len()];
        self.candidates.iter().for_each(|key| counts[key.from.idx()] += 1);
        let mut assigned_counts = vec![0usize; self.vertices.len()];
        let mut rounds = [const { Vec::new() }; ROUNDS];
        for (idx, key) in (0..).zip(self.candidates) {
            let from = key.from.idx();
            rounds[assigned_counts[from] * ROUNDS / counts[from]].push(idx);
            assigned_counts[from] += 1;
        }
        rounds
    }

    /// Removes needless candidates from `which`: those that would cost more than a path that is already proved.
    fn remove_needless(&self, which: &mut Vec<u32>, evidence: &[Evidence], predictor: &Predictor<'_>) {
        let legs = LegModel::fit(self.vertices, self.candidates, evidence);
        let proved = self.candidates.iter().zip(evidence).enumerate().filter(|(_, (_, own))| own.successes > 0);
        let exits = proved.map(|(idx, (&EdgeKey { from, to }, own))| {
            let mut own = *own;
            own.prior = predictor.chance(idx, evidence) as f32;
            (from.idx(), (to.0, own.cost()))
        });
        let exits: Vec<(usize, (u32, f64))> = exits.collect();
        let exits = Csr::group(self.vertices.len(), exits.into_iter());
        let max_cost = |idx: u32| {
            let EdgeKey { from, to } = self.candidates[idx as usize];
            let decisions = legs.decisions(self.position(from), self.position(to));
            let chance = Chance::new(predictor.chance(idx as usize, evidence));
            MAX_COST_SHARE * price(decisions, chance, 0.0, Caution::BOLD)
        };
        let mut by_start: BTreeMap<VertexId, Vec<(u32, f64)>> = BTreeMap::new();
        for &idx in which.iter() {
            by_start.entry(self.candidates[idx as usize].from).or_default().push((idx, max_cost(idx)));
        }
        // The paths of one start at a time: those of all would take memory that grows with the square of the vertices.
        let mut frontier = Frontier::new(self.vertices.len());
        let mut needless: BTreeSet<u32> = BTreeSet::new();
        for (from, own) in by_start {
            let end = |idx: u32| self.candidates[idx as usize].to.0;
            let limit = own.iter().map(|(_, most)| *most).fold(0.0, f64::max);
            let mut ends: BTreeSet<u32> = own.iter().map(|(idx, _)| end(*idx)).collect();
            frontier.clear();
            frontier.offer(from.0, 0.0);
            while let Some((vertex, so_far)) = frontier.settle(limit) {
                if ends.remove(&vertex) && ends.is_empty() {
                    break;
                }
                for &(to, cost) in exits.row(vertex as usize) {
                    frontier.offer(to, so_far + cost);
                }
            }
            let is_needless = |(idx, most): &&(u32, f64)| frontier.cost(end(*idx)) <= *most;
            needless.extend(own.iter().filter(is_needless).map(|(idx, _)| idx));
        }
        which.retain(|idx| !needless.contains(idx));
    }

    /// Selects the shortest of the `hopeless` candidates that no proved edges replace, in ascending order.
    fn bridges(&self, hopeless: &[u32], evidence: &[Evidence]) -> Vec<u32> {
        if hopeless.is_empty() {
            return Vec::new();
        }
        let graph = NavGraph::prove(self.vertices.to_vec(), self.candidates, evidence, 0.0);
        let pairs: Vec<EdgeKey> = hopeless.iter().map(|&idx| self.candidates[idx as usize]).collect();
        let joined = graph.connectivity().are_joined(&pairs);
        let mut bridges: Vec<u32> =
            hopeless.iter().zip(joined).filter_map(|(&idx, is_joined)| (!is_joined).then_some(idx)).collect();
        let distance = |&idx: &u32| {
            let EdgeKey { from, to } = self.candidates[idx as usize];
            self.position(from).distance_squared(self.position(to))
        };
        bridges.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        bridges.truncate(self.candidates.len() / BRIDGE_SHARE);
        bridges.sort_unstable();
        bridges
    }

    /// Those of `edges` that still succeed often enough, each with an edge that leads to its start, another one in each
    /// `run`; `None` if there is none.
    fn run_ups(&self, edges: &[u32], evidence: &[Evidence], run: u32) -> Vec<(u32, Option<u32>)> {
        let succeeds = |idx: u32| evidence[idx as usize].success_rate() >= MIN_RATE_ON_RUN;
        let proved = (0..).zip(self.candidates).filter(|&(idx, _)| succeeds(idx));
        let entrances = Csr::group(self.vertices.len(), proved.map(|(idx, key)| (key.to.idx(), idx)));
        let run_up = |idx: u32| {
            let EdgeKey { from, to } = self.candidates[idx as usize];
            // NPCs do not turn back at once, and movers stand where the edge itself needs them.
            let leads_there = |it: &u32| {
                let key = self.candidates[*it as usize];
                key.from != to && self.held(key).is_none()
            };
            let mut before = entrances.row(from.idx()).iter().copied().filter(leads_there);
            let count = before.clone().count();
            (idx, before.nth((idx as usize + run as usize) % count.max(1)))
        };
        edges.iter().copied().filter(|&idx| succeeds(idx)).map(run_up).collect()
    }

    /// Whether a body could make a crossing or dash along a candidate.
    fn is_steered(&self, idx: u32) -> bool {
        let EdgeKey { from, to } = self.candidates[idx as usize];
        let ends = [from, to].map(|vertex| self.position(vertex));
        let Site { map, profile } = self.builder.site;
        let dashes = || profile.dash_speed > 0.0 && rims(map, profile, ends).is_some();
        approach_between(map, profile, ends, None).is_some() || swims_between(map, profile, ends) || dashes()
    }

    /// How the body of a probe moves. Where it could make a crossing or dash, it is steered first.
    fn manner(&self, idx: u32, attempt: u32, own: &Evidence) -> Manner {
        let is_first = attempt % 2 == 1 && own.successes == 0 && self.is_steered(idx);
        if is_first { Manner::Steered } else { Manner::of_edge(own.ability) }
    }

    /// The trial of one run along a candidate, without a run-up.
    fn trial(&self, idx: u32, run: EdgeRun, manner: Manner) -> Trial {
        let candidate = self.candidates[idx as usize];
        let ends = self.ride_stop(candidate.from).zip(self.ride_stop(candidate.to));
        let (start, goal) = (self.position(candidate.from), self.position(candidate.to));
        Trial {
            manner,
            arrival: self.builder.settings.arrival,
            held: self.held(candidate),
            ride: ends.and_then(|(from, to)| Ride::between(from, to)),
            ..Trial::walk(start, goal, run.stream(candidate))
        }
    }

    fn run_trials(&self, trials: &[Trial], watch: &dyn ProbeWatch) -> Result<Vec<Outcome>, BuildError> {
        self.progress().total.fetch_add(trials.len() as u64, Ordering::Relaxed);
        let outcomes = self.builder.executor.run(trials, self.builder.settings.seed, watch);
        outcomes.ok_or(BuildError::Cancelled)
    }

    /// The mover that is held at a stop for probes of a candidate that begins or ends there.
    fn held(&self, EdgeKey { from, to }: Candidate) -> Option<MoverAt> {
        self.ride_stop(from).or_else(|| self.ride_stop(to))
    }

    fn ride_stop(&self, vertex: VertexId) -> Option<MoverAt> {
        self.ride_stops.get(vertex.idx()).copied().flatten()
    }

    fn position(&self, vertex: VertexId) -> Vec3 {
        self.vertices[vertex.idx()]
    }

    fn progress(&self) -> &Progress {
        self.builder.progress
    }

    /// Whether a miss is fatal beside each of these candidates.
    fn are_perilous(&self, which: &[u32]) -> Result<Vec<bool>, BuildError> {
        let (map, vertices, candidates) = (&self.builder.site.map, self.vertices, self.candidates);
        self.in_parallel(which, |&idx| {
            let EdgeKey { from, to } = candidates[idx as usize];
            is_perilous(map, vertices[from.idx()], vertices[to.idx()])
        })
    }

    /// Measures the ground between the vertices of each candidate, in order.
    fn measure_all(&self) -> Result<Vec<Geometry>, BuildError> {
        let (map, vertices) = (&self.builder.site.map, self.vertices);
        self.in_parallel(self.candidates, |key| measure(map, vertices[key.from.idx()], vertices[key.to.idx()]))
    }

    /// Maps `items` in order, on several threads.
    fn in_parallel<T: Sync, R: Send>(
        &self,
        items: &[T],
        map: impl Fn(&T) -> R + Sync + Send,
    ) -> Result<Vec<R>, BuildError> {
        let progress = self.progress();
        let map = |item: &T| if progress.is_cancelled() { Err(BuildError::Cancelled) } else { Ok(map(item)) };
        with_threads(self.builder.thread_count, || items.par_iter().map(map).collect())
    }
}

/// Returns whether further probes would hardly change the estimate of an edge.
fn is_settled(own: &Evidence, chance: f64) -> bool {
    if own.successes == own.tries {
        chance >= SURE
    } else if own.successes == 0 {
        chance < UNLIKELY
    } else {
        false
    }
}

/// Adds the outcomes of probes to the interim graph as they come.
struct InterimWatch<'a> {
    progress: &'a Progress,
    /// The candidate of each trial.
    which: &'a [u32],
}

impl ProbeWatch for InterimWatch<'_> {
    fn finished(&self, trial: usize, outcome: &Outcome) {
        self.progress.interim.note(self.which[trial], outcome);
        self.progress.finished(trial, outcome);
    }

    fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled()
    }
}
