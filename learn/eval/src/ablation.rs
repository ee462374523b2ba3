//! What each of our choices adds: from the paper's method to ours, one factor at a time.
//!
//! Every factor is changed alone twice: added to the paper's method, and taken from ours. All cases run on the same
//! maps with the same goals, so differences are paired by map.

use super::config::{EvalConfig, EvalError, Method, Price};
use super::intervals::Interval;
use super::report;
use super::run::run_cases;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use strum::VariantArray;
use surefoot_planner::{Attach, BuildSettings, Placement, Probing};
use surefoot_policy::Policy;
use surefoot_rollout::FollowConfig;

/// One of our choices in which we differ from the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, VariantArray)]
#[serde(rename_all = "snake_case")]
pub enum Factor {
    /// The reactive policy that was trained on all kinds of maps, instead of the LSTM of the paper's kind.
    Policy,
    /// Observations include zip lines and teleporters.
    Transports,
    /// Vertices and candidates at devices and ledges.
    SpecialMoves,
    /// Frugal probing at a lower threshold, proofs on the run, parts that are joined; instead of all probes of every
    /// candidate.
    Probing,
    /// Start and goal are joined to several vertices.
    Attach,
    /// Edges cost what their risks are worth.
    Price,
    /// Failed legs are avoided, and NPCs give up on unreachable goals.
    Memory,
    /// NPCs rehearse the next legs.
    Rehearsals,
}

impl Factor {
    /// What is changed, for tables.
    pub fn about(self) -> &'static str {
        match self {
            Factor::Policy => "reactive policy of all kinds instead of the LSTM",
            Factor::Transports => "bearings of zip lines and teleporters",
            Factor::SpecialMoves => "vertices and candidates at devices and ledges",
            Factor::Probing => "frugal probing, proofs on the run, joined parts",
            Factor::Attach => "several vertices for start and goal",
            Factor::Price => "risk in prices",
            Factor::Memory => "failed legs are remembered, at most 16 re-plans",
            Factor::Rehearsals => "rehearsals",
        }
    }
}

/// The policies of an ablation.
#[derive(Debug, Clone)]
pub struct Policies {
    /// The paper's kind: with an LSTM.
    pub recurrent: Policy,
    /// Ours.
    pub reactive: Policy,
}

/// Result of one case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaseReport {
    /// The factors that are ours; all others are the paper's.
    pub ours: Vec<Factor>,
    /// Success over all goals, with its interval over maps.
    pub success: Interval,
    /// Success over the farthest third of goals.
    pub hard: f64,
    /// Number of attempts by their end.
    pub ends: BTreeMap<String, usize>,
}

/// The results of an ablation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AblationReport {
    /// Decisions without progress that end an attempt.
    pub patience: u32,
    /// Decisions without progress that cause a re-plan.
    pub replan_after: u32,
    /// Goals of each map and seed.
    pub goals: usize,
    /// Hashes of the weights: recurrent, reactive.
    pub weights: [String; 2],
    /// The paper's method.
    pub paper: CaseReport,
    /// Ours.
    pub ours: CaseReport,
    /// For each factor: the paper's method with it, and what it adds in points; ours without it, and what it adds
    /// there.
    pub factors: Vec<FactorReport>,
}

/// What one factor adds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FactorReport {
    /// The factor.
    pub factor: Factor,
    /// The paper's method with the factor.
    pub alone: CaseReport,
    /// What it adds to the paper's method.
    pub adds_to_paper: Interval,
    /// Ours without the factor.
    pub without: CaseReport,
    /// What it adds to our other choices.
    pub adds_to_ours: Interval,
}

