//! The world: decisions, rays, moves, and the generation, memory and loading of maps, compared with rapier and parry.

use super::{Figure, median, timed, timed_with};
use anyhow::Context;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::hint::black_box;
use std::path::PathBuf;
use std::sync::Arc;
use surefoot_cli::commands::core_count;
use surefoot_cli::commands::map::{LevelArgs, file_name};
use surefoot_world::character::Action;
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{MapSize, Mover, MoverKind, MoverStop};
use surefoot_world::sense::{RAY_COUNT, RayCone};
use surefoot_world::{
    CharacterProfile, Map, MapSpec, NpcSlot, OBSERVATION_LEN, StopIdx, TaskConfig, Vec3, World, WorldConfig, navigable,
};

/// Number of NPCs in the benchmark world.
const NPCS: usize = 256;
/// Lifts on the map on which movers are measured.
const MOVERS: usize = 200;
/// Number of solid NPCs, or of NPCs among movers.
const SOLID_NPCS: usize = 1024;
/// Number of timed decisions of each NPC.
const DECISIONS: usize = 300;

/// All figures of `bench world`.
pub fn figures() -> anyhow::Result<Vec<Figure>> {
    let mut figures = large_map()?;
    let generate =
        median((0..5).map(|_| timed(|| drop(black_box(surefoot_generate::generate(&MapSpec::new(0)))))).collect());
    let map = Arc::new(surefoot_generate::generate(&MapSpec::new(0)));
    let saved = surefoot_levels::encode(&map);
    let load = median((0..5).map(|_| timed(|| drop(black_box(surefoot_levels::decode(&saved))))).collect());
    figures.extend([
        Figure::new("generate_250_s", generate, "s").at_most(2.0),
        Figure::new("load_250_s", load, "s").at_most(0.1 * generate).with_reference("generating it", generate, false),
        Figure::new("map_250_mb", map.memory_bytes() as f64 / 1.0e6, "MB").at_most(150.0),
    ]);
    figures.splice(0..0, scaling(&map)?);
    figures.splice(0..0, simulation(&map)?);
    figures.push(collisions(&map)?);
    figures.push(movers(&map)?);
    Ok(figures)
}

/// The figures of a world on imported levels.
pub fn figures_on(files: &[PathBuf], levels: &LevelArgs) -> anyhow::Result<Vec<Figure>> {
    let mut figures = Vec::new();
    for file in files {
        let (map, import) = timed_with(|| levels.load(file));
        let map = Arc::new(map?);
        let mut own = simulation(&map).with_context(|| format!("{}", file.display()))?;
        own.extend([
            Figure::new("import_s", import, "s"),
            Figure::new("triangles", map.mesh().triangles().len() as f64, ""),
            Figure::new("map_mb", map.memory_bytes() as f64 / 1.0e6, "MB"),
        ]);
        figures.extend(own.into_iter().map(|figure| figure.on(&file_name(file))));
    }
    Ok(figures)
}

/// Figures of the largest map. It is generated first, so that the peak of the memory belongs to it.
fn large_map() -> anyhow::Result<Vec<Figure>> {
    let size = MapSize { width: 1000, height: 200, depth: 1000 };
    let spec = MapSpec::new(3000).with(|it| it.size = size)?;
    let (map, generate) = timed_with(|| surefoot_generate::generate(&spec));
    let peak_mb = peak_memory_mb();
    let saved = surefoot_levels::encode(&map);
    let load = timed(|| drop(black_box(surefoot_levels::decode(&saved))));
    let mut figures = vec![
        Figure::new("generate_1000_s", generate, "s").at_most(30.0),
        Figure::new("load_1000_s", load, "s").at_most(0.1 * generate).with_reference("generating it", generate, false),
        Figure::new("map_1000_mb", map.memory_bytes() as f64 / 1.0e6, "MB").at_most(1500.0),
    ];
    figures.extend(peak_mb.map(|peak| Figure::new("generate_1000_peak_mb", peak, "MB").at_most(1500.0)));
    Ok(figures)
}

/// Peak memory of this process in MB, if the system reports it.
fn peak_memory_mb() -> Option<f64> {
    Some(super::process_status("self", "VmHWM")? * 1024.0 / 1.0e6)
}

/// NPCs that run to goals, and return to their start when they come to harm.
pub(super) struct Crowd {
    pub(super) world: World,
    /// Start and goal of each NPC.
    points: Vec<Vec3>,
    rng: ChaCha8Rng,
    row: Vec<f32>,
}

