//! Reports: success rates and mean figures over units.

use super::config::EvalConfig;
use super::intervals::Interval;
use super::maps::{EvalMap, MapName};
use super::unit::{GraphFigures, Unit};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use surefoot_policy::Policy;
use surefoot_rollout::follow::Fault;
use surefoot_rollout::{AttemptResult, Motion};
use surefoot_world::{DECISION_SECONDS, End};

/// A success rate with its 95 % Wilson interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Rate {
    /// Share of attempts that succeeded, 0 to 1.
    pub rate: f64,
    /// Lower bound of the interval.
    pub low: f64,
    /// Upper bound of the interval.
    pub high: f64,
    /// Number of attempts.
    pub n: usize,
}

impl Rate {
    /// The rate of `successes` in `n` attempts; without attempts, rate 0 and the interval from 0 to 1.
    pub fn of(successes: usize, n: usize) -> Self {
        if n == 0 {
            return Self { rate: 0.0, low: 0.0, high: 1.0, n };
        }
        let (z, count) = (1.959_964f64, n as f64);
        let rate = successes as f64 / count;
        let centre = rate + z * z / (2.0 * count);
        let spread = z * (rate * (1.0 - rate) / count + z * z / (4.0 * count * count)).sqrt();
        let scale = 1.0 + z * z / count;
        // At rates of 0 and 1, rounding could put the rate just outside its interval.
        Self {
            rate,
            low: ((centre - spread) / scale).clamp(0.0, rate),
            high: ((centre + spread) / scale).clamp(rate, 1.0),
            n,
        }
    }
}

/// Success rates by difficulty: thirds of each unit's goals by distance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Success {
    /// Success over all goals.
    pub all: Rate,
    /// Success over the nearest third.
    pub easy: Rate,
    /// Success over the middle third.
    pub medium: Rate,
    /// Success over the farthest third.
    pub hard: Rate,
}

/// The result of an evaluation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// `policy`, or the name of a placement.
    pub method: String,
    /// Name of the model.
    pub model: String,
    /// Seeds of generated maps, names of levels.
    pub maps: Vec<MapName>,
    /// Number of goals per map and seed.
    pub goals: usize,
    /// Seeds of goals, graphs and noise.
    pub seeds: Vec<u64>,
    /// Success rates.
    pub success: Success,
    /// Standard deviation of the overall rate between seeds; absent with one seed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spread: Option<f64>,
    /// Success over all goals with an interval over maps instead of goals; absent with one map.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by_map: Option<Interval>,
    /// What was reached on each map, in the order of `maps`.
    pub per_map: Vec<MapReport>,
    /// Number of attempts by outcome.
    pub ends: BTreeMap<String, usize>,
    /// Number of failed attempts that followed plans, by fault.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub faults: BTreeMap<String, usize>,
    /// Mean duration of successful attempts, s.
    pub seconds_to_goal: f64,
    /// Mean of straight-line distance over distance covered, over successful attempts.
    pub directness: f64,
    /// Mean number of re-plans per attempt.
    pub replans: f64,
    /// How the NPCs moved.
    pub motion: MotionReport,
    /// Mean figures of the graphs; absent without graphs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub graph: Option<GraphFigures>,
}

/// How NPCs moved, over all attempts, as a spectator sees it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MotionReport {
    /// How often per second a heading that had turned to one side turned back by five degrees or more.
    pub reversals_per_s: f64,
    /// Median of the angle between facing and motion, degrees.
    pub facing_p50_deg: f64,
    /// The same angle at the 90th percentile.
    pub facing_p90_deg: f64,
    /// Jumps per 100 m.
    pub jumps_per_100m: f64,
    /// Share of the time in the air.
    pub air_share: f64,
    /// Mean change of acceleration on the plane, m/s3.
    pub jerk: f64,
    /// Share of the distance on legs of plans that can be walked.
    pub walk_share: f64,
    /// Jumps per 100 m on these legs.
    pub walk_jumps_per_100m: f64,
    /// Share of the time in the air on these legs.
    pub walk_air_share: f64,
    /// Share of the decisions for which rehearsals predicted the place a second later, and whose plan stood until then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub predicted_share: Option<f64>,
    /// Share of these predictions that were within 0.15 m; absent without any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prediction_close_share: Option<f64>,
}

