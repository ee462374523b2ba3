//! The survey of a level against a random explorer: whether bodies get where it says, and nowhere else.
//!
//! The explorer keeps bodies that it has seen, in cubes with a side of half a metre, and sends copies of those in
//! little-visited cubes on with random actions, as Go-Explore does (Ecoffet et al., 2021). What it finds is possible.
//! What it does not find within its time may be possible all the same, so the precision is a lower bound.

use super::Figure;
use anyhow::Context;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::collections::{BTreeSet, HashMap};
use std::f32::consts::PI;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use surefoot_cli::commands::core_count;
use surefoot_cli::commands::map::{LevelArgs, file_name};
use surefoot_world::character::MoveScratch;
use surefoot_world::float::wrapped;
use surefoot_world::reach::{PlayArea, Reach};
use surefoot_world::{Action, Body, CharacterProfile, DECISION_SECONDS, Map, TICKS_PER_DECISION, Vec3};

/// Side of a cube, m.
const CUBE_M: f32 = 0.5;
/// Bodies kept in a cube, with different velocities.
const BODIES_EACH: usize = 4;
/// Cubes that are drawn for each walk; the least visited one is taken.
const DRAWS: usize = 3;
/// Decisions of a walk.
const WALK_DECISIONS: u32 = 18;
/// Chances of a new heading and of a jump, for each decision.
const TURN_CHANCE: f64 = 0.15;
const JUMP_CHANCE: f64 = 0.2;
/// Chance that a body runs rather than stands.
const RUN_CHANCE: f64 = 0.9;
/// Places of the play area from which the explorer sets out.
const STARTS: usize = 64;
const TARGET: f64 = 0.99;

/// A cube and the bodies that stood there.
struct Cube {
    visits: u32,
    bodies: Vec<Body>,
}

/// Bodies that explore a map.
struct Explorer<'a> {
    map: &'a Map,
    profile: &'a CharacterProfile,
    cubes: HashMap<[i32; 3], usize>,
    kept: Vec<Cube>,
    rng: ChaCha8Rng,
    scratch: MoveScratch,
}

impl<'a> Explorer<'a> {
    fn new(map: &'a Map, profile: &'a CharacterProfile, starts: impl Iterator<Item = Vec3>) -> Self {
        let (cubes, rng) = (HashMap::new(), ChaCha8Rng::seed_from_u64(0));
        let mut explorer = Self { map, profile, cubes, kept: Vec::new(), rng, scratch: MoveScratch::default() };
        starts.for_each(|feet| explorer.keep(Body::at(feet, 0.0)));
        explorer
    }

    /// Keeps a body that stands in its cube.
    fn keep(&mut self, body: Body) {
        let cube = body.feet.to_array().map(|axis| (axis / CUBE_M).floor() as i32);
        let idx = *self.cubes.entry(cube).or_insert(self.kept.len());
        if idx == self.kept.len() {
            self.kept.push(Cube { visits: 0, bodies: Vec::new() });
        }
        let Cube { visits, bodies } = &mut self.kept[idx];
        *visits += 1;
        if bodies.len() < BODIES_EACH {
            bodies.push(body);
        } else {
            bodies[1 + self.rng.random_range(0..BODIES_EACH - 1)] = body;
        }
    }

    /// A random heading, rad.
    fn heading(&mut self) -> f32 {
        self.rng.random_range(-PI..PI)
    }

    /// Sends a copy of a body in a little-visited cube on with random actions.
    fn walk(&mut self) {
        let drawn = std::array::from_fn::<usize, DRAWS, _>(|_| self.rng.random_range(0..self.kept.len()));
        let cube = &self.kept[drawn.into_iter().min_by_key(|idx| self.kept[*idx].visits).expect("some are drawn")];
        let mut body = cube.bodies[self.rng.random_range(0..cube.bodies.len())];
        let (mut towards, mut forward) = (self.heading(), 1.0);
        for _ in 0..WALK_DECISIONS {
            if self.rng.random_bool(TURN_CHANCE) {
                towards = self.heading();
                forward = if self.rng.random_bool(RUN_CHANCE) { 1.0 } else { 0.0 };
            }
            let jump = if self.rng.random_bool(JUMP_CHANCE) { 1.0 } else { -1.0 };
            let most = self.profile.turn_speed * DECISION_SECONDS;
            let turn = (wrapped(towards - body.yaw) / most).clamp(-1.0, 1.0);
            let action = Action { forward, turn, jump, ..Action::default() };
            body.begin_decision(&action);
            for _ in 0..TICKS_PER_DECISION {
                body.tick(self.map, self.profile, &action, &mut self.scratch);
                if self.map.is_outside(body.feet) || body.liquid.is_some() {
                    return;
                }
            }
            if body.is_grounded() {
                self.keep(body);
            }
        }
    }
}

