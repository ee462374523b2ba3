//! Predicts whether a probe of a candidate edge will succeed.
//!
//! The predictor is a logistic regression on the ground between two vertices (distance, climb, steps, holes, hazards,
//! walls, pads) and on the outcomes of their other probes. It is fitted during the build, to the probes run so far,
//! so it adapts to the policy, the character and the map, and no weights need to be shipped.

use crate::build::candidates::Candidate;
use crate::evidence::Evidence;
use crate::ids::EdgeKey;
use crate::regression::{Logistic, dot, sigmoid};
use std::collections::HashMap;
use surefoot_world::float::hypot;
use surefoot_world::map::DeviceKind;
use surefoot_world::mesh::Surface;
use surefoot_world::navigable::DOWN;
use surefoot_world::{Map, Vec3};

/// Number of features that come from the map.
const GEOMETRY: usize = 16;
/// Number of all features: those from the map, and three from other probes.
const FEATURES: usize = GEOMETRY + 3;
/// Number of points between two vertices at which the ground is sampled.
const BETWEEN: usize = 7;
/// Height above the straight line between the vertices from which rays are cast down, m.
const ABOVE_M: f32 = 2.5;
/// Depth below the straight line to which rays are cast, m.
const BELOW_M: f32 = 30.0;
/// Height of the chest above the feet, m.
const CHEST_M: f32 = 1.1;
/// Height that one jump and two jumps gain, m.
const JUMPS_M: [f32; 2] = [2.3, 4.7];
/// Greatest distance of a pad from the first vertex at which it counts, m.
const PAD_M: f32 = 14.0;
/// Number of tries at the overall mean that are added to those of a vertex, to smooth its success rate.
const SMOOTHING: f64 = 2.0;

/// Features of the ground between two vertices.
pub type Geometry = [f32; GEOMETRY];

/// Measures the ground between two vertices.
pub fn measure(map: &Map, from: Vec3, to: Vec3) -> Geometry {
    let offset = to - from;
    let horizontal = hypot(offset.x, offset.z);
    let (climb, drop) = (offset.y.max(0.0), (-offset.y).max(0.0));
    let (mut step_up, mut hole, mut bump) = (0.0f32, 0.0f32, 0.0f32);
    let (mut water, mut lava) = (0.0f32, 0.0f32);
    let mut last = from.y;
    for idx in 1..=BETWEEN {
        let point = from + offset * (idx as f32 / (BETWEEN + 1) as f32);
        let above = point + Vec3::new(0.0, ABOVE_M, 0.0);
        let hit = map.mesh().cast_ray(above, DOWN, BELOW_M + ABOVE_M);
        let height = above.y - hit.map_or(BELOW_M + ABOVE_M, |hit| hit.distance);
        match hit.map(|hit| hit.surface) {
            Some(Surface::Water) => water += 1.0,
            Some(Surface::Lava) => lava += 1.0,
            _ => {}
        }
        step_up = step_up.max(height - last);
        hole = hole.max(point.y - height);
        bump = bump.max(height - point.y);
        last = height;
    }
    step_up = step_up.max(to.y - last);
    let chest = Vec3::new(0.0, CHEST_M, 0.0);
    let length = offset.length().max(1.0e-3);
    let sight = map.mesh().cast_ray(from + chest, offset / length, length);
    let blocked = sight.filter(|hit| hit.surface.is_solid()).map_or(0.0, |hit| 1.0 - hit.distance / length);
    let pad = map.placed().nearest(DeviceKind::Pad, from);
    let pad = pad.filter(|pad| pad.from.distance(from) < PAD_M && climb > JUMPS_M[0]);
    let between = BETWEEN as f32;
    [
        1.0,
        horizontal / 20.0,
        (horizontal / 20.0) * (horizontal / 20.0),
        climb / 5.0,
        (climb / 5.0) * (climb / 5.0),
        drop / 10.0,
        climb / horizontal.max(1.0),
        step_up.min(12.0) / 4.0,
        hole.min(20.0) / 5.0,
        bump.min(ABOVE_M) / ABOVE_M,
        water / between,
        lava / between,
        blocked,
        f32::from(u8::from(climb > JUMPS_M[0])),
        f32::from(u8::from(climb > JUMPS_M[1])),
        if pad.is_some() { 1.0 } else { 0.0 },
    ]
}

