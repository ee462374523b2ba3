//! `surefoot graph`.

mod edit;
mod export;
mod reach;
mod show;

use super::game::WorldArgs;
use super::map::{BodyArg, Source};
use super::services::{CacheArgs, GraphArgs};
use super::{core_count, load_policy};
use crate::terminal::progress_bar;
use anyhow::{Context, bail};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use surefoot_game_client::probes;
use surefoot_planner::edits::{Unapplied, apply_layers};
use surefoot_planner::store::{GraphStore, LevelId};
use surefoot_planner::{BuildSettings, BuildStats, Built, GraphId, NavGraph, Progress, Rehearsed};
use surefoot_planner_service::store::DiskStore;
use surefoot_rollout::ProbeContext;
use surefoot_rollout::graphs;
use surefoot_world::Map;

/// Build, show, check, edit and export graphs.
#[derive(clap::Subcommand)]
pub enum Command {
    /// Build the graph of a map, or load it from the cache, and describe or draw it
    #[command(visible_alias = "show")]
    Build(show::Args),
    /// Write a graph for other programs: GraphML, JSON, or its links for the NavMesh of an engine
    Export(export::Args),
    /// Find places that no character reaches: islands, one-way traps, and what depends on each ability
    Reach(reach::Args),
    /// Compare what is reachable in two versions of a level
    Diff(reach::DiffArgs),
    /// Forbid, force or re-price edges; add, move or remove vertices
    Edit(edit::Args),
}

/// Runs a command.
pub fn run(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Build(args) => show::run(args),
        Command::Export(args) => export::run(args),
        Command::Reach(args) => reach::run(args),
        Command::Diff(args) => reach::diff(args),
        Command::Edit(args) => edit::run(args),
    }
}

/// Selects a graph.
#[derive(clap::Args, Clone)]
pub struct Target {
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    graph: GraphArgs,
    #[command(flatten)]
    cache: CacheArgs,
    /// Folder of the model, or general-reactive or general-lstm; default: general-reactive
    #[arg(long, value_name = "FOLDER")]
    model: Option<PathBuf>,
    #[command(flatten)]
    body: BodyArg,
    #[command(flatten)]
    world: WorldArgs,
    /// Ignore the edits of the level
    #[arg(long)]
    without_edits: bool,
}

/// A graph with the inputs of its build.
struct Loaded {
    context: ProbeContext,
    /// `None` for a graph that was proved in a game: an id identifies a graph in our own physics.
    id: Option<GraphId>,
    /// With edits applied.
    graph: NavGraph,
    stats: BuildStats,
    cached: bool,
    unapplied: Vec<Unapplied>,
    /// Candidates that were probed again after a change of the map; `None` unless the graph was updated.
    retried: Option<u64>,
    /// Edges that a game did not prove; `None` unless the graph was proved in a game.
    of_draft: Option<u64>,
}

impl Loaded {
    /// A graph in our own physics, without edits.
    fn of(context: ProbeContext, id: Option<GraphId>, built: Built, cached: bool) -> Self {
        let Built { graph, stats } = built;
        let (unapplied, retried, of_draft) = Default::default();
        Self { context, id, graph, stats, cached, unapplied, retried, of_draft }
    }
}

impl Target {
    fn context(&self, source: &Source) -> anyhow::Result<ProbeContext> {
        let (map, profile) = (source.load()?, self.body.profile()?);
        Ok(ProbeContext { map: Arc::new(map), profile, policy: load_policy(self.model.as_deref())? })
    }

    /// The level that layers belong to: a generated map's spec, or the name of a file, which outlives changes of the
    /// level.
    fn level(&self, map: &Map) -> LevelId {
        match map.spec() {
            Some(spec) => LevelId::of_spec(spec),
            None => {
                let name = Path::new(&self.source.map).file_name().unwrap_or_default();
                LevelId::of(name.as_encoded_bytes())
            }
        }
    }