impl MotionReport {
    fn of(units: &[Unit]) -> Self {
        let mut motion = Motion::default();
        units.iter().for_each(|unit| motion.add(&unit.motion));
        Self {
            reversals_per_s: motion.reversals_per_s(),
            facing_p50_deg: motion.facing_deg(0.5),
            facing_p90_deg: motion.facing_deg(0.9),
            jumps_per_100m: motion.all.jumps_per_100m(),
            air_share: motion.all.air_share(),
            jerk: motion.mean_jerk(),
            walk_share: motion.walk.metres / motion.all.metres.max(f64::MIN_POSITIVE),
            walk_jumps_per_100m: motion.walk.jumps_per_100m(),
            walk_air_share: motion.walk.air_share(),
            predicted_share: motion.close_share().map(|_| motion.predicted as f64 / motion.decisions.max(1) as f64),
            prediction_close_share: motion.close_share(),
        }
    }
}

/// What was reached on one map. All shares are 0 to 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MapReport {
    /// Seed of a generated map, name of a level.
    pub map: MapName,
    /// Share of the ground that belongs to the playable area, from which goals were drawn; absent if they come from
    /// everywhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub playable: Option<f64>,
    /// Share of goals that a survey or a proved edge connects with their start.
    pub reachable: f64,
    /// Share of the reachable goals that were reached.
    pub success_reachable: f64,
    /// Share of the attempts at reachable goals that came to harm.
    pub died: f64,
    /// How well the promised chances hold; absent without plans.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Calibration>,
    /// How often NPCs complete their first plan, by its promised chance; null without plans.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration_as_planned: Option<Calibration>,
    /// Share of the attempts at unreachable goals that were reported as unreachable; null without such goals.
    pub told: Option<f64>,
    /// Share of the attempts at unreachable goals that came to harm; null without such goals.
    pub died_unreachable: Option<f64>,
    /// Median number of plans of the attempts at unreachable goals; absent without such goals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plans_unreachable: Option<f64>,
    /// Median duration of the attempts at unreachable goals, s; absent without such goals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds_unreachable: Option<f64>,
}

/// How often NPCs arrive, or arrive as planned, by the promised chance of their plans.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// Mean square of the difference between promise and arrival (Brier 1950): 0 is best.
    pub brier: f64,
    /// Attempts by the promised chance of their first plans; empty bins are left out.
    pub bins: Vec<CalibrationBin>,
}

/// Attempts whose first plans promised about the same chance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CalibrationBin {
    /// Lower bound of the promised chance.
    pub low: f64,
    /// Upper bound of the promised chance.
    pub high: f64,
    /// Mean of the promised chances.
    pub promised: f64,
    /// Share that arrived: re-plans included, or as planned.
    pub arrived: f64,
    /// Number of attempts.
    pub n: usize,
}

impl Calibration {
    /// Bounds of the bins.
    const BOUNDS: [f64; 9] = [0.0, 0.5, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98, 1.0];

    /// The calibration of the chances of arriving, re-plans included.
    fn of_arrivals<'u>(attempts: impl Iterator<Item = &'u AttemptResult>) -> Option<Self> {
        Self::of(attempts.filter_map(|it| Some((it.promised_arrival?, it.end == End::Reached))))
    }

    /// The calibration of the chances of arriving as planned.
    fn of_plans<'u>(attempts: impl Iterator<Item = &'u AttemptResult>) -> Option<Self> {
        Self::of(attempts.filter_map(|it| Some((it.promised?, it.end == End::Reached && it.plans == 1))))
    }

    /// The calibration of chances, each with its outcome.
    fn of(promised: impl Iterator<Item = (f32, bool)>) -> Option<Self> {
        let all: Vec<(f64, f64)> = promised.map(|(chance, is)| (f64::from(chance), f64::from(u8::from(is)))).collect();
        let mean = |values: &mut dyn Iterator<Item = f64>, n: usize| values.sum::<f64>() / n as f64;
        let bin = |bounds: &[f64]| {
            let (low, high) = (bounds[0], bounds[1]);
            let within: Vec<_> =
                all.iter().filter(|&&(chance, _)| chance >= low && (chance < high || high == 1.0)).collect();
            (!within.is_empty()).then(|| CalibrationBin {
                low,
                high,
                promised: mean(&mut within.iter().map(|it| it.0), within.len()),
                arrived: mean(&mut within.iter().map(|it| it.1), within.len()),
                n: within.len(),
            })
        };
        (!all.is_empty()).then(|| Self {
            brier: mean(&mut all.iter().map(|(chance, arrived)| (chance - arrived).powi(2)), all.len()),
            bins: Self::BOUNDS.windows(2).filter_map(bin).collect(),
        })
    }
}

