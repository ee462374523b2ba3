//! Growth of builds, updates, edits, reports and queries with the number of vertices. Probes take no time: a rule
//! decides which of them succeed.

use super::core::floor;
use super::{Case, timed, timed_with};
use crate::bench::world::lift;
use anyhow::Context;
use std::hint::black_box;
use std::sync::Arc;
use surefoot_cli::commands::core_count;
use surefoot_planner::assets::{AssetFormat, LinkSet, Passage, Shape, ShapedEdge};
use surefoot_planner::candidates;
use surefoot_planner::edits::{Edit, Layer, Terrain, apply_layers};
use surefoot_planner::links::{DEFAULT_MAX_DETOUR, NavMesh};
use surefoot_planner::probe::{Outcome, ProbeExecutor, ProbeWatch, Trial};
use surefoot_planner::{
    AbilitySet, BuildSettings, Builder, Built, EdgeKey, NavGraph, Placement, Progress, Query, Router, Site,
    reachability,
};
use surefoot_world::map::{Piece, PieceShape};
use surefoot_world::{Ability, Map, Vec3};

/// Ground for each vertex, m2.
const AREA_M2: f32 = 60.0;
/// Number of vertices of the smallest graphs. The largest graphs have the most vertices that a build allows.
const VERTICES: usize = 4096;
/// Stops of each mover, the most that a map allows.
const STOPS: usize = 16;

/// Decides by a rule which probes succeed.
#[derive(Clone, Copy)]
struct Rule {
    /// Of 16 probes, as many fail; which ones is decided by their places.
    failures: u64,
}

impl Rule {
    fn outcome(self, trial: &Trial) -> Outcome {
        if let Some(via) = trial.via {
            let approach = self.outcome(&Trial { via: None, goal: via, ..*trial });
            let onwards = self.outcome(&Trial { via: None, start: via, ..*trial });
            return Outcome { approach: Some(Box::new(approach)), ..onwards };
        }
        let bits = [trial.start, trial.goal].into_iter().flat_map(|at| [at.x, at.z]);
        let hash = bits.fold(0u64, |hash, value| {
            (hash ^ u64::from(value.to_bits())).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29)
        });
        let decisions = trial.start.distance(trial.goal).ceil() as u32;
        let at = |step: u32| Some(trial.start.lerp(trial.goal, step as f32 / decisions.max(1) as f32));
        Outcome {
            reached: hash % 16 >= self.failures,
            decisions,
            ability: if hash % 3 == 0 { Ability::JUMP } else { Ability::WALK },
            bounds: [trial.start.min(trial.goal), trial.start.max(trial.goal)],
            track: if trial.keep_track { (0..=decisions).map(at).collect() } else { Vec::new() },
            ..Outcome::begin(trial.start)
        }
    }
}

impl ProbeExecutor for Rule {
    fn run(&self, trials: &[Trial], _: u64, watch: &dyn ProbeWatch) -> Option<Vec<Outcome>> {
        let outcomes: Vec<Outcome> = trials.iter().map(|trial| self.outcome(trial)).collect();
        outcomes.iter().enumerate().for_each(|(idx, outcome)| watch.finished(idx, outcome));
        Some(outcomes)
    }
}

fn side_m(vertices: usize) -> f32 {
    (vertices as f32 * AREA_M2).sqrt()
}

fn settings(placement: Placement, vertices: usize) -> anyhow::Result<BuildSettings> {
    Ok(BuildSettings::default().with(|it| {
        it.vertices = vertices;
        it.placement = placement;
    })?)
}

