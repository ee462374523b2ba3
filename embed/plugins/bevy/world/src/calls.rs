//! The side of Surefoot's server: worlds that send their calls to the app.

use bevy_surefoot::RAY_COUNT;
use rand::SeedableRng;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use surefoot_game::{BodyState, CharacterProfile, Command, GameWorld, Hit, Level, Vec3};
use surefoot_world::{Map, TICKS_PER_DECISION, navigable};

/// What the app is to do. Characters are counted by the app.
pub enum Call {
    /// Spawn characters with this body.
    Open {
        /// Their body.
        body: CharacterProfile,
        /// How many.
        count: usize,
        /// Their numbers.
        reply: SyncSender<Vec<usize>>,
    },
    /// Despawn characters.
    Close {
        /// Their numbers.
        characters: Vec<usize>,
    },
    /// Put a character there, at rest.
    Place {
        /// Its number.
        character: usize,
        /// The place of its feet, m.
        feet: Vec3,
        /// Its heading, rad.
        yaw: f32,
    },
    /// Run a fixed tick in which these characters move.
    Tick {
        /// Their numbers, and what they do.
        commands: Vec<(usize, Command)>,
        /// Whether they look around afterwards.
        looks: bool,
        /// What became of them, in the same order.
        reply: SyncSender<Vec<Moved>>,
    },
    /// Cast rays.
    Cast {
        /// The rays.
        sight: Box<Sight>,
        /// The same with what they hit.
        reply: SyncSender<Box<Sight>>,
    },
}

/// What became of a character in a tick.
pub struct Moved {
    /// Its state afterwards.
    pub state: BodyState,
    /// What it sees afterwards, if that was wanted.
    pub sight: Option<Box<Sight>>,
}

/// Rays, and what they hit.
#[derive(Clone)]
pub struct Sight {
    /// Where they begin, m.
    pub origin: Vec3,
    /// Unit directions.
    pub directions: [Vec3; RAY_COUNT],
    /// What each hit.
    pub hits: [Hit; RAY_COUNT],
}

/// The level as Surefoot's server sees it.
pub struct Scene {
    map: Arc<Map>,
    calls: SyncSender<Call>,
}

impl Scene {
    pub(crate) fn new(map: Arc<Map>, calls: SyncSender<Call>) -> Self {
        Self { map, calls }
    }
}

impl Level for Scene {
    fn open(&self, body: &CharacterProfile, count: usize) -> Result<Box<dyn GameWorld>, String> {
        let (reply, answer) = sync_channel(1);
        let closed = |_| "the app has ended".to_owned();
        self.calls.send(Call::Open { body: body.clone(), count, reply }).map_err(|_| closed(()))?;
        let characters = answer.recv().map_err(|_| closed(()))?;
        let (states, sights) = (vec![BodyState::default(); count], vec![None; count]);
        Ok(Box::new(World { calls: self.calls.clone(), characters, states, sights, ticks: 0 }))
    }

    fn places(&self, body: &CharacterProfile, seed: u64) -> Result<Vec<Vec3>, String> {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(seed);
        navigable::sample_many(&self.map, body, 1000, &mut rng).map_err(|error| error.to_string())
    }
}

/// Characters of the app that belong to one environment.
struct World {
    calls: SyncSender<Call>,
    characters: Vec<usize>,
    states: Vec<BodyState>,
    /// What characters saw after their last decision; none since they were placed.
    sights: Vec<Option<Box<Sight>>>,
    /// Ticks since the last decision began.
    ticks: u32,
}

impl World {
    fn send(&self, call: Call) {
        self.calls.send(call).expect("the app runs as long as there are worlds");
    }

    /// Calls the app and waits for its answer.
    fn ask<T>(&self, call: impl FnOnce(SyncSender<T>) -> Call) -> T {
        let (reply, answer): (_, Receiver<T>) = sync_channel(1);
        self.send(call(reply));
        answer.recv().expect("the app answers every call")
    }
}

impl GameWorld for World {
    fn place(&mut self, character: usize, feet: Vec3, yaw: f32) {
        self.states[character] = BodyState { feet, yaw, can_jump: true, ..BodyState::default() };
        self.sights[character] = None;
        self.send(Call::Place { character: self.characters[character], feet, yaw });
    }

    fn tick(&mut self, commands: &[(usize, Command)]) {
        let Some((_, Command { is_first, .. })) = commands.first() else { return };
        self.ticks = if *is_first { 1 } else { self.ticks + 1 };
        let looks = self.ticks == TICKS_PER_DECISION;
        let told = commands.iter().map(|(idx, command)| (self.characters[*idx], *command)).collect();
        let moved = self.ask(|reply| Call::Tick { commands: told, looks, reply });
        for (Moved { state, sight }, (idx, _)) in moved.into_iter().zip(commands) {
            (self.states[*idx], self.sights[*idx]) = (state, sight);
        }
    }

    fn state(&self, character: usize) -> BodyState {
        self.states[character]
    }

    fn cast(&self, origin: Vec3, directions: &[Vec3; RAY_COUNT], _range: f32) -> [Hit; RAY_COUNT] {
        let is_this = |sight: &&Sight| sight.origin == origin && sight.directions == *directions;
        if let Some(sight) = self.sights.iter().flatten().map(|sight| &**sight).find(is_this) {
            return sight.hits;
        }
        let sight = Box::new(Sight { origin, directions: *directions, hits: [None; RAY_COUNT] });
        self.ask(|reply| Call::Cast { sight, reply }).hits
    }
}

impl Drop for World {
    fn drop(&mut self) {
        // There is nobody to despawn for when the app has ended.
        let _ = self.calls.send(Call::Close { characters: std::mem::take(&mut self.characters) });
    }
}
