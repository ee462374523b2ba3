//! Recordings: every input of a world by its tick, so that a run can be repeated bit for bit.
//!
//! A recording names the map by its hash and carries hashes of the world's state on the way; a replay that comes to
//! another state says at which tick.

use crate::character::{Action, CharacterProfile};
use crate::map::{Map, MapHash, MapSpec};
use crate::sealed::{self, SealError};
use crate::world::{NpcSlot, ProfileIdx, World, WorldConfig, WorldState};
use crate::{TaskConfig, Vec3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// First bytes of a recording's file.
const MAGIC: &[u8; 8] = b"SFREPLAY";
/// Changes whenever older recordings could not be read or would be replayed otherwise.
pub const REPLAY_VERSION: u32 = 1;
/// Ticks between two hashes of the state.
pub const CHECK_EVERY_TICKS: u64 = 600;

/// One call that changes a world, besides the tick itself.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Input {
    /// [`World::spawn_as`].
    Spawn(ProfileIdx, Vec3, f32),
    /// [`World::despawn`].
    Despawn(NpcSlot),
    /// [`World::teleport`].
    Teleport(NpcSlot, Vec3, f32),
    /// [`World::set_goal`].
    SetGoal(NpcSlot, Vec3),
    /// [`World::clear_goal`].
    ClearGoal(NpcSlot),
    /// [`World::decide`].
    Decide(NpcSlot, Action),
    /// [`World::close_decision`].
    Close(NpcSlot),
}

/// A recorded run of one world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Recording {
    /// The map it ran on.
    pub map: MapHash,
    /// How that map is generated, if it was.
    pub spec: Option<MapSpec>,
    profiles: Vec<CharacterProfile>,
    task: TaskConfig,
    npc_collision: bool,
    start: WorldState,
    /// In the order they were made; the tick is the number of ticks stepped before.
    inputs: Vec<(u64, Input)>,
    checks: Vec<Check>,
    end_tick: u64,
}

/// A state on the way.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Check {
    /// Ticks stepped before it.
    tick: u64,
    /// Inputs made before it.
    input_count: u64,
    hash: [u8; 32],
}

/// Why a recording cannot be read or does not repeat.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReplayError {
    /// Not a recording.
    #[error("this is not a recording: it does not begin with SFREPLAY")]
    Magic,
    /// Written by another version.
    #[error("the recording has version {0}, this program replays version {REPLAY_VERSION}: record it anew")]
    Version(u32),
    /// Cut off or changed.
    #[error("the recording is damaged: its checksum does not fit; copy it again")]
    Damaged,
    /// Undamaged, but no world can have run like that.
    #[error("the recording makes no sense ({0}): record it anew")]
    Senseless(&'static str),
    /// The map at hand is another one.
    #[error("the recording was made on map {expected}, this is map {found}")]
    OtherMap {
        /// The recording's.
        expected: MapHash,
        /// The one given.
        found: MapHash,
    },
    /// An input names an NPC that does not exist.
    #[error("the recording is inconsistent at tick {tick}: {input} for NPC {slot}, which does not exist")]
    Inconsistent {
        /// When.
        tick: u64,
        /// What.
        input: &'static str,
        /// For whom.
        slot: u32,
    },
    /// The state differs from the recorded one.
    #[error("the replay differs from the recording at tick {tick} (they agreed up to tick {agreed})")]
    Diverged {
        /// First check that failed.
        tick: u64,
        /// Last check that held.
        agreed: u64,
    },
}

impl Recording {
    /// Begins a recording of a world in its present state.
    pub(crate) fn begin(map: &Map, config: &WorldConfig, start: WorldState) -> Self {
        Self {
            map: map.hash(),
            spec: map.spec().copied(),
            profiles: config.profiles.clone(),
            task: config.task.clone(),
            npc_collision: config.npc_collision,
            end_tick: start.tick(),
            start,
            inputs: Vec::new(),
            checks: Vec::new(),
        }
    }

    pub(crate) fn note(&mut self, tick: u64, input: Input) {
        self.inputs.push((tick, input));
    }

    pub(crate) fn note_state(&mut self, tick: u64, hash: [u8; 32]) {
        self.checks.push(Check { tick, input_count: self.inputs.len() as u64, hash });
        self.end_tick = tick;
    }

    /// Ticks recorded.
    pub fn tick_count(&self) -> u64 {
        self.end_tick - self.start.tick()
    }

    /// Inputs recorded.
    pub fn input_count(&self) -> usize {
        self.inputs.len()
    }

    /// `one`, with the inputs of `other`: for trying whether a difference is found.
    pub fn with_inputs_of(one: &Self, other: &Self) -> Self {
        Self { inputs: other.inputs.clone(), ..one.clone() }
    }

