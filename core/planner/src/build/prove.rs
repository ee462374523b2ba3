//! Probes candidate edges: all of them with all repeats, as in the paper, or only with as many probes as are needed.
//!
//! Frugal probing proceeds in rounds, each with a `predictor` fitted to the rounds before. The nearest third of each
//! vertex's candidates is probed once, then the middle third, then the farthest. The later rounds omit hopeless
//! candidates, which are expected to fail, and needless ones, which no plan would use because proved edges already lead
//! to the same vertex at less than the candidate's expected cost. A hopeless candidate is probed after all if no proved
//! edges lead from its one end to the other. Finally, candidates whose outcome the predictor did not clearly
//! expect are probed again, up to the number of repeats in the settings.
//!
//! Where a miss is fatal, beside a void or lava, edges are then probed as NPCs use them that follow a plan: on the run, from an
//! edge before.

use crate::build::Progress;
use crate::build::candidates::Candidate;
use crate::build::predictor::{Geometry, Predictor, is_perilous, measure};
use crate::build::probe::{EdgeRun, Outcome, ProbeExecutor, ProbeWatch, Trial};
use crate::evidence::Evidence;
use crate::graph::NavGraph;
use crate::ids::{EdgeKey, VertexId};
use crate::legs::{LegModel, death_share};
use crate::needs::Ride;
use crate::price::{Caution, price};
use crate::search::csr::Csr;
use crate::search::frontier::Frontier;
use crate::settings::Probing;
use crate::threads::with_threads;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::atomic::Ordering;
use surefoot_world::{Ability, Chance, Map, MoverAt, Vec3};

/// Inputs for probing candidate edges.
pub struct ProbeRun<'a> {
    /// The map that the vertices stand on.
    pub map: &'a Map,
    /// Positions of the vertices, m.
    pub vertices: &'a [Vec3],
    /// Candidate edges to probe. Among those that leave the same vertex, the nearest come first.
    pub candidates: &'a [Candidate],
    /// Maximum number of probes per candidate edge.
    pub repeats: u32,
    /// The ride_stop, a mover and its stop, at which each vertex is; vertices beyond the end are at none.
    pub ride_stops: Cow<'a, [Option<MoverAt>]>,
    /// Seed of initial headings and of noise.
    pub seed: u64,
    /// Number of threads for work other than probing.
    pub thread_count: usize,
    /// Runs the probes.
    pub executor: &'a dyn ProbeExecutor,
    /// Counts the probes, notes their outcomes, and cancels them.
    pub progress: &'a Progress,
}

/// Number of rounds in which each vertex's candidates are first probed, from near to far.
const ROUNDS: usize = 3;
/// Expected chance below which a candidate is probed only as a bridge between vertices that no proved edges connect.
const HOPELESS: f64 = 0.15;
/// Expected chance above which one success settles a candidate.
const SURE: f64 = 0.8;
/// Expected chance below which one failure settles a candidate.
const UNLIKELY: f64 = 0.4;
/// At most one in this many of all candidates is probed as a bridge.
const BRIDGE_SHARE: usize = 8;
/// A candidate is needless if proved edges lead to its end at no more than this fraction of its expected cost.
const NEEDLESS: f64 = 0.85;

/// Usual share of deaths among failures on edges beside which a miss is fatal.
const DEATHS_BESIDE_PERIL: f64 = 0.5;
/// The same on other edges.
const DEATHS_ELSEWHERE: f64 = 0.02;
/// Probes on the run of an edge beside which a miss is fatal.
const RUNS: u32 = 4;
/// Success rate below which an edge is not probed on the run any more.
const FORLORN: f64 = 0.5;

