//! The graph of a build that is still running, on which plans can be made before it ends.
//!
//! It has the edges that are proved so far. A candidate that has not been probed yet becomes an expected edge if the
//! predictor, fitted to the probes so far, is sure of it and a miss is not fatal. During a build, vertices keep their
//! indices, and new ones are added at the end.

use crate::build::candidates::Candidate;
use crate::build::predictor::{Geometry, Predictor, is_perilous};
use crate::build::probe::Outcome;
use crate::evidence::Evidence;
use crate::graph::{Edge, GraphData, NavGraph};
use crate::ids::EdgeKey;
use crate::legs::LegModel;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use surefoot_world::{Map, Vec3};

/// Least chance at which the predictor is sure of a candidate.
const SURE: f64 = 0.8;
/// Most expected edges that leave a vertex, the nearest first: plans need no others, and each requires rays to the
/// ground.
const MAX_EXPECTED: u32 = 4;
/// Number of probes below which the predictor is not used.
const MIN_PROBES: u32 = 128;

/// What a running build has found out so far.
#[derive(Debug, Default)]
pub struct Interim {
    findings: Mutex<Option<Findings>>,
}

/// Vertices, candidates and evidence at one moment.
#[derive(Debug, Clone, Default)]
struct Findings {
    vertices: Vec<Vec3>,
    candidates: Vec<Candidate>,
    evidence: Vec<Evidence>,
    /// The ground along the candidates that the predictor can judge; they come first.
    geometry: Arc<[Geometry]>,
}

impl Interim {
    /// Returns the graph so far; `None` until enough probes have finished. `map` and `threshold` are those of the
    /// build.
    pub fn graph(&self, map: &Map, threshold: f64) -> Option<NavGraph> {
        let findings = self.lock().clone()?;
        let probes: u32 = findings.evidence.iter().map(|own| own.tries).sum();
        (probes >= MIN_PROBES).then(|| findings.graph(map, threshold))
    }

    /// Sets the ground along the first candidates, as the predictor measured it.
    pub(crate) fn measure(&self, geometry: &[Geometry]) {
        self.lock().get_or_insert_default().geometry = geometry.into();
    }

    /// Sets all findings.
    pub(crate) fn renew(&self, vertices: &[Vec3], candidates: &[Candidate], evidence: &[Evidence]) {
        let mut findings = self.lock();
        let findings = findings.get_or_insert_default();
        findings.vertices = vertices.to_vec();
        findings.candidates = candidates.to_vec();
        findings.evidence = evidence.to_vec();
    }

    /// Adds the vertices and candidates that were added at the end.
    pub(crate) fn extend(&self, vertices: &[Vec3], candidates: &[Candidate], evidence: &[Evidence]) {
        let mut findings = self.lock();
        let Findings { vertices: known, candidates: listed, evidence: own, .. } = findings.get_or_insert_default();
        known.extend(&vertices[known.len().min(vertices.len())..]);
        listed.extend(&candidates[listed.len().min(candidates.len())..]);
        own.extend(&evidence[own.len().min(evidence.len())..]);
    }

    /// Sets the evidence of these candidates.
    pub(crate) fn replace(&self, which: &[u32], evidence: &[Evidence]) {
        if let Some(findings) = self.lock().as_mut() {
            which.iter().for_each(|&idx| findings.evidence[idx as usize] = evidence[idx as usize]);
        }
    }