impl Crowd {
    fn new(map: &Arc<Map>, seed: u64) -> anyhow::Result<Self> {
        Self::of(NPCS, map, seed, false)
    }

    /// A crowd of `count` NPCs, solid or not.
    pub(super) fn of(count: usize, map: &Arc<Map>, seed: u64, npc_collision: bool) -> anyhow::Result<Self> {
        let profile = CharacterProfile::default();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let points = navigable::sample_many(map, &profile, 2 * count, &mut rng)?;
        let config = WorldConfig::new(profile, TaskConfig::default(), npc_collision);
        let mut world = World::with_config(map.clone(), config);
        for pair in points.chunks_exact(2) {
            let slot = world.spawn(pair[0], rng.random_range(-3.0..3.0));
            world.set_waypoint(slot, pair[1]);
        }
        Ok(Self { world, points, rng, row: vec![0.0; OBSERVATION_LEN] })
    }

    fn observe(&mut self) {
        (0..NPCS).for_each(|idx| _ = self.world.observe(NpcSlot(idx as u32), &mut self.row));
    }

    fn decide(&mut self) {
        let Self { world, rng, points, .. } = self;
        for idx in 0..points.len() / 2 {
            let action = [
                rng.random_range(0.0..1.0),
                rng.random_range(-0.5..0.5),
                rng.random_range(-0.5..0.5),
                rng.random_range(-1.0..0.4),
            ];
            world.decide(NpcSlot(idx as u32), Action::from_array(action).expect("values in range"));
        }
    }

    fn close(&mut self) {
        let Self { world, points, .. } = self;
        for (idx, pair) in points.chunks_exact(2).enumerate() {
            let slot = NpcSlot(idx as u32);
            world.close_decision(slot);
            if world.npc(slot).is_some_and(|npc| npc.harm.is_some()) {
                world.teleport(slot, pair[0], 0.0);
                world.set_waypoint(slot, pair[1]);
            }
        }
    }
}

/// Decisions per second of a crowd on each of several threads, which share the map.
fn decisions_of_threads(map: &Arc<Map>, threads: usize) -> anyhow::Result<f64> {
    let mut crowds: Vec<Crowd> =
        (0..threads).map(|seed| Crowd::new(map, seed as u64)).collect::<anyhow::Result<_>>()?;
    let seconds = timed(|| {
        std::thread::scope(|scope| {
            for crowd in &mut crowds {
                scope.spawn(move || {
                    for _ in 0..DECISIONS / 3 {
                        crowd.observe();
                        crowd.decide();
                        crowd.world.tick_decision();
                        crowd.close();
                    }
                });
            }
        });
    });
    Ok((threads * NPCS * (DECISIONS / 3)) as f64 / seconds)
}

/// Decisions per second on 1, 2, 4, 8 and 16 threads, up to the number of cores. The reference is that multiple of one
/// thread.
fn scaling(map: &Arc<Map>) -> anyhow::Result<Vec<Figure>> {
    let one = decisions_of_threads(map, 1)?;
    let mut figures =
        vec![Figure::new("decisions_1_thread_s", one, "1/s, drawing actions and closing decisions included")];
    for threads in [2, 4, 8, 16].into_iter().filter(|threads| *threads <= core_count()) {
        let figure = Figure::new(format!("decisions_{threads}_threads_s"), decisions_of_threads(map, threads)?, "1/s");
        figures.push(figure.with_reference("that many times one thread", threads as f64 * one, true));
    }
    Ok(figures)
}

/// Decisions, rays and moves of a running crowd, on one core.
fn simulation(map: &Arc<Map>) -> anyhow::Result<Vec<Figure>> {
    let profile = CharacterProfile::default();
    let mut crowd = Crowd::new(map, 0)?;
    let (mut observing, mut moving) = (Vec::new(), Vec::new());
    for _ in 0..DECISIONS {
        observing.push(timed(|| crowd.observe()));
        crowd.decide();
        moving.push(timed(|| crowd.world.tick_decision()));
        crowd.close();
    }
    let Crowd { world, points, .. } = crowd;
    let (observe_s, move_s) = (median(observing) / NPCS as f64, median(moving) / NPCS as f64);
    let cone = RayCone::default();
    let bodies: Vec<_> = world.npcs().map(|(_, npc)| npc.body).collect();
    let rays = (0..50)
        .map(|_| timed(|| bodies.iter().for_each(|body| cone.cast(map, &profile, body, |_, d, _| _ = black_box(d)))))
        .collect();
    let ray_us = median(rays) / (bodies.len() * RAY_COUNT) as f64 * 1.0e6;
    let starts: Vec<_> = points.iter().copied().take(NPCS).collect();
    let [decisions_s, ray_ref_us, kinematic_us, dynamic_us] = reference(map, &profile, &starts);
    let move_us = move_s * 1.0e6 / 10.0;
    Ok(vec![
        Figure::new("decisions_per_core_s", 1.0 / (observe_s + move_s), "1/s")
            .at_least(20_000.0)
            .with_optional_reference("rapier's kinematic controller and parry's rays", decisions_s, true),
        Figure::new("ray_us", ray_us, "us").with_optional_reference("parry's triangle mesh", ray_ref_us, false),
        Figure::new("move_us", move_us, "us per NPC and tick").with_optional_reference(
            "rapier's kinematic controller",
            kinematic_us,
            false,
        ),
        Figure::new("move_us_dynamic", move_us, "us per NPC and tick").with_optional_reference(
            "rapier's dynamic capsules",
            dynamic_us,
            false,
        ),
    ])
}