fn with_builder<T>(site: &Site, settings: &BuildSettings, rule: Rule, run: impl FnOnce(&Builder<'_>) -> T) -> T {
    let (thread_count, progress) = (core_count(), Progress::default());
    run(&Builder { site, settings, executor: &rule, thread_count, clock: &|| 0.0, progress: &progress })
}

/// Time of a build, s, and what was built.
fn build(map: Map, settings: &BuildSettings, rule: Rule) -> anyhow::Result<(f64, Site, Built)> {
    let site = Site::new(Arc::new(map));
    let (built, seconds) = timed_with(|| with_builder(&site, settings, rule, |builder| builder.build()));
    Ok((seconds, site, built?))
}

/// A case that times a build.
fn building(name: &'static str, placement: Placement, size: usize, failures: u64) -> Case {
    Case::new(name, "vertices", size, move |vertices| {
        Ok(build(floor(side_m(vertices))?, &settings(placement, vertices)?, Rule { failures })?.0)
    })
}

/// A graph that joins nearly all vertices.
fn graph(vertices: usize) -> anyhow::Result<(Site, Built)> {
    let (_, site, built) =
        build(floor(side_m(vertices))?, &settings(Placement::Spaced, vertices)?, Rule { failures: 4 })?;
    Ok((site, built))
}

/// Lifts with many stops all over a level square.
fn lifts(count: usize) -> anyhow::Result<Map> {
    let across = (count as f32).sqrt().ceil() as usize;
    let at = |idx: usize| {
        let place = Vec3::new((idx % across) as f32, 0.1, (idx / across) as f32) * 24.0 + Vec3::new(12.0, 1.0, 12.0);
        lift(idx, place, (0..STOPS).map(|stop| stop as f32))
    };
    floor(across as f32 * 24.0)?.with_movers((0..count).map(at).collect()).context("movers of the bench")
}

/// Ground everywhere, and probes that all succeed.
struct Open;

impl Terrain for Open {
    fn stand(&self, place: Vec3) -> Option<Vec3> {
        Some(place)
    }

    fn prove(
        &self,
        _: &[Vec3],
        candidates: &[candidates::Candidate],
    ) -> Option<Vec<surefoot_planner::evidence::Evidence>> {
        Some(candidates.iter().map(|_| surefoot_planner::evidence::Evidence::with_prior(1.0)).collect())
    }
}

/// Edits of every kind, one for each of so many edges.
fn layers(graph: &NavGraph, count: usize) -> Vec<Layer> {
    let stride = (graph.edge_count() / count).max(1);
    let ends = |EdgeKey { from, to }: EdgeKey| (graph.position(from), graph.position(to));
    let edit = |(idx, key): (usize, EdgeKey)| {
        let (from, to) = ends(key);
        match idx % 5 {
            0 => Edit::ForbidEdge { from, to },
            1 => Edit::ForceEdge { from, to, seconds: None },
            2 => Edit::PriceEdge { from, to, factor: 2.0 },
            3 => Edit::RemoveVertex { at: from },
            _ => Edit::AddVertex { at: from + Vec3::new(1.0, 0.0, 1.0) },
        }
    };
    let edits: Vec<Edit> =
        graph.edges().map(|edge| edge.key).step_by(stride).take(count).enumerate().map(edit).collect();
    vec![Layer { name: "bench".to_owned(), edits }]
}

fn export(graph: &NavGraph) -> f64 {
    let shape = |key: EdgeKey| Shape { passages: vec![Passage::begin(graph.position(key.from))] };
    let shaped: Vec<ShapedEdge<'_>> = graph.edges().map(|edge| ShapedEdge { edge, shape: shape(edge.key) }).collect();
    let islands = vec![Some(0); graph.vertex_count()];
    let nav_mesh = NavMesh { radius: 0.3, speed: 5.0, islands: &islands };
    timed(|| {
        let set = LinkSet::of(graph, &shaped, nav_mesh, Some(DEFAULT_MAX_DETOUR), &|_| Some(0));
        black_box(AssetFormat::Unity.write(&set));
    })
}

/// Queries without jumps to goals that nothing leads to.
fn unreachable(router: &Router) -> f64 {
    let graph = router.graph();
    let places: Vec<Vec3> =
        graph.vertices().step_by(graph.vertex_count() / 64).map(|vertex| graph.position(vertex)).collect();
    let without: AbilitySet = [Ability::JUMP].into_iter().collect();
    let query = |start: Vec3| Query { without, ..Query::new(start, start + Vec3::Y * 100.0) };
    timed(|| places.iter().for_each(|&start| _ = black_box(router.find_path(&query(start)))))
}

pub(super) fn cases() -> Vec<Case> {
    let graphs = |name, seconds: fn(Site, Built) -> anyhow::Result<f64>| {
        Case::new(name, "vertices", VERTICES, move |vertices| {
            let (site, built) = graph(vertices)?;
            seconds(site, built)
        })
    };
    vec![
        building("build", Placement::Spaced, VERTICES, 4),
        building("build_of_islands", Placement::Spaced, VERTICES, 14),
        building("build_random", Placement::Random, VERTICES, 4),
        building("build_flood", Placement::Flood, VERTICES, 4),
        building("build_trajectories", Placement::Trajectories, VERTICES, 4),
        Case::new("build_with_lifts", "lifts of 16 stops", 224, |lift_count| {
            Ok(build(lifts(lift_count)?, &settings(Placement::Spaced, 1600)?, Rule { failures: 4 })?.0)
        }),
        graphs("update", |site, built| {
            let side = site.map.extent().x;
            let shape = PieceShape::Block {
                foot: Vec3::new(side / 2.0, 1.0, side / 2.0),
                half: [side / 8.0; 2],
                height: 6.0,
                yaw: 0.3,
            };
            let piece = Piece { name: "block".to_owned(), shape };
            let changed = Site { map: Arc::new(site.map.with_pieces(vec![piece])?), ..site.clone() };
            let settings =
                settings(Placement::Spaced, built.graph.vertex_count().min(surefoot_planner::settings::MAX_VERTICES))?;
            let rule = Rule { failures: 4 };
            let update = || with_builder(&changed, &settings, rule, |it| it.update(&built.graph, &site.map));
            let (updated, seconds) = timed_with(update);
            updated?;
            Ok(seconds)
        }),
        graphs("prepare_router", |_, built| {
            Ok(timed(|| drop(black_box(Router::new(built.graph.clone(), 0, core_count())))))
        }),
        graphs("unreachable_queries", |_, built| Ok(unreachable(&Router::new(built.graph, 0, core_count())))),
        graphs("describe", |_, built| Ok(timed(|| drop(black_box(reachability::describe(&built.graph)))))),
        Case::new("describe_islands", "vertices", VERTICES, |vertices| {
            let rule = Rule { failures: 14 };
            let (_, _, built) = build(floor(side_m(vertices))?, &settings(Placement::Random, vertices)?, rule)?;
            Ok(timed(|| drop(black_box(reachability::describe(&built.graph)))))
        }),
        graphs("compare", |_, built| Ok(timed(|| drop(black_box(reachability::compare(&built.graph, &built.graph)))))),
        graphs("export_links", |_, built| Ok(export(&built.graph))),
        Case::new("apply_edits", "edits of a graph of 16,384 vertices", 1024, {
            let mut kept = None;
            move |count| {
                if kept.is_none() {
                    kept = Some(graph(4 * VERTICES)?.1.graph);
                }
                let graph = kept.as_ref().context("it was just set")?;
                let layers = layers(graph, count);
                Ok(timed(|| drop(black_box(apply_layers(graph, &layers, 0.5, &Open)))))
            }
        }),
    ]
}