    /// Runs it again on `map` and compares the state with the recorded one at every check and at the end. `restore_at`, for tests and suspicious minds,
    /// saves the world at that tick and goes on in a fresh one restored from it.
    ///
    /// # Errors
    /// If the map is another one, a state differs, or something happens that cannot.
    pub fn replay(&self, map: Arc<Map>, restore_at: Option<u64>) -> Result<WorldState, ReplayError> {
        if map.hash() != self.map {
            return Err(ReplayError::OtherMap { expected: self.map, found: map.hash() });
        }
        let zip_line_count = map.placed().zip_lines.len();
        if !self.start.fits(self.profiles.len(), zip_line_count) {
            return Err(ReplayError::Senseless("an NPC hangs on a zip line that the map does not have"));
        }
        let config =
            WorldConfig { profiles: self.profiles.clone(), task: self.task.clone(), npc_collision: self.npc_collision };
        let mut world = World::with_config(map.clone(), config.clone());
        world.restore(self.start.clone());
        let (mut inputs, mut checks) = ((0..).zip(&self.inputs).peekable(), self.checks.iter().peekable());
        let mut agreed = world.current_tick();
        loop {
            let tick = world.current_tick();
            loop {
                let made = inputs.peek().map_or(self.inputs.len() as u64, |(nth, _)| *nth);
                while let Some(check) = checks.next_if(|check| check.tick == tick && check.input_count == made) {
                    if world.save().hash() != check.hash {
                        return Err(ReplayError::Diverged { tick, agreed });
                    }
                    agreed = tick;
                }
                let Some((_, (_, input))) = inputs.next_if(|(_, (at, _))| *at == tick) else { break };
                apply(&mut world, tick, *input)?;
            }
            if tick >= self.end_tick {
                // What is left names a tick that has passed, or a state after inputs that were not made.
                let is_done = inputs.peek().is_none() && checks.peek().is_none();
                return if is_done { Ok(world.save()) } else { Err(ReplayError::Diverged { tick, agreed }) };
            }
            if restore_at == Some(tick) {
                let state = world.save();
                world = World::with_config(map.clone(), config.clone());
                world.restore(state);
            }
            world.tick();
        }
    }

    /// As bytes: magic, version, checksum, content.
    pub fn encode(&self) -> Vec<u8> {
        sealed::seal(MAGIC, REPLAY_VERSION, &postcard::to_stdvec(self).expect("plain data"))
    }

    /// Reads what [`Recording::encode`] wrote.
    ///
    /// # Errors
    /// If it is something else, of another version, damaged, or no world can have run like that.
    pub fn decode(bytes: &[u8]) -> Result<Self, ReplayError> {
        let content = sealed::open(MAGIC, REPLAY_VERSION, bytes).map_err(|error| match error {
            SealError::Magic => ReplayError::Magic,
            SealError::Version(version) => ReplayError::Version(version),
            SealError::Damaged => ReplayError::Damaged,
        })?;
        let recording: Self = postcard::from_bytes(content).map_err(|_| ReplayError::Damaged)?;
        recording.check()?;
        Ok(recording)
    }

    /// Whether a world can have run like that: what replaying relies on, and no more ticks than its checks bear out.
    fn check(&self) -> Result<(), ReplayError> {
        let senseless = |what| Err(ReplayError::Senseless(what));
        let profile_count = self.profiles.len();
        if !(1..=256).contains(&profile_count) || self.profiles.iter().any(|profile| profile.validate().is_err()) {
            return senseless("a character profile is out of range");
        }
        if !self.start.fits(profile_count, usize::MAX) {
            return senseless("the state that it begins with is out of range");
        }
        let spawns_unknown =
            |input: &Input| matches!(input, Input::Spawn(profile, ..) if usize::from(profile.0) >= profile_count);
        if self.inputs.iter().any(|(_, input)| spawns_unknown(input)) {
            return senseless("an NPC has a profile that does not exist");
        }
        let span = self.start.tick()..=self.end_tick;
        let in_order = self.inputs.is_sorted_by_key(|(tick, _)| tick)
            && self.checks.is_sorted_by_key(|check| (check.tick, check.input_count))
            && self
                .inputs
                .iter()
                .map(|(tick, _)| tick)
                .chain(self.checks.iter().map(|check| &check.tick))
                .all(|tick| span.contains(tick));
        if span.is_empty() || !in_order {
            return senseless("its ticks are not in order");
        }
        if (self.end_tick - self.start.tick()) / CHECK_EVERY_TICKS >= self.checks.len() as u64 {
            return senseless("it has too few states for its length");
        }
        Ok(())
    }
}

fn apply(world: &mut World, tick: u64, input: Input) -> Result<(), ReplayError> {
    let (slot, name) = match input {
        Input::Spawn(profile, feet, yaw) => {
            world.spawn_as(profile, feet, yaw);
            return Ok(());
        }
        Input::Despawn(slot) => (slot, "despawn"),
        Input::Teleport(slot, ..) => (slot, "teleport"),
        Input::SetGoal(slot, _) => (slot, "set goal"),
        Input::ClearGoal(slot) => (slot, "clear goal"),
        Input::Decide(slot, _) => (slot, "decide"),
        Input::Close(slot) => (slot, "close decision"),
    };
    if world.npc(slot).is_none() {
        return Err(ReplayError::Inconsistent { tick, input: name, slot: slot.0 });
    }
    match input {
        Input::Spawn(..) => {}
        Input::Despawn(_) => _ = world.despawn(slot),
        Input::Teleport(_, feet, yaw) => world.teleport(slot, feet, yaw),
        Input::SetGoal(_, goal) => world.set_goal(slot, goal),
        Input::ClearGoal(_) => world.clear_goal(slot),
        Input::Decide(_, action) => world.decide(slot, action),
        Input::Close(_) => _ = world.close_decision(slot),
    }
    Ok(())
}