/// Returns whether a body that strays a little from the straight line between two places, or overshoots its end,
/// falls out of the map or into lava.
pub fn is_perilous(map: &Map, from: Vec3, to: Vec3) -> bool {
    /// Distance between the sampled places along the line, m.
    const STEP_M: f32 = 2.0;
    /// How far aside and beyond the end the body strays, m.
    const STRAY_M: f32 = 1.5;
    /// Height above the line at which an obstacle holds a body back, m.
    const KNEE_M: f32 = 0.6;
    let offset = to - from;
    let length = hypot(offset.x, offset.z).max(1.0e-3);
    let (along, across) = (
        Vec3::new(offset.x / length, 0.0, offset.z / length) * STRAY_M,
        Vec3::new(-offset.z / length, 0.0, offset.x / length) * STRAY_M,
    );
    let knee = Vec3::Y * KNEE_M;
    let is_fatal = |point: Vec3, stray: Vec3| {
        let beside = point + stray + knee;
        let below = map.mesh().cast_ray(beside, DOWN, beside.y.max(KNEE_M));
        // Solid obstacles hold a body back.
        let is_held =
            || map.mesh().cast_ray(point + knee, stray / STRAY_M, STRAY_M).is_some_and(|hit| hit.surface.is_solid());
        below.is_none_or(|hit| hit.surface == Surface::Lava) && !is_held()
    };
    let steps = (length / STEP_M).ceil();
    (0..=steps as u32).any(|step| {
        let point = from + offset * (step as f32 / steps);
        // The straight line may lead through a hill.
        let is_inside = || map.mesh().solid_depth_at(point + knee) > 0;
        (is_fatal(point, across) || is_fatal(point, -across)) && !is_inside()
    }) || is_fatal(to, along)
}

/// Outcomes of the probes that leave, or that reach, a vertex.
#[derive(Debug, Clone, Copy, Default)]
struct Record {
    tries: f64,
    successes: f64,
}

impl Record {
    fn add(&mut self, evidence: &Evidence) {
        self.tries += f64::from(evidence.tries);
        self.successes += f64::from(evidence.successes);
    }

    /// Returns the smoothed success rate without the probes of one candidate; `mean` is the overall success rate.
    fn without(&self, own: &Evidence, mean: f64) -> f64 {
        let successes = self.successes - f64::from(own.successes) + SMOOTHING * mean;
        successes / (self.tries - f64::from(own.tries) + SMOOTHING)
    }
}

/// A fitted predictor.
#[derive(Debug)]
pub struct Predictor<'a> {
    candidates: &'a [Candidate],
    geometry: &'a [Geometry],
    weights: [f64; FEATURES],
    /// Outcomes of the probes that leave each vertex.
    leaving: Vec<Record>,
    /// Outcomes of the probes that reach each vertex.
    reaching: Vec<Record>,
    index: &'a HashMap<Candidate, u32>,
    mean: f64,
}

impl<'a> Predictor<'a> {
    /// Fits a predictor to all candidates that have been probed; `index` maps each candidate to its index.
    pub fn fit(
        vertex_count: usize,
        candidates: &'a [Candidate],
        geometry: &'a [Geometry],
        index: &'a HashMap<Candidate, u32>,
        evidence: &[Evidence],
    ) -> Self {
        let (mut leaving, mut reaching) =
            (vec![Record::default(); vertex_count], vec![Record::default(); vertex_count]);
        let mut all = Record::default();
        for (&EdgeKey { from, to }, evidence) in candidates.iter().zip(evidence) {
            leaving[from.idx()].add(evidence);
            reaching[to.idx()].add(evidence);
            all.add(evidence);
        }
        let mean = (all.successes + SMOOTHING) / (all.tries + 2.0 * SMOOTHING);
        let mut predictor = Self { candidates, geometry, weights: [0.0; FEATURES], leaving, reaching, index, mean };
        let mut regression = Logistic::default();
        for (idx, own) in evidence.iter().enumerate().filter(|(_, own)| own.tries > 0) {
            let failures = f64::from(own.tries - own.successes);
            regression.add(predictor.features(idx, evidence), f64::from(own.successes), failures);
        }
        predictor.weights = regression.fit();
        predictor
    }

    fn features(&self, idx: usize, evidence: &[Evidence]) -> [f64; FEATURES] {
        let key = self.candidates[idx];
        let own = &evidence[idx];
        let back = self.index.get(&key.reversed()).map(|&back| &evidence[back as usize]).filter(|back| back.tries > 0);
        let mut features = [0.0; FEATURES];
        features.iter_mut().zip(&self.geometry[idx]).for_each(|(feature, &value)| *feature = f64::from(value));
        features[GEOMETRY] = self.leaving[key.from.idx()].without(own, self.mean) - self.mean;
        features[GEOMETRY + 1] = self.reaching[key.to.idx()].without(own, self.mean) - self.mean;
        features[GEOMETRY + 2] = back.map_or(0.0, |back| back.success_rate() - 0.5);
        features
    }

    /// Estimates the chance that a probe of candidate `idx` succeeds, in [0, 1], without regard to its own probes.
    pub fn chance(&self, idx: usize, evidence: &[Evidence]) -> f64 {
        sigmoid(dot(&self.weights, &self.features(idx, evidence)))
    }
}
