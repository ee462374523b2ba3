//! Builds graphs with probes that run in this process, timed by the process's clock.

use crate::probe::{InProcess, ProbeContext};
use std::sync::Arc;
use std::time::Instant;
use surefoot_planner::edits::MapTerrain;
use surefoot_planner::probe::ProbeExecutor;
use surefoot_planner::update::{Update, Updated};
use surefoot_planner::{BuildError, BuildSettings, Builder, Built, GraphId, NavGraph, Progress, Rehearsed};
use surefoot_world::Map;

/// Id of the graph that a build with `settings` in `context` gives.
pub fn id_of(context: &ProbeContext, settings: &BuildSettings) -> GraphId {
    GraphId::of(&context.site(), &context.policy_hash(), settings)
}

/// Builds a graph on `thread_count` threads.
///
/// # Errors
/// If a setting is out of range, the map has no navigable ground, or `progress.cancel` was set.
pub fn build(
    context: &ProbeContext,
    settings: &BuildSettings,
    thread_count: usize,
    progress: &Progress,
) -> Result<Built, BuildError> {
    with_builder(context, settings, thread_count, progress, |builder| builder.build())
}

/// Updates a graph of `old_map` for the map of `context`.
///
/// # Errors
/// Same as [`build`].
pub fn update(
    (graph, old_map): (&NavGraph, &Map),
    context: &ProbeContext,
    settings: &BuildSettings,
    thread_count: usize,
    progress: &Progress,
) -> Result<Updated, BuildError> {
    with_builder(context, settings, thread_count, progress, |builder| builder.update(graph, old_map))
}

/// Probes what an update of a graph for the map of `context` affects.
///
/// # Errors
/// Same as [`build`].
pub fn finish(
    update: Update,
    context: &ProbeContext,
    settings: &BuildSettings,
    thread_count: usize,
    progress: &Progress,
) -> Result<Updated, BuildError> {
    with_builder(context, settings, thread_count, progress, |builder| builder.finish(update))
}

/// The terrain on which edits of graphs of `context` are probed.
pub fn terrain(context: &ProbeContext, settings: BuildSettings, thread_count: usize) -> MapTerrain {
    let executor = Box::new(InProcess { context: context.clone(), thread_count });
    MapTerrain { site: context.site(), settings, thread_count, executor, progress: Arc::default() }
}

/// Builds a graph with probes that `executor` runs, on `thread_count` threads besides.
///
/// # Errors
/// Same as [`build`], also if `executor` gave up.
pub fn build_by(
    executor: &dyn ProbeExecutor,
    context: &ProbeContext,
    settings: &BuildSettings,
    thread_count: usize,
    progress: &Progress,
) -> Result<Built, BuildError> {
    with_executor(executor, context, settings, thread_count, progress, |builder| builder.build())
}

/// Builds a graph whose draft `rehearsal` proves ([`Builder::build_rehearsed`]), and otherwise like [`build_by`].
///
/// # Errors
/// Same as [`build_by`].
pub fn build_rehearsed_by(
    [executor, rehearsal]: [&dyn ProbeExecutor; 2],
    context: &ProbeContext,
    settings: &BuildSettings,
    thread_count: usize,
    progress: &Progress,
) -> Result<Rehearsed, BuildError> {
    let build = |builder: Builder<'_>| builder.build_rehearsed(rehearsal);
    with_executor(executor, context, settings, thread_count, progress, build)
}

fn with_builder<T>(
    context: &ProbeContext,
    settings: &BuildSettings,
    thread_count: usize,
    progress: &Progress,
    run: impl FnOnce(Builder<'_>) -> T,
) -> T {
    let executor = InProcess { context: context.clone(), thread_count };
    with_executor(&executor, context, settings, thread_count, progress, run)
}

fn with_executor<T>(
    executor: &dyn ProbeExecutor,
    context: &ProbeContext,
    settings: &BuildSettings,
    thread_count: usize,
    progress: &Progress,
    run: impl FnOnce(Builder<'_>) -> T,
) -> T {
    let (site, started) = (context.site(), Instant::now());
    let clock = || started.elapsed().as_secs_f64();
    run(Builder { site: &site, settings, executor, thread_count, clock: &clock, progress })
}
