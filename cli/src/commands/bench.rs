//! `surefoot bench`: speed figures of this machine, as one JSON document.

use super::load_policy;
use crate::terminal::print_json;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::Serialize;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;
use surefoot_agent::train::replay::Batch;
use surefoot_agent::train::sac::{Learner, SacConfig};
use surefoot_world::character::{ACTION_LEN, Action};
use surefoot_world::sense::{RAY_COUNT, RayCone};
use surefoot_world::{CharacterProfile, Map, MapSpec, NpcSlot, OBSERVATION_LEN, TaskConfig, World, navigable};

/// Measure speed.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  surefoot bench world\n  surefoot bench learn")]
pub struct Args {
    /// world: simulation and maps; learn: SAC updates and inference
    #[arg(value_parser = ["world", "learn"])]
    what: String,
}

/// One figure, in the form that all benches share.
#[derive(Serialize)]
struct Figure {
    name: &'static str,
    value: f64,
    unit: &'static str,
    target: Option<f64>,
    reference: Option<f64>,
    reference_name: Option<&'static str>,
    ratio: Option<f64>,
}

impl Figure {
    fn new(name: &'static str, value: f64, unit: &'static str) -> Self {
        Self { name, value, unit, target: None, reference: None, reference_name: None, ratio: None }
    }

    fn target(self, target: f64) -> Self {
        Self { target: Some(target), ..self }
    }
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let figures = if args.what == "world" { world()? } else { learn()? };
    print_json(&serde_json::json!({ "bench": args.what, "machine": machine(), "figures": figures }))
}

fn machine() -> String {
    let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = cpu
        .lines()
        .find_map(|line| line.strip_prefix("model name"))
        .map(|rest| rest.trim_start_matches([' ', '\t', ':']));
    format!("{} x {}", super::core_count(), model.unwrap_or(std::env::consts::ARCH))
}

/// NPCs of the benchmark world.
const NPCS: usize = 256;

fn world() -> anyhow::Result<Vec<Figure>> {
    let profile = CharacterProfile::default();
    let generate: Vec<f64> = (0..5).map(|_| timed(|| drop(black_box(Map::generate(&MapSpec::new(0)))))).collect();
    let map = Arc::new(Map::generate(&MapSpec::new(0))?);
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let points = navigable::sample_many(&map, &profile, 2 * NPCS, &mut rng)?;
    let mut world = World::new(map.clone(), profile.clone(), TaskConfig::default());
    for pair in points.chunks_exact(2) {
        let slot = world.spawn(pair[0], rng.random_range(-3.0..3.0));
        world.set_goal(slot, pair[1]);
    }
    let mut row = vec![0.0; OBSERVATION_LEN];
    let (mut observing, mut moving) = (Vec::new(), Vec::new());
    for _ in 0..300 {
        observing.push(timed(|| (0..NPCS).for_each(|idx| _ = world.observe(NpcSlot(idx as u32), &mut row))));
        for idx in 0..NPCS {
            let action = Action::from_array([
                rng.random_range(0.0..1.0),
                rng.random_range(-0.5..0.5),
                rng.random_range(-0.5..0.5),
                rng.random_range(-1.0..0.4),
            ])?;
            world.decide(NpcSlot(idx as u32), action);
        }
        moving.push(timed(|| world.tick_decision()));
        for idx in 0..NPCS {
            let slot = NpcSlot(idx as u32);
            world.close_decision(slot);
            if world.npc(slot).is_some_and(|npc| npc.harm.is_some()) {
                world.teleport(slot, points[2 * idx], 0.0);
                world.set_goal(slot, points[2 * idx + 1]);
            }
        }
    }
    let (observe_s, move_s) = (median(observing) / NPCS as f64, median(moving) / NPCS as f64);
    let cone = RayCone::default();
    let bodies: Vec<_> = world.npcs().map(|(_, npc)| npc.body).collect();
    let rays = (0..50)
        .map(|_| timed(|| bodies.iter().for_each(|body| cone.cast(&map, &profile, body, |_, d, _| _ = black_box(d)))))
        .collect();
    let ray_us = median(rays) / (bodies.len() * RAY_COUNT) as f64 * 1.0e6;
    Ok(vec![
        Figure::new("decisions_per_core_s", 1.0 / (observe_s + move_s), "1/s").target(20_000.0),
        Figure::new("ray_us", ray_us, "us"),
        Figure::new("move_us", move_s * 1.0e6 / 10.0, "us per NPC and tick"),
        Figure::new("generate_250_s", median(generate), "s").target(2.0),
        Figure::new("map_250_mb", map.mesh().memory_bytes() as f64 / 1.0e6, "MB").target(150.0),
    ])
}

fn learn() -> anyhow::Result<Vec<Figure>> {
    const BATCH: usize = 256;
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let mut draw = |count: usize| (0..count).map(|_| rng.random_range(-1.0..1.0f32)).collect::<Vec<f32>>();
    let batch = Batch {
        observations: draw(BATCH * OBSERVATION_LEN),
        actions: draw(BATCH * ACTION_LEN),
        returns: draw(BATCH),
        bootstrap: vec![0.98; BATCH],
        next_observations: draw(BATCH * OBSERVATION_LEN),
    };
    let mut learner = Learner::new(SacConfig::default(), ChaCha8Rng::seed_from_u64(0));
    let updates: Vec<f64> = (0..60).map(|_| timed(|| _ = black_box(learner.update(&batch)))).collect();
    // Actor and temperature learn at every second update: pairs of updates are the unit.
    let pairs = updates.chunks_exact(2).skip(5).map(|pair| pair[0] + pair[1]).collect();
    let policy = load_policy(None)?;
    let mut actions = Vec::new();
    let inference = (0..60).map(|_| timed(|| policy.act(&batch.observations, 0.0, &mut rng, &mut actions))).collect();
    Ok(vec![
        Figure::new("sac_updates_s", 2.0 / median(pairs), "1/s, one thread, batch 256"),
        Figure::new("infer_256_us", median(inference) * 1.0e6, "us, one thread"),
    ])
}

fn timed(mut work: impl FnMut()) -> f64 {
    let started = Instant::now();
    work();
    started.elapsed().as_secs_f64()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}
