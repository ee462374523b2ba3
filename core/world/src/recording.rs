//! Recordings: every input of a world with its tick, and hashes of intermediate states.
//!
//! A recording identifies the map by its hash. [`replay`](mod@crate::replay) runs the recording again.

use crate::character::{Action, CharacterProfile};
use crate::map::{Map, MapHash, MapSpec, Piece};
use crate::movers::MoverOrder;
use crate::npc::{MAX_PROFILES, NpcSlot, ProfileIdx, WorldConfig, WorldState};
use crate::player::{Player, PlayerSlot};
use crate::sealed::{self, SealError};
use crate::{Arrival, MoverId, TaskConfig, Tick, Vec3};
use serde::{Deserialize, Serialize};

/// First bytes of a recording's file.
const MAGIC: &[u8; 8] = b"SFREPLAY";
/// Changes whenever older recordings cannot be read or would replay differently.
pub const REPLAY_VERSION: u32 = 9;
/// Ticks between two hashes of the state.
pub const CHECK_EVERY_TICKS: u64 = 600;

/// A call that changes a world, other than a tick.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
pub enum Input {
    /// `World::spawn_as`.
    Spawn(ProfileIdx, Vec3, f32),
    /// `World::despawn`.
    Despawn(NpcSlot),
    /// `World::teleport`.
    Teleport(NpcSlot, Vec3, f32),
    /// `World::head_for`.
    HeadFor(NpcSlot, Vec3, Arrival),
    /// `World::clear_waypoint`.
    ClearWaypoint(NpcSlot),
    /// `World::decide`.
    Decide(NpcSlot, Action),
    /// `World::close_decision`.
    Close(NpcSlot),
    /// `World::order`.
    Order(MoverId, MoverOrder),
    /// `World::spawn_player`.
    SpawnPlayer(Player),
    /// `World::move_player`.
    MovePlayer(PlayerSlot, Vec3, Vec3),
    /// `World::remove_player`.
    RemovePlayer(PlayerSlot),
    /// `World::edit`, with all pieces of the map.
    Edit(Vec<Piece>),
    /// A profile that replaced one without NPCs, in `World::profile_idx`.
    Reprofile(ProfileIdx, Box<CharacterProfile>),
}

impl Input {
    /// The NPC that must exist; recordings of version 0.2 also despawn NPCs that do not.
    pub(crate) fn npc(&self) -> Option<NpcSlot> {
        match self {
            Self::Teleport(slot, ..)
            | Self::HeadFor(slot, ..)
            | Self::ClearWaypoint(slot)
            | Self::Decide(slot, _)
            | Self::Close(slot) => Some(*slot),
            _ => None,
        }
    }
}

/// A recorded run of one world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Recording {
    /// Hash of the map that the world ran on, without its pieces.
    pub map: MapHash,
    /// Pieces that the map had at the start.
    pub(crate) pieces: Vec<Piece>,
    /// Spec of the map; `None` if the map was not generated.
    pub spec: Option<MapSpec>,
    pub(crate) profiles: Vec<CharacterProfile>,
    pub(crate) task: TaskConfig,
    pub(crate) npc_collision: bool,
    pub(crate) start: WorldState,
    /// Inputs in the order of the calls, each with the ticks stepped before it.
    pub(crate) inputs: Vec<(Tick, Input)>,
    pub(crate) checks: Vec<Check>,
    pub(crate) end_tick: Tick,
}

/// Hash of an intermediate state.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Check {
    /// Ticks stepped before the state.
    pub tick: Tick,
    /// Inputs applied before the state.
    pub input_count: u64,
    pub hash: [u8; 32],
}

/// Why a recording cannot be read, or its replay fails.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReplayError {
    /// The bytes are not a recording.
    #[error("this is not a recording: it does not begin with SFREPLAY")]
    Magic,
    /// The recording was written by another version.
    #[error("the recording has version {0}, this program replays version {REPLAY_VERSION}: record it again")]
    Version(u32),
    /// The recording is truncated or its checksum does not match.
    #[error("the recording is damaged: its checksum does not match; copy it again")]
    Damaged,
    /// The recording is undamaged, but no world can have produced it.
    #[error("the recording is not valid ({0}): record it again")]
    Invalid(&'static str),
    /// The recording belongs to another map.
    #[error("the recording was made on map {expected}, but this is map {found}")]
    OtherMap {
        /// Map of the recording.
        expected: MapHash,
        /// Map given for the replay.
        found: MapHash,
    },
    /// An input does not fit the world.
    #[error("the recording is inconsistent at tick {tick}: {why}")]
    Inconsistent {
        /// Tick of the input.
        tick: Tick,
        /// Why the input does not fit.
        why: String,
    },
    /// The state differs from the recorded one.
    #[error("the replay differs from the recording at tick {tick} (they agreed up to tick {agreed})")]
    Diverged {
        /// Tick of the first state that differed.
        tick: Tick,
        /// Tick of the last state that matched.
        agreed: Tick,
    },
}