impl MapReport {
    fn of(map: &MapName, units: &[Unit]) -> Self {
        let of_map = || units.iter().filter(|unit| unit.map == *map);
        let all: Vec<(bool, End)> = of_map()
            .flat_map(|unit| unit.reachable.iter().copied().zip(unit.attempts.iter().map(|attempt| attempt.end)))
            .collect();
        let share = |among_reachable: bool, counts: fn(End) -> bool| {
            let ends = || all.iter().filter(|&&(reachable, _)| reachable == among_reachable);
            let total = ends().count();
            (total > 0).then(|| ends().filter(|&&(_, end)| counts(end)).count() as f64 / total as f64)
        };
        let unreachable: Vec<&AttemptResult> = of_map()
            .flat_map(|unit| unit.reachable.iter().zip(&unit.attempts))
            .filter_map(|(reachable, attempt)| (!reachable).then_some(attempt))
            .collect();
        Self {
            map: map.clone(),
            playable: of_map().find_map(|unit| unit.playable),
            reachable: all.iter().filter(|(reachable, _)| *reachable).count() as f64 / all.len().max(1) as f64,
            success_reachable: share(true, |end| end == End::Reached).unwrap_or_default(),
            died: share(true, End::is_harm).unwrap_or_default(),
            calibration: Calibration::of_arrivals(of_map().flat_map(|unit| &unit.attempts)),
            calibration_as_planned: Calibration::of_plans(of_map().flat_map(|unit| &unit.attempts)),
            told: share(false, |end| end == End::Unreachable),
            died_unreachable: share(false, End::is_harm),
            plans_unreachable: median(unreachable.iter().map(|attempt| f64::from(attempt.plans))),
            seconds_unreachable: median(
                unreachable.iter().map(|attempt| f64::from(attempt.decisions) * f64::from(DECISION_SECONDS)),
            ),
        }
    }
}

/// The median of values, the upper one of an even number; `None` without values.
fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Summarises units.
pub fn summarise(policy: &Policy, config: &EvalConfig, units: &[Unit]) -> Report {
    let reached: Vec<(f32, &AttemptResult)> = units
        .iter()
        .flat_map(|unit| unit.distances.iter().copied().zip(&unit.attempts))
        .filter(|(_, attempt)| attempt.end == End::Reached)
        .collect();
    let directness: f64 =
        reached.iter().map(|&(distance, attempt)| f64::from(distance / attempt.length.max(distance))).sum();
    let replans: f64 = attempts(units).map(|attempt| f64::from(attempt.replans)).sum();
    Report {
        method: config.method.name().to_owned(),
        model: policy.manifest().name.clone(),
        per_map: config.maps.iter().map(|map| MapReport::of(&map.name(), units)).collect(),
        maps: config.maps.iter().map(EvalMap::name).collect(),
        goals: config.goals,
        seeds: config.seeds.clone(),
        success: success(units),
        spread: spread(units, &config.seeds),
        by_map: Interval::of(units),
        ends: count_ends(units),
        faults: count_faults(units),
        seconds_to_goal: seconds_to_goal(units),
        directness: directness / reached.len().max(1) as f64,
        replans: replans / attempts(units).count().max(1) as f64,
        motion: MotionReport::of(units),
        graph: graph_figures(units),
    }
}

/// Standard deviation of the overall rate between seeds; `None` with one seed.
pub fn spread(units: &[Unit], seeds: &[u64]) -> Option<f64> {
    let of_seed = |seed: u64| rate(units.iter().filter(|unit| unit.seed == seed), None).rate;
    let rates: Vec<f64> = seeds.iter().map(|&seed| of_seed(seed)).collect();
    let mean = rates.iter().sum::<f64>() / rates.len() as f64;
    let squares: f64 = rates.iter().map(|rate| (rate - mean).powi(2)).sum();
    (rates.len() > 1).then(|| (squares / (rates.len() - 1) as f64).sqrt())
}

