//! NPCs that follow plans on one core: composed, where most decisions are steered, and moved by their policy only.

use super::{Figure, timed_with};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::Arc;
use surefoot_cli::commands::core_count;
use surefoot_planner::search::DEFAULT_LABEL_LIMIT;
use surefoot_planner::{BuildSettings, Progress, Router};
use surefoot_policy::Policy;
use surefoot_rollout::attempts::Figures;
use surefoot_rollout::graphs::build;
use surefoot_rollout::{Goal, ProbeContext, Rollout};
use surefoot_world::{CharacterProfile, End, MapSpec, TaskConfig, navigable};

/// Seed of the map, which no policy was trained on.
const SEED: u64 = 1001;
/// Number of goals, which are attempted together.
const GOALS: usize = 128;
/// Straight-line distances of the goals, m.
const DISTANCES: std::ops::Range<f32> = 5.0..150.0;
/// Number of runs of each kind, which take turns.
const RUNS: usize = 5;

/// One run of all goals.
struct Run {
    figures: Figures,
    reached: usize,
    seconds: f64,
}

impl Run {
    fn decisions_per_s(&self) -> f64 {
        self.figures.motion.decisions as f64 / self.seconds
    }
}

/// The run that took the least time: the one that other processes disturbed least.
fn fastest(runs: Vec<Run>) -> Option<Run> {
    runs.into_iter().min_by(|a, b| a.seconds.total_cmp(&b.seconds))
}

/// All figures of `bench follow`. Graph and goals are the same for both kinds of NPCs.
pub fn figures() -> anyhow::Result<Vec<Figure>> {
    let (map, policy) = (Arc::new(surefoot_generate::generate(&MapSpec::new(SEED))), Policy::shipped()?);
    let context = ProbeContext::new(map.clone(), policy.clone());
    let graph = build(&context, &BuildSettings::default(), core_count(), &Progress::default())?.graph;
    let router = Router::new(graph, DEFAULT_LABEL_LIMIT, core_count());
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let points = navigable::sample_many(&map, &CharacterProfile::default(), 2000, &mut rng)?;
    let goals = Goal::draw(&points, DISTANCES, GOALS, &mut rng);
    let run = |composes: bool| {
        let mut rollout = Rollout::new(map.clone(), CharacterProfile::default(), TaskConfig::default());
        rollout.follow.composes = composes;
        let mut figures = Figures::default();
        let (attempts, seconds) = timed_with(|| rollout.measure(&policy, Some(&router), &goals, &mut figures));
        let reached = attempts.iter().filter(|attempt| attempt.end == End::Reached).count();
        Run { figures, reached, seconds }
    };
    let (mut composed, mut free) = (Vec::new(), Vec::new());
    for _ in 0..RUNS {
        composed.push(run(true));
        free.push(run(false));
    }
    let fastest = fastest(composed).zip(fastest(free));
    Ok(fastest.map_or(Vec::new(), |(composed, free)| table(&composed, &free)))
}

fn table(composed: &Run, free: &Run) -> Vec<Figure> {
    const PEER: &str = "moved by the policy only";
    let per_s = composed.decisions_per_s();
    let peer_per_s = free.decisions_per_s();
    let beside = |name: &'static str, unit, higher_is_better, figure: &dyn Fn(&Run) -> f64| {
        Figure::new(name, figure(composed), unit).with_reference(PEER, figure(free), higher_is_better)
    };
    let share = |seconds: fn(&Figures) -> f64| move |run: &Run| 100.0 * seconds(&run.figures) / run.seconds;
    let per_goal = |run: &Run| 1000.0 * run.seconds / GOALS as f64;
    vec![
        Figure::new("follow_decisions_s", per_s, "1/s")
            .at_least(1.3 * peer_per_s)
            .with_reference(PEER, peer_per_s, true),
        beside("follow_goal_ms", "ms", false, &per_goal),
        beside("follow_reached", "%", true, &|run| 100.0 * run.reached as f64 / GOALS as f64),
        Figure::new("steered", steered(composed), "% of decisions"),
        beside("search_share", "% of the time", false, &share(|it| it.times.search_us.iter().sum::<f64>() / 1.0e6)),
        beside("review_share", "% of the time, searches included", false, &share(|it| it.times.review_s)),
        beside("rehearsal_share", "% of the time", false, &share(|it| it.times.rehearsal_s)),
        beside("decision_share", "% of the time: senses, policy, ticks", false, &share(|it| it.decide_s)),
        beside("decide_us", "us per decision, without plans and rehearsals", false, &decide_us),
    ]
}

/// Share of the decisions that were steered, %.
fn steered(run: &Run) -> f64 {
    100.0 * run.figures.steered as f64 / run.figures.motion.decisions.max(1) as f64
}

/// Time of a decision without plans and rehearsals, us.
fn decide_us(run: &Run) -> f64 {
    1.0e6 * run.figures.decide_s / run.figures.motion.decisions.max(1) as f64
}
