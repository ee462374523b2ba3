//! Fits a body to the characters of a game.
//!
//! [`record`] moves characters of the game by fixed scripts of actions: runs, turns, jumps, and runs over whatever the
//! level has. [`fit`] then searches the body whose simulated characters, at the same places of the same level, move
//! alike. [`drifts`] says how far they still part.

mod scripts;
mod search;

pub use scripts::Script;
pub use search::fit;

use crate::link::{Game, GameError, Level};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use scripts::SCRIPTS;
use std::f32::consts::PI;
use surefoot_rollout::Goal;
use surefoot_world::arrival::{is_lane, is_plain};
use surefoot_world::character::MoveScratch;
use surefoot_world::navigable::{self, NoGround};
use surefoot_world::{Action, Body, CharacterProfile, Map, TICKS_PER_DECISION, Vec3};

/// Places that are drawn on a level.
const PLACES: usize = 500;
/// Lengths of the lanes on which scripts run that need open ground, m: the longest that the level has.
const LANES_M: [f32; 4] = [14.0, 10.0, 7.0, 5.0];
/// Room on both sides of a lane, m: turns lead a metre off it.
const MARGIN_M: f32 = 1.5;
/// Headings along which a lane is looked for from a place.
const HEADINGS: usize = 12;
/// Lanes that are used, and the fewest with which a longer lane is worth more than further lanes.
const LANES: usize = 8;
const FEW_LANES: usize = 4;
/// Characters that run over the level from random places.
const ROUGH_RUNS: usize = 48;
/// Decisions after which a prediction is compared: a second.
pub const HORIZON: usize = 6;