/// Mean duration of successful attempts, s; 0 if none succeeded.
pub fn seconds_to_goal(units: &[Unit]) -> f64 {
    let reached = attempts(units).filter(|attempt| attempt.end == End::Reached);
    let (count, decisions) =
        reached.fold((0usize, 0.0), |(count, sum), attempt| (count + 1, sum + f64::from(attempt.decisions)));
    decisions / count.max(1) as f64 * f64::from(DECISION_SECONDS)
}

/// The outcomes of attempts whose NPCs share no goals.
pub(crate) fn outcomes() -> impl Iterator<Item = End> {
    End::ALL.iter().copied().filter(|end| *end != End::ReachedNear)
}

/// Number of attempts by outcome; every outcome of attempts whose NPCs share no goals has an entry.
pub fn count_ends(units: &[Unit]) -> BTreeMap<String, usize> {
    let mut ends: BTreeMap<String, usize> = outcomes().map(|end| (end.name().to_owned(), 0)).collect();
    for attempt in attempts(units) {
        *ends.entry(attempt.end.name().to_owned()).or_default() += 1;
    }
    ends
}

/// Number of failed attempts that followed plans, by fault; empty if no unit used a graph.
pub fn count_faults(units: &[Unit]) -> BTreeMap<String, usize> {
    let mut faults: BTreeMap<String, usize> = BTreeMap::new();
    for unit in units.iter().filter(|unit| unit.graph.is_some()) {
        Fault::ALL.iter().for_each(|fault| {
            faults.entry(fault.name().to_owned()).or_default();
        });
        for fault in unit.attempts.iter().filter_map(|attempt| attempt.fault) {
            *faults.entry(fault.name().to_owned()).or_default() += 1;
        }
    }
    faults
}

fn attempts(units: &[Unit]) -> impl Iterator<Item = &AttemptResult> {
    units.iter().flat_map(|unit| &unit.attempts)
}

/// Success rates by difficulty.
pub fn success(units: &[Unit]) -> Success {
    let third = |which| rate(units.iter(), Some(which));
    Success { all: rate(units.iter(), None), easy: third(0), medium: third(1), hard: third(2) }
}

/// Success rate over one third of each unit's goals, or over all.
fn rate<'u>(units: impl Iterator<Item = &'u Unit>, third: Option<usize>) -> Rate {
    let (mut reached, mut n) = (0, 0);
    for unit in units {
        let count = unit.attempts.len();
        // Goals are sorted by distance, so thirds are ranges.
        let kept =
            unit.attempts.iter().enumerate().filter(|(idx, _)| third.is_none_or(|third| idx * 3 / count == third));
        for (_, attempt) in kept {
            n += 1;
            reached += usize::from(attempt.end == End::Reached);
        }
    }
    Rate::of(reached, n)
}

/// Mean figures of the graphs; `None` if no unit used a graph.
pub fn graph_figures(units: &[Unit]) -> Option<GraphFigures> {
    let graphs: Vec<&GraphFigures> = units.iter().filter_map(|unit| unit.graph.as_ref()).collect();
    let mean =
        |value: fn(&GraphFigures) -> f64| graphs.iter().map(|&graph| value(graph)).sum::<f64>() / graphs.len() as f64;
    (!graphs.is_empty()).then(|| GraphFigures {
        vertices: mean(|graph| graph.vertices),
        edges: mean(|graph| graph.edges),
        islands: mean(|graph| graph.islands),
        connected: mean(|graph| graph.connected),
        build_s: mean(|graph| graph.build_s),
        probes: mean(|graph| graph.probes),
        candidates: mean(|graph| graph.candidates),
        search_us_median: mean(|graph| graph.search_us_median),
        eval_s: mean(|graph| graph.eval_s),
    })
}

/// Success rates by distance in bins of `bin_m` metres, each with the bin's upper end, m.
pub fn by_distance(units: &[Unit], bin_m: f32) -> Vec<(f32, Rate)> {
    let mut counts: BTreeMap<usize, (usize, usize)> = BTreeMap::new();
    for unit in units {
        for (distance, attempt) in unit.distances.iter().zip(&unit.attempts) {
            let (reached, n) = counts.entry((distance / bin_m) as usize).or_default();
            *reached += usize::from(attempt.end == End::Reached);
            *n += 1;
        }
    }
    counts.into_iter().map(|(bin, (reached, n))| ((bin + 1) as f32 * bin_m, Rate::of(reached, n))).collect()
}