/// The policy and the configuration in which these factors are ours. Patience and the pace of re-plans are those of
/// `base`.
fn case(policies: &Policies, base: &EvalConfig, settings: BuildSettings, ours: &[Factor]) -> (Policy, EvalConfig) {
    let is = |factor: Factor| ours.contains(&factor);
    let policy = if is(Factor::Policy) { &policies.reactive } else { &policies.recurrent }.clone();
    let policy = if is(Factor::Transports) { policy } else { policy.without_transports() };
    let paper = BuildSettings::of_paper(Placement::Spaced);
    let settings = settings.with(|it| {
        it.special_moves = is(Factor::SpecialMoves);
        if !is(Factor::Probing) {
            (it.probing, it.threshold, it.repeats) = (Probing::Exhaustive, paper.threshold, paper.repeats);
        }
    });
    let (limits, usual) = (base.follow, FollowConfig::default());
    let follow = FollowConfig {
        remembers: is(Factor::Memory),
        max_replans: if is(Factor::Memory) { usual.max_replans } else { u32::MAX },
        attach: if is(Factor::Attach) { Attach::Several } else { Attach::Nearest },
        composes: false,
        ..limits
    };
    let config = EvalConfig {
        method: Method::Graph(settings.expect("settings of both are within the limits")),
        follow,
        price: if is(Factor::Price) { Price::Risk } else { Price::Steps },
        rehearses: is(Factor::Rehearsals),
        ..base.clone()
    };
    (policy, config)
}

/// Runs all cases on the maps of `base`, map by map, so that cases share graphs. `progress` gets the numbers of
/// finished and of all units.
///
/// # Errors
/// As for [`super::evaluate`], and if there are fewer than two maps.
pub fn run(
    policies: &Policies,
    base: &EvalConfig,
    settings: BuildSettings,
    mut progress: impl FnMut(usize, usize),
) -> Result<AblationReport, EvalError> {
    if base.maps.len() < 2 {
        return Err(EvalError::TooFewMaps);
    }
    let all = Factor::VARIANTS;
    let without = |factor: Factor| all.iter().copied().filter(|it| *it != factor).collect::<Vec<_>>();
    let mut sets: Vec<Vec<Factor>> = vec![Vec::new(), all.to_vec()];
    sets.extend(all.iter().map(|factor| vec![*factor]));
    sets.extend(all.iter().map(|factor| without(*factor)));
    let cases: Vec<(Policy, EvalConfig)> = sets.iter().map(|ours| case(policies, base, settings, ours)).collect();
    let (mut done, total) = (0, base.maps.len() * base.seeds.len() * cases.len());
    let units = run_cases(&cases.iter().map(|(policy, config)| (policy, config)).collect::<Vec<_>>(), || {
        done += 1;
        progress(done, total);
    })?;
    let report = |idx: usize| CaseReport {
        ours: sets[idx].clone(),
        success: Interval::of(&units[idx]).expect("two maps or more"),
        hard: report::success(&units[idx]).hard.rate,
        ends: report::count_ends(&units[idx]),
    };
    let differ =
        |one: usize, other: usize| Interval::of_difference(&units[one], &units[other]).expect("two maps or more");
    let count = all.len();
    let factors = all.iter().enumerate().map(|(idx, &factor)| FactorReport {
        factor,
        alone: report(2 + idx),
        adds_to_paper: differ(2 + idx, 0),
        without: report(2 + count + idx),
        adds_to_ours: differ(1, 2 + count + idx),
    });
    Ok(AblationReport {
        patience: base.follow.patience,
        replan_after: base.follow.replan_after,
        goals: base.goals,
        weights: [&policies.recurrent, &policies.reactive].map(|policy| policy.weights_hash().to_owned()),
        paper: report(0),
        ours: report(1),
        factors: factors.collect(),
    })
}

impl AblationReport {
    /// The results as a Markdown table.
    pub fn markdown(&self) -> String {
        let mut text = format!(
            "{} maps, {} goals each; an attempt ends after {} decisions without progress, a leg after {}. Success in \
             % with 95 % intervals over maps.\n\n\
             The paper's method: {}. Ours: {}.\n\n\
             | our choice | alone, on the paper's method | adds | ours without it | adds |\n|---|---|---|---|---|\n",
            self.paper.success.maps,
            self.goals,
            self.patience,
            self.replan_after,
            self.paper.success.percent(),
            self.ours.success.percent(),
        );
        for it in &self.factors {
            text += &format!(
                "| {} | {} | {} | {} | {} |\n",
                it.factor.about(),
                it.alone.success.percent(),
                it.adds_to_paper.points(),
                it.without.success.percent(),
                it.adds_to_ours.points(),
            );
        }
        text
    }
}