    /// Takes the graph from the cache or builds it, starting from the graph of an earlier version of the map if one is
    /// given, and applies the level's edits.
    fn load(&self, changed_from: Option<&str>) -> anyhow::Result<Loaded> {
        let (source, earlier) = match changed_from {
            Some(earlier) => self.source.versions(earlier).map(|[own, earlier]| (own, Some(earlier)))?,
            None => (self.source.clone(), None),
        };
        self.load_in(self.context(&source)?, earlier.as_ref())
    }

    fn load_in(&self, context: ProbeContext, changed_from: Option<&Source>) -> anyhow::Result<Loaded> {
        let settings = self.graph.settings()?;
        let store = self.cache.open()?;
        let id = graphs::id_of(&context, &settings);
        if let Some(game) = self.world.connect()? {
            if changed_from.is_some() {
                bail!("--changed-from cannot be combined with --world: a game proves all edges again");
            }
            // It is not cached, because games have no identity.
            let Rehearsed { built, of_draft } =
                with_bar(|progress| probes::build(&game, &context, &settings, core_count(), progress))?;
            let loaded = Loaded { of_draft: Some(of_draft), ..Loaded::of(context, None, built, false) };
            return self.edited(store, loaded, settings);
        }
        let mut retried = None;
        let (built, cached) = get_or_make(&store, &id, || {
            let Some(earlier) = changed_from else { return build_with_bar(&context, &settings) };
            let old = ProbeContext { map: Arc::new(earlier.load()?), ..context.clone() };
            let old_id = graphs::id_of(&old, &settings);
            let (graph, _) = get_or_make(&store, &old_id, || build_with_bar(&old, &settings))?;
            let updated = with_bar(|progress| {
                graphs::update((&graph.graph, &*old.map), &context, &settings, core_count(), progress)
            })?;
            retried = Some(updated.retried);
            Ok(updated.built)
        })?;
        self.edited(store, Loaded { retried, ..Loaded::of(context, Some(id), built, cached) }, settings)
    }

    /// Applies the level's edits.
    fn edited(&self, store: DiskStore, mut loaded: Loaded, settings: BuildSettings) -> anyhow::Result<Loaded> {
        let context = &loaded.context;
        let layers = if self.without_edits { Vec::new() } else { store.layers(&self.level(&context.map))?.whole()? };
        if !layers.is_empty() {
            let terrain = graphs::terrain(context, settings, core_count());
            let edited = apply_layers(&loaded.graph, &layers, settings.threshold, &terrain)
                .context("the edits were cancelled")?;
            (loaded.graph, loaded.unapplied) = (edited.graph, edited.unapplied);
        }
        Ok(loaded)
    }
}

/// Returns a graph from the cache, or else makes and caches it; and whether it was in the cache.
fn get_or_make(
    store: &DiskStore,
    id: &GraphId,
    make: impl FnOnce() -> anyhow::Result<Built>,
) -> anyhow::Result<(Built, bool)> {
    if let Some(built) = store.get(id)? {
        return Ok((built, true));
    }
    let built = make()?;
    store.put(id, &built)?;
    Ok((built, false))
}

fn build_with_bar(context: &ProbeContext, settings: &BuildSettings) -> anyhow::Result<Built> {
    with_bar(|progress| graphs::build(context, settings, core_count(), progress))
}

/// Runs a build and shows its progress.
fn with_bar<T: Send, E: std::error::Error + Send + Sync + 'static>(
    work: impl FnOnce(&Progress) -> Result<T, E> + Send,
) -> anyhow::Result<T> {
    let progress = Progress::default();
    let bar = progress_bar(0, "probing");
    let result = std::thread::scope(|scope| {
        let working = scope.spawn(|| work(&progress));
        while !working.is_finished() {
            bar.set_length(progress.total.load(Ordering::Relaxed));
            bar.set_position(progress.done.load(Ordering::Relaxed));
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
        working.join().expect("a build does not panic")
    });
    bar.finish_and_clear();
    Ok(result?)
}

impl Loaded {
    /// Prints the edits that could not be applied.
    fn print_unapplied(&self) {
        for Unapplied { layer, index, reason } in &self.unapplied {
            println!("edit {index} of layer `{layer}` is unapplied: {}", reason.describe(self.context.map.frame()));
        }
    }
}