impl Recording {
    /// Begins a recording of a world whose state is `start`.
    pub(crate) fn begin(map: &Map, config: &WorldConfig, start: WorldState) -> Self {
        Self {
            map: map.built_hash(),
            pieces: map.pieces().to_vec(),
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

    pub(crate) fn note(&mut self, tick: Tick, input: Input) {
        self.inputs.push((tick, input));
    }

    pub(crate) fn note_state(&mut self, tick: Tick, hash: [u8; 32]) {
        self.checks.push(Check { tick, input_count: self.inputs.len() as u64, hash });
        self.end_tick = tick;
    }

    /// Ticks recorded.
    pub fn tick_count(&self) -> u64 {
        self.end_tick.since(self.start.tick())
    }

    /// Inputs recorded.
    pub fn input_count(&self) -> usize {
        self.inputs.len()
    }

    /// Returns `one` with the inputs of `other`, to test that a replay detects the difference.
    pub fn with_inputs_of(one: &Self, other: &Self) -> Self {
        Self { inputs: other.inputs.clone(), ..one.clone() }
    }

    /// Encodes the recording as bytes: magic, version, checksum, content.
    pub fn encode(&self) -> Vec<u8> {
        sealed::seal(MAGIC, REPLAY_VERSION, &postcard::to_stdvec(self).expect("plain data"))
    }

    /// Reads what [`Recording::encode`] wrote.
    ///
    /// # Errors
    /// If the bytes are not a recording, have another version, are damaged, or are not valid.
    pub fn decode(bytes: &[u8]) -> Result<Self, ReplayError> {
        let content = sealed::open(MAGIC, REPLAY_VERSION, bytes).map_err(|error| match error {
            SealError::Magic => ReplayError::Magic,
            SealError::Version(version) => ReplayError::Version(version),
            SealError::Damaged => ReplayError::Damaged,
        })?;
        let recording: Self = postcard::from_bytes(content).map_err(|error| match error {
            // Checked types reject invalid values when they are deserialized.
            postcard::Error::SerdeDeCustom => {
                ReplayError::Invalid("a character profile or the map's spec is out of range")
            }
            _ => ReplayError::Damaged,
        })?;
        recording.check()?;
        Ok(recording)
    }

    /// Checks everything that a replay relies on, and that the state hashes cover all ticks.
    fn check(&self) -> Result<(), ReplayError> {
        let profile_count = self.profiles.len();
        let has_profile =
            |input: &Input| !matches!(input, Input::Spawn(idx, ..) if usize::from(idx.0) >= profile_count);
        let fits = |input: &Input| !matches!(input, Input::SpawnPlayer(player) if !player.is_sound());
        let inputs = || self.inputs.iter().map(|(_, input)| input);
        let span = self.start.tick()..=self.end_tick;
        let mut ticks = self.inputs.iter().map(|(tick, _)| tick).chain(self.checks.iter().map(|check| &check.tick));
        let are_in_order = !span.is_empty()
            && self.inputs.is_sorted_by_key(|(tick, _)| tick)
            && self.checks.is_sorted_by_key(|check| (check.tick, check.input_count))
            && ticks.all(|tick| span.contains(tick));
        let check_count = self.tick_count() / CHECK_EVERY_TICKS + 1;
        let rules = [
            ((1..=MAX_PROFILES).contains(&profile_count), "it has no character profile or too many"),
            (self.task.is_sound(), "a constant of its task is out of range"),
            (self.start.fits_some_map(profile_count), "its initial state is out of range"),
            (inputs().all(fits), "a player has a size that is out of range"),
            (inputs().all(has_profile), "an NPC has a profile that does not exist"),
            (are_in_order, "its ticks are not in order"),
            (self.checks.len() as u64 >= check_count, "it has too few state hashes for its length"),
        ];
        if let Some((_, why)) = rules.into_iter().find(|(holds, _)| !holds) {
            return Err(ReplayError::Invalid(why));
        }
        Ok(())
    }
}