    /// Adds the outcome of a probe of a candidate.
    pub(crate) fn note(&self, candidate: u32, outcome: &Outcome) {
        if let Some(own) = self.lock().as_mut().and_then(|findings| findings.evidence.get_mut(candidate as usize)) {
            own.note_probe(outcome);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Option<Findings>> {
        // A probe that panicked has not been added; all others have.
        self.findings.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Findings {
    fn graph(self, map: &Map, threshold: f64) -> NavGraph {
        let Self { vertices, candidates, evidence, geometry } = self;
        let judged = geometry.len().min(candidates.len());
        let index: HashMap<Candidate, u32> = candidates[..judged].iter().copied().zip(0..).collect();
        let predictor = Predictor::fit(vertices.len(), &candidates[..judged], &geometry, &index, &evidence[..judged]);
        let legs = LegModel::fit(&vertices, &candidates, &evidence);
        let mut expected = vec![0; vertices.len()];
        let edge = |(idx, &key): (usize, &Candidate)| {
            let mut own = evidence[idx];
            let chance = (idx < judged).then(|| predictor.chance(idx, &evidence));
            if own.proves(threshold) {
                own.prior = chance.map_or(own.prior, |chance| chance as f32);
                return Some(Edge { key, evidence: own });
            }
            let EdgeKey { from, to } = key;
            let [start, end] = [from, to].map(|vertex| vertices[vertex.idx()]);
            let chance =
                chance.filter(|&chance| own.tries == 0 && chance >= SURE && expected[from.idx()] < MAX_EXPECTED)?;
            expected[from.idx()] += 1;
            if is_perilous(map, start, end) {
                return None;
            }
            Some(Edge { key, evidence: Evidence::expected(chance as f32, legs.decisions(start, end)) })
        };
        let edges = candidates.iter().enumerate().filter_map(edge).collect();
        let data = GraphData { vertices, edges, legs, ..GraphData::default() };
        NavGraph::check(data).expect("candidates join existing vertices")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::TryEnd;
    use surefoot_world::Ability;

    fn findings(interim: &Interim) -> (Vec<Vec3>, Vec<Candidate>, Vec<Evidence>) {
        let Findings { vertices, candidates, evidence, .. } = interim.lock().clone().unwrap();
        (vertices, candidates, evidence)
    }

    #[test]
    fn changes_step_by_step_equal_a_copy_of_everything() {
        let (interim, outcome) = (Interim::default(), Outcome { reached: true, ..Outcome::begin(Vec3::ONE) });
        let mut vertices = vec![Vec3::ZERO, Vec3::X, Vec3::Z];
        let mut candidates = vec![EdgeKey::new(0, 1), EdgeKey::new(1, 2)];
        let mut evidence = vec![Evidence::default(); 2];
        interim.renew(&vertices, &candidates, &evidence);
        for round in 0..5 {
            vertices.push(Vec3::splat(round as f32));
            candidates.push(EdgeKey::new(0, 3 + round));
            evidence.push(Evidence::with_prior(0.5));
            interim.extend(&vertices, &candidates, &evidence);
            let which = [round, round + 2];
            // Probes end in any order, and the build counts them in its own.
            which.iter().rev().for_each(|&idx| interim.note(idx, &outcome));
            which.iter().for_each(|&idx| evidence[idx as usize].note_probe(&outcome));
            evidence[0].note(TryEnd::Died, 3, Ability::WALK);
            interim.replace(&[which[0], which[1], 0], &evidence);
            assert_eq!(findings(&interim), (vertices.clone(), candidates.clone(), evidence.clone()));
        }
        interim.renew(&vertices[..3], &candidates[..2], &evidence[..2]);
        assert_eq!(findings(&interim).2, evidence[..2], "another run begins with its own");
    }

    #[test]
    fn there_is_no_graph_before_enough_probes_and_then_one_of_what_is_proved() {
        let map = Map::from_parts(
            surefoot_world::map::MapSize { width: 16, height: 16, depth: 16 },
            Vec::new(),
            surefoot_world::map::Placed::default(),
        );
        let interim = Interim::default();
        assert!(interim.graph(&map, 0.5).is_none());
        let candidates = [EdgeKey::new(0, 1), EdgeKey::new(1, 0)];
        interim.renew(&[Vec3::ZERO, Vec3::X], &candidates, &[Evidence::default(); 2]);
        let arrived = Outcome { reached: true, ..Outcome::begin(Vec3::ZERO) };
        (1..MIN_PROBES).for_each(|_| interim.note(0, &arrived));
        assert!(interim.graph(&map, 0.5).is_none());
        interim.note(1, &Outcome::begin(Vec3::ZERO));
        let graph = interim.graph(&map, 0.5).expect("enough probes");
        assert_eq!(graph.edges().map(|edge| edge.key).collect::<Vec<_>>(), [candidates[0]]);
    }
}