/// Median duration of a tick of two crowds that take turns, ms.
fn tick_ms(mut crowds: [Crowd; 2]) -> [f64; 2] {
    let mut times = [Vec::new(), Vec::new()];
    for _ in 0..DECISIONS / 3 {
        for (crowd, times) in crowds.iter_mut().zip(&mut times) {
            crowd.decide();
            times.push(timed(|| (0..10).for_each(|_| crowd.world.tick())) / 10.0);
            crowd.close();
        }
    }
    times.map(|times| median(times) * 1.0e3)
}

/// The cost of a tick of solid NPCs; the reference is a tick of NPCs that pass through one another.
fn collisions(map: &Arc<Map>) -> anyhow::Result<Figure> {
    let crowds = [Crowd::of(SOLID_NPCS, map, 0, false)?, Crowd::of(SOLID_NPCS, map, 0, true)?];
    let [ghosts, solid] = tick_ms(crowds);
    Ok(Figure::new("solid_tick_ms", solid, "ms for 1,024 NPCs").at_most(1.3 * ghosts).with_reference(
        "NPCs that pass through one another",
        ghosts,
        false,
    ))
}

/// A lift that cycles between stops at these heights above `place`, m.
pub(super) fn lift(idx: usize, place: Vec3, heights: impl Iterator<Item = f32>) -> Mover {
    Mover {
        name: format!("lift {idx}"),
        kind: MoverKind::Lift,
        triangles: cuboid(place - Vec3::new(1.5, 0.1, 1.5), place + Vec3::new(1.5, 0.1, 1.5)),
        pivot: place,
        stops: heights.map(|up| MoverStop { offset: Vec3::Y * up, yaw: 0.0, is_there: true }).collect(),
        start: StopIdx(0),
        travel_s: 4.0,
        dwell_s: 0.0,
        cycles: true,
        belt: Vec3::ZERO,
    }
}

/// The cost that lifts add to a tick; the reference is the same map without lifts.
fn movers(map: &Arc<Map>) -> anyhow::Result<Figure> {
    let spec = map.spec().context("movers are put on a generated map")?;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let places = navigable::sample_many(map, &CharacterProfile::default(), MOVERS, &mut rng)?;
    let lifts = places.iter().enumerate().map(|(idx, place)| lift(idx, *place, [0.0, 4.0].into_iter())).collect();
    let moving = Arc::new(surefoot_generate::generate(spec).with_movers(lifts).context("movers of the bench")?);
    let crowds = [Crowd::of(SOLID_NPCS, map, 0, false)?, Crowd::of(SOLID_NPCS, &moving, 0, false)?];
    let [without, with] = tick_ms(crowds);
    Ok(Figure::new("movers_tick_ms", with - without, "ms for 200 lifts, beside 1,024 NPCs")
        .at_most(0.3)
        .with_reference("the whole tick without them", without, false))
}

/// The same figures for rapier and parry: decisions per second, and the time of a ray, of a move by rapier's kinematic
/// controller, and of one by its dynamic capsules, us. `None` in builds without them.
#[cfg(feature = "reference")]
fn reference(map: &Map, profile: &CharacterProfile, starts: &[Vec3]) -> [Option<f64>; 4] {
    super::reference::measure(map, profile, starts, &mut ChaCha8Rng::seed_from_u64(0)).map(Some)
}

#[cfg(not(feature = "reference"))]
fn reference(_: &Map, _: &CharacterProfile, _: &[Vec3]) -> [Option<f64>; 4] {
    eprintln!("this build does not include rapier and parry: build with --features reference to compare with them");
    [None; 4]
}
