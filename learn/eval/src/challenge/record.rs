//! Attempts the goals of a set with a policy, straight or by plan, and records a run.

use super::VERSION;
use super::run::{Approach, MAX_DECISIONS, MapRun, Run};
use super::set::{GoalSet, SetMap};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;
use surefoot_planner::search::DEFAULT_LABEL_LIMIT;
use surefoot_planner::threads::map_indices;
use surefoot_planner::{BuildError, BuildSettings, Progress, Router, store};
use surefoot_policy::Policy;
use surefoot_rollout::graphs::build;
use surefoot_rollout::{Goal, ProbeContext, Rollout};
use surefoot_world::{CharacterProfile, End, Map, TaskConfig};

/// Goals that are attempted together.
const BATCH: usize = 50;

/// How our own NPCs attempt a set.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Name of the entrant.
    pub name: String,
    /// The policy.
    pub policy: Policy,
    /// Settings of the graphs that plans are made on; `None` to head straight for goals.
    pub graph: Option<BuildSettings>,
    /// Number of threads.
    pub thread_count: usize,
}

/// Why a run cannot be recorded.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// A map cannot be loaded.
    #[error(transparent)]
    Set(#[from] super::SetError),
    /// A graph cannot be built.
    #[error(transparent)]
    Build(#[from] BuildError),
}

/// Attempts all goals of the set whose files are in `folder`, and returns every action. `progress` gets the name of
/// each map before its attempts.
///
/// # Errors
/// If a map cannot be loaded, or a graph cannot be built.
pub fn record(entry: &Entry, set: &GoalSet, folder: &Path, mut progress: impl FnMut(&str)) -> Result<Run, RecordError> {
    set.check()?;
    let mut maps = Vec::with_capacity(set.maps.len());
    for of_set in &set.maps {
        progress(&of_set.name);
        let map = of_set.load(folder)?;
        maps.push(map_run(entry, &map, &set.body, of_set)?);
    }
    let about = format!("Surefoot {}, {}", env!("CARGO_PKG_VERSION"), entry.policy.label());
    Ok(Run { challenge: VERSION, set: set.set.clone(), entrant: entry.name.clone(), about, maps })
}

fn map_run(entry: &Entry, map: &Arc<Map>, body: &CharacterProfile, of_set: &SetMap) -> Result<MapRun, RecordError> {
    let started = Instant::now();
    let mut bytes = 0;
    let router = match entry.graph {
        None => None,
        Some(settings) => {
            let context = ProbeContext { map: map.clone(), profile: body.clone(), policy: entry.policy.clone() };
            let built = build(&context, &settings, entry.thread_count, &Progress::default())?;
            bytes = store::encode_entry(&built).len() as u64;
            Some(Router::new(built.graph, DEFAULT_LABEL_LIMIT, entry.thread_count))
        }
    };
    let build_s = started.elapsed().as_secs_f64();
    let goals: Vec<Goal> = of_set.goals.iter().copied().map(Goal::from).collect();
    let batches: Vec<&[Goal]> = goals.chunks(BATCH).collect();
    let of_batch = |idx: usize| {
        let mut rollout = Rollout::new(map.clone(), body.clone(), TaskConfig::default());
        rollout.seed = idx as u64;
        rollout.play(&entry.policy, router.as_ref(), batches[idx])
    };
    let attempts = map_indices(batches.len(), entry.thread_count, of_batch).into_iter().flatten();
    let attempts = attempts.map(|played| match played.attempt.end {
        End::Unreachable => Approach::Unreachable,
        _ => Approach::Actions(played.actions.iter().take(MAX_DECISIONS).map(|it| it.to_array()).collect()),
    });
    Ok(MapRun { name: of_set.name.clone(), build_s, bytes, attempts: attempts.collect() })
}
