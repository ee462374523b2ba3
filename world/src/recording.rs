//! Recordings: every input of a world by its tick, and hashes of its state on the way.
//!
//! A recording names the map by its hash. Running it again is the business of [`replay`](mod@crate::replay).

use crate::character::{Action, CharacterProfile};
use crate::map::{Map, MapHash, MapSpec};
use crate::npc::{NpcSlot, ProfileIdx, WorldConfig, WorldState};
use crate::sealed::{self, SealError};
use crate::{TaskConfig, Vec3};
use serde::{Deserialize, Serialize};

/// First bytes of a recording's file.
const MAGIC: &[u8; 8] = b"SFREPLAY";
/// Changes whenever older recordings could not be read or would be replayed otherwise.
pub const REPLAY_VERSION: u32 = 1;
/// Ticks between two hashes of the state.
pub const CHECK_EVERY_TICKS: u64 = 600;

/// One call that changes a world, besides the tick itself.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Input {
    /// `World::spawn_as`.
    Spawn(ProfileIdx, Vec3, f32),
    /// `World::despawn`.
    Despawn(NpcSlot),
    /// `World::teleport`.
    Teleport(NpcSlot, Vec3, f32),
    /// `World::set_goal`.
    SetGoal(NpcSlot, Vec3),
    /// `World::clear_goal`.
    ClearGoal(NpcSlot),
    /// `World::decide`.
    Decide(NpcSlot, Action),
    /// `World::close_decision`.
    Close(NpcSlot),
}

/// A recorded run of one world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Recording {
    /// The map it ran on.
    pub map: MapHash,
    /// How that map is generated, if it was.
    pub spec: Option<MapSpec>,
    pub(crate) profiles: Vec<CharacterProfile>,
    pub(crate) task: TaskConfig,
    pub(crate) npc_collision: bool,
    pub(crate) start: WorldState,
    /// In the order they were made; the tick is the number of ticks stepped before.
    pub(crate) inputs: Vec<(u64, Input)>,
    pub(crate) checks: Vec<Check>,
    pub(crate) end_tick: u64,
}

/// A state on the way.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Check {
    /// Ticks stepped before it.
    pub tick: u64,
    /// Inputs made before it.
    pub input_count: u64,
    pub hash: [u8; 32],
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
        let recording: Self = postcard::from_bytes(content).map_err(|error| match error {
            // What can only exist checked refuses itself.
            postcard::Error::SerdeDeCustom => {
                ReplayError::Senseless("a character profile or the map's spec is out of range")
            }
            _ => ReplayError::Damaged,
        })?;
        recording.check()?;
        Ok(recording)
    }

    /// Whether a world can have run like that: what replaying relies on, and no more ticks than its checks bear out.
    fn check(&self) -> Result<(), ReplayError> {
        let senseless = |what| Err(ReplayError::Senseless(what));
        let profile_count = self.profiles.len();
        if !(1..=256).contains(&profile_count) {
            return senseless("it has no character profile or too many");
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
