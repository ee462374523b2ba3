//! Episodes of an environment: their starts, goals and routes.

use crate::goals::{Goal, goal_in_band, random_point, random_yaw};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::collections::VecDeque;
use surefoot_world::navigable::{self, NoGround};
use surefoot_world::{CharacterProfile, Map, Vec3};

/// Number of places from which starts and goals are drawn.
const PLACES: usize = 1000;
/// Draws for a goal at the wanted distance before the nearest miss is used.
const GOAL_DRAWS: usize = 64;

/// The episodes of an environment.
#[derive(Debug, Clone, PartialEq)]
pub enum Episodes {
    /// Every NPC always has a goal, and a new episode begins as soon as one ends.
    Endless {
        /// Number of NPCs.
        npc_count: usize,
        /// Wanted distance of goals from their starts, m.
        band: (f32, f32),
        /// Seed of starts and goals.
        seed: u64,
    },
    /// One NPC for each goal, and one episode for each NPC; the NPC rests when its episode has ended.
    Once(Vec<Goal>),
}

impl Episodes {
    /// Number of NPCs.
    pub fn npc_count(&self) -> usize {
        match self {
            Self::Endless { npc_count, .. } => *npc_count,
            Self::Once(goals) => goals.len(),
        }
    }
}

/// When an NPC with endless episodes begins its next one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Renewal {
    /// In the step that ended the last one.
    #[default]
    AtOnce,
    /// When [`Env::renew`] is called; until then it rests.
    OnCall,
}

/// Places for which an NPC heads one after another.
#[derive(Debug, Clone, PartialEq)]
pub struct Route {
    /// Index of the NPC.
    pub npc_idx: usize,
    /// Where the feet are put first, m, and the heading, rad; `None` if the NPC starts from where it is.
    pub start: Option<(Vec3, f32)>,
    /// The places, m, at least one.
    pub waypoints: Vec<Vec3>,
}

/// The rest of a route.
#[derive(Debug, Clone, Default)]
pub(super) struct RouteAhead {
    /// Places after the current one, m.
    pub waypoints: VecDeque<Vec3>,
    /// Places passed so far.
    pub passed: u32,
}

impl RouteAhead {
    /// Passes the current place if another one follows, and returns that.
    pub fn pass(&mut self) -> Option<Vec3> {
        let next = self.waypoints.pop_front()?;
        self.passed += 1;
        Some(next)
    }
}

/// Where endless episodes come from.
#[derive(Debug)]
pub struct Draw {
    places: Vec<Vec3>,
    /// Wanted distance of goals from their starts, m.
    band: (f32, f32),
    rng: ChaCha8Rng,
}

impl Draw {
    /// The draw of an environment on `map` with these arguments.
    ///
    /// # Errors
    /// If no place to stand is found on the map.
    pub fn on(map: &Map, profile: &CharacterProfile, band: (f32, f32), seed: u64) -> Result<Self, NoGround> {
        Self::of(|rng| places_on(map, profile, rng), band, seed)
    }

    pub(super) fn of<E>(
        places: impl FnOnce(&mut ChaCha8Rng) -> Result<Vec<Vec3>, E>,
        band: (f32, f32),
        seed: u64,
    ) -> Result<Self, E> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        Ok(Self { places: places(&mut rng)?, band, rng })
    }

    /// Draws the next episode.
    pub fn goal(&mut self) -> Goal {
        let Self { places, band, rng } = self;
        let start = random_point(places, rng);
        let yaw = random_yaw(rng);
        Goal { start, yaw, goal: goal_in_band(places, start, *band, GOAL_DRAWS, rng) }
    }
}

/// Draws places to stand on a map.
pub(super) fn places_on(map: &Map, profile: &CharacterProfile, rng: &mut ChaCha8Rng) -> Result<Vec<Vec3>, NoGround> {
    navigable::sample_many(map, profile, PLACES, rng)
}