impl ProbeRun<'_> {
    /// Probes the candidates and returns the evidence of each, in order; `None` if the build was cancelled.
    pub fn run(&self, probing: Probing) -> Option<Vec<Evidence>> {
        let mut evidence = vec![Evidence::default(); self.candidates.len()];
        self.progress.interim.renew(self.vertices, self.candidates, &evidence);
        match probing {
            Probing::Exhaustive => {
                let all: Vec<u32> = (0..self.repeats).flat_map(|_| 0..self.candidates.len() as u32).collect();
                self.try_once_each(&all, &mut evidence)?;
            }
            Probing::Frugal => self.frugal(&mut evidence)?,
        }
        Some(evidence)
    }

    /// Probes each listed candidate once per listing and adds the outcomes to `evidence`; `None` if the build was cancelled.
    pub fn try_once_each(&self, which: &[u32], evidence: &mut [Evidence]) -> Option<()> {
        let mut attempts: HashMap<u32, u32> = HashMap::new();
        let tries = which.iter().map(|&idx| {
            let attempt = attempts.entry(idx).or_insert(evidence[idx as usize].tries);
            *attempt += 1;
            (idx, EdgeRun::Probe(*attempt))
        });
        let tries: Vec<(u32, EdgeRun)> = tries.collect();
        self.progress.interim.extend(self.vertices, self.candidates, evidence);
        let outcomes = self.run_trials(&tries, &Noting { progress: self.progress, which })?;
        for (&idx, outcome) in which.iter().zip(&outcomes) {
            evidence[idx as usize].note_probe(outcome);
        }
        self.progress.interim.replace(which, evidence);
        Some(())
    }

    /// Probes the proved edges along which every try that arrived has jumped once more, without jumps: most of them can be walked.
    pub fn prove_on_foot(&self, evidence: &mut [Evidence], threshold: f64) -> Option<()> {
        let jumps = |own: &Evidence| matches!(own.ability, Ability::Jump | Ability::DoubleJump);
        let is_due = |own: &Evidence| own.proves(threshold) && jumps(own);
        let which: Vec<(u32, EdgeRun)> =
            (0..).zip(&*evidence).filter(|(_, own)| is_due(own)).map(|(idx, _)| (idx, EdgeRun::OnFoot)).collect();
        let outcomes = self.run_trials(&which, self.progress)?;
        // A try on foot that fails says nothing of NPCs that may jump there.
        for ((idx, _), outcome) in which.into_iter().zip(&outcomes).filter(|(_, outcome)| outcome.reached) {
            evidence[idx as usize].note_probe(outcome);
        }
        Some(())
    }

    /// Runs one trial for each candidate and run along it.
    fn run_trials(&self, tries: &[(u32, EdgeRun)], watch: &dyn ProbeWatch) -> Option<Vec<Outcome>> {
        self.progress.total.fetch_add(tries.len() as u64, Ordering::Relaxed);
        let trial = |&(idx, run): &(u32, EdgeRun)| {
            let candidate = self.candidates[idx as usize];
            let (start, goal) = (self.vertices[candidate.from.idx()], self.vertices[candidate.to.idx()]);
            let held = self.held(candidate);
            let ends = self.ride_stop(candidate.from).zip(self.ride_stop(candidate.to));
            let ride = ends.and_then(|(from, to)| Ride::between(from, to));
            let on_foot = run == EdgeRun::OnFoot;
            Trial { on_foot, held, ride, ..Trial::walk(start, goal, run.stream(candidate)) }
        };
        let trials: Vec<Trial> = tries.iter().map(trial).collect();
        self.executor.run(&trials, self.seed, watch)
    }

    /// The mover that is held at a stop for probes of this candidate, of which an end is a ride_stop.
    fn held(&self, EdgeKey { from, to }: Candidate) -> Option<MoverAt> {
        self.ride_stop(from).or_else(|| self.ride_stop(to))
    }

    fn ride_stop(&self, vertex: VertexId) -> Option<MoverAt> {
        self.ride_stops.get(vertex.idx()).copied().flatten()
    }

    fn frugal(&self, evidence: &mut [Evidence]) -> Option<()> {
        let geometry = self.measure_all()?;
        self.progress.interim.measure(&geometry);
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
            let (mut hopeful, rejected): (Vec<u32>, Vec<u32>) =
                candidates.into_iter().partition(|&idx| predictor.chance(idx as usize, evidence) >= HOPELESS);
            hopeless.extend(rejected);
            self.remove_needless(&mut hopeful, evidence, &predictor);
            self.try_once_each(&hopeful, evidence)?;
        }
        let bridges = self.bridges(&hopeless, evidence);
        self.try_once_each(&bridges, evidence)?;
        for attempt in 1..self.repeats {
            let predictor = fit(evidence);
            let doubtful: Vec<u32> = (0..self.candidates.len() as u32)
                .filter(|&idx| {
                    let own = &evidence[idx as usize];
                    own.tries == attempt && !self.is_settled(own, predictor.chance(idx as usize, evidence))
                })
                .collect();
            self.try_once_each(&doubtful, evidence)?;
        }
        let all: Vec<u32> = (0..self.candidates.len() as u32).collect();
        self.prove_on_the_run(&all, evidence)?;
        let predictor = fit(evidence);
        let priors: Vec<f64> = (0..evidence.len()).map(|idx| predictor.chance(idx, evidence)).collect();
        evidence.iter_mut().zip(priors).for_each(|(evidence, prior)| evidence.prior = prior as f32);
        self.expect_deaths(evidence)
    }

    /// Expects as many of the failures on an edge to be deaths as there are on others: those beside which a miss is fatal, or the rest;
    /// `None` if the build was cancelled.
    pub fn expect_deaths(&self, evidence: &mut [Evidence]) -> Option<()> {
        let arrived: Vec<u32> =
            (0..).zip(&*evidence).filter(|(_, own)| own.successes > 0).map(|(idx, _)| idx).collect();
        let is_beside_peril = self.are_perilous(&arrived)?;
        let classes = [(true, DEATHS_BESIDE_PERIL), (false, DEATHS_ELSEWHERE)];
        for (class, usual) in classes {
            let members = || arrived.iter().zip(&is_beside_peril).filter(|(_, is_beside)| **is_beside == class);
            let share = death_share(members().map(|(&idx, _)| &evidence[idx as usize]), usual);
            members().for_each(|(&idx, _)| evidence[idx as usize].death_share = share as f32);
        }
        self.progress.interim.renew(self.vertices, self.candidates, evidence);
        Some(())
    }

    /// Whether a miss is fatal beside each of these candidates; `None` if the build was cancelled.
    fn are_perilous(&self, which: &[u32]) -> Option<Vec<bool>> {
        self.in_parallel(which, |&idx| {
            let EdgeKey { from, to } = self.candidates[idx as usize];
            is_perilous(self.map, self.vertices[from.idx()], self.vertices[to.idx()])
        })
    }

    /// Probes those of `which` beside which a miss is fatal on the run, each time from another edge that leads to their start.
    pub fn prove_on_the_run(&self, which: &[u32], evidence: &mut [Evidence]) -> Option<()> {
        let position = |vertex: VertexId| self.vertices[vertex.idx()];
        // A ride stands still.
        let is_run = |idx: u32| evidence[idx as usize].successes > 0 && evidence[idx as usize].needs.ride.is_none();
        let arrived: Vec<u32> = which.iter().copied().filter(|&idx| is_run(idx)).collect();
        let is_beside_peril = self.are_perilous(&arrived)?;
        let perilous: Vec<u32> =
            arrived.into_iter().zip(is_beside_peril).filter_map(|(idx, is_beside)| is_beside.then_some(idx)).collect();
        for run in 0..RUNS {
            let runs = self.run_ups(&perilous, evidence, run);
            let trial = |&(idx, before): &(u32, Option<u32>)| {
                let candidate = self.candidates[idx as usize];
                let start = before.map_or(candidate.from, |before| self.candidates[before as usize].from);
                let stream = EdgeRun::RunUp(run).stream(candidate);
                let via = before.map(|_| position(candidate.from));
                let trial = Trial::walk(position(start), position(candidate.to), stream);
                Trial { via, held: self.held(candidate), ..trial }
            };
            let trials: Vec<Trial> = runs.iter().map(trial).collect();
            self.progress.total.fetch_add(trials.len() as u64, Ordering::Relaxed);
            let outcomes = self.executor.run(&trials, self.seed, self.progress)?;
            for ((idx, before), outcome) in runs.into_iter().zip(&outcomes) {
                if let Some((before, approach)) = before.zip(outcome.approach.as_deref()) {
                    evidence[before as usize].note_probe(approach);
                }
                if outcome.was_begun() {
                    evidence[idx as usize].note_probe(outcome);
                }
            }
        }
        self.progress.interim.renew(self.vertices, self.candidates, evidence);
        Some(())
    }

    /// Those of `edges` that still succeed often enough, each with an edge that leads to its start, another one in each `run`; `None`
    /// if no other does.
    fn run_ups(&self, edges: &[u32], evidence: &[Evidence], run: u32) -> Vec<(u32, Option<u32>)> {
        let succeeds = |idx: u32| evidence[idx as usize].success_rate() >= FORLORN;
        let mut entrances: Vec<Vec<u32>> = vec![Vec::new(); self.vertices.len()];
        for (idx, key) in (0..).zip(self.candidates).filter(|&(idx, _)| succeeds(idx)) {
            entrances[key.to.idx()].push(idx);
        }
        let run_up = |idx: u32| {
            let EdgeKey { from, to } = self.candidates[idx as usize];
            // Nobody comes back at once, and movers stand where the edge itself needs them.
            let leads_there = |it: &u32| {
                let key = self.candidates[*it as usize];
                key.from != to && self.held(key).is_none()
            };
            let mut before = entrances[from.idx()].iter().copied().filter(leads_there);
            let count = before.clone().count();
            (idx, before.nth((idx as usize + run as usize) % count.max(1)))
        };
        edges.iter().copied().filter(|&idx| succeeds(idx)).map(run_up).collect()
    }

    /// Returns whether further probes would hardly change the estimate of an edge.
    fn is_settled(&self, own: &Evidence, chance: f64) -> bool {
        if own.successes == own.tries {
            chance >= SURE
        } else if own.successes == 0 {
            chance < UNLIKELY
        } else {
            false
        }
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
        let mut frontier = Frontier::new(self.vertices.len());
        let cost = |idx: u32| {
            let EdgeKey { from, to } = self.candidates[idx as usize];
            let decisions = legs.decisions(self.vertices[from.idx()], self.vertices[to.idx()]);
            price(decisions, Chance::new(predictor.chance(idx as usize, evidence)), 0.0, Caution::BOLD)
        };
        let mut by_start: BTreeMap<VertexId, Vec<(u32, f64)>> = BTreeMap::new();
        for &idx in which.iter() {
            let most = NEEDLESS * cost(idx);
            by_start.entry(self.candidates[idx as usize].from).or_default().push((idx, most));
        }
        // The paths of one start at a time: those of all would take memory that grows with the square of the vertices.
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

    /// Selects the shortest of the `hopeless` candidates whose end no proved edges connect to their start, in ascending order.
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
            self.vertices[from.idx()].distance_squared(self.vertices[to.idx()])
        };
        bridges.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        bridges.truncate(self.candidates.len() / BRIDGE_SHARE);
        bridges.sort_unstable();
        bridges
    }

    /// Measures the ground between the vertices of each candidate, in order; `None` if the build was cancelled.
    fn measure_all(&self) -> Option<Vec<Geometry>> {
        self.in_parallel(self.candidates, |&EdgeKey { from, to }| {
            measure(self.map, self.vertices[from.idx()], self.vertices[to.idx()])
        })
    }

    /// What `look` finds out of each of `items` by casting rays, in order; `None` if the build was cancelled.
    fn in_parallel<T: Sync, R: Send>(&self, items: &[T], look: impl Fn(&T) -> R + Sync) -> Option<Vec<R>> {
        let progress = self.progress;
        let look = |item: &T| (!progress.is_cancelled()).then(|| look(item));
        with_threads(self.thread_count, || items.par_iter().map(look).collect())
    }
}

/// Notes the outcomes of probes of candidates as they come.
struct Noting<'a> {
    progress: &'a Progress,
    /// The candidate of each trial.
    which: &'a [u32],
}

impl ProbeWatch for Noting<'_> {
    fn finished(&self, trial: usize, outcome: &Outcome) {
        self.progress.interim.note(self.which[trial], outcome);
        self.progress.finished(trial, outcome);
    }

    fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled()
    }
}