/// What a survey and an explorer say about a level.
struct Comparison {
    /// Places of the survey that both reach, as shares of what the survey and what the explorer reaches.
    precision: f64,
    recall: f64,
    /// Share of the cubes from which a walk leads to no place of the survey.
    off_grid: f64,
    cubes: usize,
    /// Some places that only the explorer reaches, m.
    missed: Vec<Vec3>,
}

impl Comparison {
    fn of(map: &Map, profile: &CharacterProfile, limit: Duration) -> anyhow::Result<Self> {
        let survey = Reach::survey_far(map, profile, core_count());
        let area = PlayArea::of(map, profile, &survey);
        let cells = survey.ground.cells();
        let held: Vec<Vec3> = cells.iter().filter(|cell| area.holds(cell.island)).map(|cell| cell.feet).collect();
        anyhow::ensure!(!held.is_empty(), "there is no place to stand");
        let starts = held.iter().step_by(held.len().div_ceil(STARTS)).copied();
        let mut explorer = Explorer::new(map, profile, starts);
        let started = Instant::now();
        while started.elapsed() < limit {
            explorer.walk();
        }
        let mut scratch = MoveScratch::default();
        let (mut found, mut off_grid) = (BTreeSet::new(), 0);
        for cube in &explorer.kept {
            let cell = survey.ground.walk_from(map, profile, cube.bodies[0].feet, &mut scratch);
            off_grid += usize::from(cell.is_none());
            found.extend(cell);
        }
        // A walk connects all places of an island, so one of them is enough.
        let islands: BTreeSet<u32> = found.iter().map(|idx| cells[*idx].island).collect();
        let reached = || cells.iter().filter(|cell| area.reaches(cell.island));
        let confirmed = reached().filter(|cell| islands.contains(&cell.island)).count();
        let missed: Vec<Vec3> =
            found.iter().map(|idx| &cells[*idx]).filter(|cell| !area.reaches(cell.island)).map(|it| it.feet).collect();
        Ok(Self {
            precision: confirmed as f64 / reached().count().max(1) as f64,
            recall: 1.0 - missed.len() as f64 / found.len().max(1) as f64,
            off_grid: off_grid as f64 / explorer.kept.len() as f64,
            cubes: explorer.kept.len(),
            missed,
        })
    }
}

/// Figures of surveys of levels, against explorers that take `minutes` each.
pub fn figures(
    files: &[PathBuf],
    levels: &LevelArgs,
    profile: &CharacterProfile,
    minutes: f64,
) -> anyhow::Result<Vec<Figure>> {
    let mut figures = Vec::new();
    for file in files {
        let name = file_name(file);
        let map = levels.load(file)?;
        let found = Comparison::of(&map, profile, Duration::from_secs_f64(60.0 * minutes));
        let found = found.with_context(|| file.display().to_string())?;
        for feet in found.missed.iter().step_by(found.missed.len().div_ceil(5).max(1)) {
            eprintln!("{name}: an explorer stood at {feet}, which the survey calls unreachable");
        }
        let own = [
            Figure::new("survey_precision", found.precision, "").at_least(TARGET),
            Figure::new("survey_recall", found.recall, "").at_least(TARGET),
            Figure::new("survey_off_grid", found.off_grid, ""),
            Figure::new("explorer_cubes", found.cubes as f64, ""),
        ];
        figures.extend(own.into_iter().map(|figure| figure.on(&name)));
    }
    Ok(figures)
}