/// Why a body cannot be fitted.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// The game failed.
    #[error(transparent)]
    Game(#[from] GameError),
    /// The level has no ground.
    #[error(transparent)]
    NoGround(#[from] NoGround),
    /// The level is too cramped.
    #[error("the level has no straight lane of {} m on open ground: use a level with some", LANES_M[LANES_M.len() - 1])]
    NoLane,
}

/// What a character of the game did.
#[derive(Debug, Clone)]
pub struct Recording {
    /// The script that it followed.
    pub script: &'static Script,
    /// Heading at the start, rad.
    pub yaw: f32,
    /// Feet at the start and after each decision, m. It ends early where the attempt or the lane did.
    pub track: Vec<Vec3>,
}

/// How far the characters of a game and simulated ones part within a second, over the recordings of one script.
#[derive(Debug, Clone, PartialEq)]
pub struct Drift {
    /// Name of the script.
    pub script: &'static str,
    /// Median, m.
    pub p50_m: f32,
    /// 90th percentile, m.
    pub p90_m: f32,
    /// Seconds that were compared, each from another decision.
    pub count: usize,
}

/// Lets characters of the game follow all scripts, on open lanes and from random places. `level.body` is the size of
/// the characters.
///
/// # Errors
/// If the game refuses, does not answer, or breaks the contract, or the level lacks room.
pub fn record(game: &Game, level: &Level, seed: u64) -> Result<Vec<Recording>, FitError> {
    let (map, profile) = (&*level.map, &level.body);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let places = navigable::sample_many(map, profile, PLACES, &mut rng)?;
    let lanes = lanes(map, profile, &places)?;
    // Each with the distance from its start within which it counts, m.
    let mut trials: Vec<(&'static Script, Goal, f32)> = Vec::new();
    for script in &SCRIPTS {
        let far = |start: Vec3| {
            let distance = |place: &&Vec3| place.distance_squared(start);
            *places.iter().max_by(|a, b| distance(a).total_cmp(&distance(b))).expect("there are places")
        };
        let goal = |start, yaw| Goal { start, yaw, goal: far(start) };
        if script.is_rough {
            let starts = places.iter().take(ROUGH_RUNS);
            trials.extend(starts.map(|&start| (script, goal(start, rng.random_range(-PI..PI)), f32::INFINITY)));
        } else {
            let on_lane = |lane: &Lane| (script, goal(lane.start, lane.yaw + script.facing), lane.length);
            trials.extend(lanes.iter().map(on_lane));
        }
    }
    let goals: Vec<Goal> = trials.iter().map(|(_, goal, _)| *goal).collect();
    let mut env = game.open(level, &goals)?;
    let mut recordings: Vec<Recording> = trials
        .iter()
        .zip(&env.state().positions)
        .map(|((script, goal, _), &feet)| Recording { script, yaw: goal.yaw, track: vec![feet] })
        .collect();
    let mut are_running = vec![true; recordings.len()];
    let longest = SCRIPTS.iter().map(|script| script.actions().len()).max().unwrap_or(0);
    for decision in 0..longest {
        let action = |recording: &Recording| recording.script.actions().get(decision).copied().unwrap_or_default();
        let actions: Vec<Action> = recordings.iter().map(action).collect();
        let state = env.step(&actions, &[])?;
        for (idx, (recording, (_, goal, reach))) in recordings.iter_mut().zip(&trials).enumerate() {
            let has_ended = state.ended[idx].is_some() || state.positions[idx].distance(goal.start) > *reach;
            are_running[idx] &= !has_ended && decision < recording.script.actions().len();
            if are_running[idx] {
                recording.track.push(state.positions[idx]);
            }
        }
    }
    Ok(recordings)
}

/// A straight way over open ground.
#[derive(Debug, Clone, Copy)]
struct Lane {
    start: Vec3,
    yaw: f32,
    length: f32,
}

impl Lane {
    fn ends(&self) -> [Vec3; 2] {
        let (sin, cos) = libm::sincosf(self.yaw);
        [self.start, self.start + Vec3::new(sin, 0.0, cos) * self.length]
    }
}

/// Lanes, each from another place: level ones, if there are some.
fn lanes(map: &Map, profile: &CharacterProfile, places: &[Vec3]) -> Result<Vec<Lane>, FitError> {
    let mut most = Vec::new();
    for length in LANES_M {
        let lane = |&start: &Vec3| {
            let yaws = (0..HEADINGS).map(|idx| 2.0 * PI * idx as f32 / HEADINGS as f32 - PI);
            let mut lanes = yaws.map(|yaw| Lane { start, yaw, length });
            lanes.find(|lane| is_lane(map, profile, lane.ends(), MARGIN_M))
        };
        let is_level = |lane: &Lane| {
            let [start, end] = lane.ends();
            is_plain(map, profile, start, end)
        };
        let (level, uneven): (Vec<Lane>, Vec<Lane>) = places.iter().filter_map(lane).partition(is_level);
        let mut found = if level.len() >= FEW_LANES { level } else { [level, uneven].concat() };
        found.truncate(LANES);
        if found.len() > most.len() {
            most = found;
        }
        if most.len() >= FEW_LANES {
            break;
        }
    }
    if most.is_empty() { Err(FitError::NoLane) } else { Ok(most) }
}

/// How far a body parts from the recordings, script by script, and over all scripts at the end.
pub fn drifts(map: &Map, profile: &CharacterProfile, recordings: &[Recording]) -> Vec<Drift> {
    let of = |recording: &Recording| (recording.script.name, drift_m(map, profile, recording));
    let found: Vec<(&'static str, Vec<f32>)> = recordings.par_iter().map(of).collect();
    let summary = |script, wanted: &dyn Fn(&str) -> bool| {
        let own = found.iter().filter(|(name, _)| wanted(name));
        let mut own: Vec<f32> = own.flat_map(|(_, drifts)| drifts.iter().copied()).collect();
        own.sort_by(f32::total_cmp);
        let quantile = |share: f32| own.get((share * own.len() as f32) as usize).copied().unwrap_or(0.0);
        Drift { script, p50_m: quantile(0.5), p90_m: quantile(0.9), count: own.len() }
    };
    let each = SCRIPTS.iter().map(|script| summary(script.name, &|name| name == script.name));
    each.chain([summary("all", &|_| true)]).collect()
}

/// How far the simulated character has parted from the recorded one within each second of a recording, m.
fn drift_m(map: &Map, profile: &CharacterProfile, recording: &Recording) -> Vec<f32> {
    let simulated = simulate(map, profile, recording);
    let parted = |idx: usize| {
        let moved = |track: &[Vec3]| track[idx] - track[idx - HORIZON];
        (moved(&simulated) - moved(&recording.track)).length()
    };
    (HORIZON..recording.track.len()).map(parted).collect()
}

/// Feet of a simulated character at the start of a recording and after each of its decisions, m.
fn simulate(map: &Map, profile: &CharacterProfile, recording: &Recording) -> Vec<Vec3> {
    let mut scratch = MoveScratch::default();
    let mut body = Body::at(recording.track[0], recording.yaw);
    let mut track = vec![body.feet];
    for action in recording.script.actions().iter().take(recording.track.len() - 1) {
        body.begin_decision(action);
        for _ in 0..TICKS_PER_DECISION {
            body.tick(map, profile, action, &mut scratch);
        }
        track.push(body.feet);
    }
    track
}
