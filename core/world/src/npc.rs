//! NPCs, the configuration of a world, and its state as plain data.

use crate::character::{Action, Body, CharacterProfile};
use crate::map::Map;
use crate::movers::{MoverState, Movers};
use crate::player::Player;
use crate::sense::LastDecision;
pub use crate::slot::NpcSlot;
use crate::task::{End, Episode, TaskConfig};
use crate::{AbilitySet, Tick};
use serde::{Deserialize, Serialize};

/// Index of one of a world's character profiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub struct ProfileIdx(pub u8);

/// Greatest number of profiles of a world.
pub const MAX_PROFILES: usize = 256;

/// Configuration of a world, besides its map.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldConfig {
    /// Profiles of the characters that may be spawned, 1 to 256.
    pub profiles: Vec<CharacterProfile>,
    /// Constants of the task.
    pub task: TaskConfig,
    /// Whether NPCs collide with and see each other.
    pub npc_collision: bool,
}

impl WorldConfig {
    /// A configuration with one profile.
    pub fn new(profile: CharacterProfile, task: TaskConfig, npc_collision: bool) -> Self {
        Self { profiles: vec![profile], task, npc_collision }
    }
}

/// One NPC: its body, its current decision and its episode.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Npc {
    /// Profile of the character.
    pub profile: ProfileIdx,
    /// Position and motion.
    pub body: Body,
    /// Action that is held until the next decision.
    pub action: Action,
    /// Current episode; an NPC without one stands still.
    pub episode: Option<Episode>,
    /// State from which the current decision started.
    pub last: LastDecision,
    /// Abilities used since the current decision began.
    pub used_abilities: AbilitySet,
    /// Hazard that harmed the NPC; a harmed NPC stays in place until it is teleported.
    pub harm: Option<End>,
}

/// Version of [`Npc::to_bytes`]; changes whenever the meaning of the bytes changes.
pub const NPC_STATE_VERSION: u32 = 4;

impl Npc {
    /// An NPC outside a world: a body on its way, whose last decision and action are unknown.
    pub fn outside(body: Body, episode: Episode) -> Self {
        Self {
            profile: ProfileIdx::default(),
            body,
            action: Action::default(),
            episode: Some(episode),
            last: LastDecision::default(),
            used_abilities: AbilitySet::default(),
            harm: None,
        }
    }

    /// Whether other bodies can touch it: not while it rides a zip line, and not once it is harmed.
    pub(crate) fn is_solid(&self) -> bool {
        self.harm.is_none() && !self.body.is_carried()
    }

    /// Encodes the state for a process with the same map.
    pub fn to_bytes(&self) -> Vec<u8> {
        postcard::to_stdvec(self).expect("plain data")
    }

    /// Decodes the state of an NPC; `None` if it is not valid in a world with `profile_count` profiles on a map with
    /// `zip_line_count` zip lines.
    pub fn from_bytes(bytes: &[u8], profile_count: usize, zip_line_count: usize) -> Option<Self> {
        let npc: Self = postcard::from_bytes(bytes).ok()?;
        npc.fits(profile_count, zip_line_count).then_some(npc)
    }

    fn fits(&self, profile_count: usize, zip_line_count: usize) -> bool {
        let counts = [
            Some(self.last.ticks_in_water),
            self.episode.map(|episode| episode.decisions),
            self.episode.map(|episode| episode.stalled_decisions),
        ];
        usize::from(self.profile.0) < profile_count
            && self.body.is_sound(zip_line_count)
            && counts.into_iter().flatten().all(|count| count <= MAX_COUNT)
    }
}

/// Largest count of ticks or decisions accepted in a stored NPC, so that counting on cannot overflow.
const MAX_COUNT: u32 = 1 << 30;

/// Everything about a world that changes while it is stepped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorldState {
    pub(crate) tick: Tick,
    pub(crate) npcs: Vec<Option<Npc>>,
    pub(crate) movers: Vec<MoverState>,
    pub(crate) players: Vec<Option<Player>>,
}

impl WorldState {
    /// Ticks stepped before the state was saved.
    pub fn tick(&self) -> Tick {
        self.tick
    }

    /// Whether this can be the state of a world with `profile_count` profiles on some map.
    pub fn fits_some_map(&self, profile_count: usize) -> bool {
        self.npcs.iter().flatten().all(|npc| npc.fits(profile_count, usize::MAX))
            && self.players.iter().flatten().all(Player::is_sound)
    }

    /// Whether this can be the state of a world with `profile_count` profiles on `map`.
    pub fn fits(&self, profile_count: usize, map: &Map) -> bool {
        let zip_line_count = map.placed().zip_lines.len();
        self.npcs.iter().flatten().all(|npc| npc.fits(profile_count, zip_line_count))
            && self.players.iter().flatten().all(Player::is_sound)
            && Movers::fit(map, &self.movers)
    }

    /// Occupied slots in ascending order.
    pub fn slots(&self) -> impl Iterator<Item = NpcSlot> {
        (0..).zip(&self.npcs).filter(|(_, npc)| npc.is_some()).map(|(slot, _)| NpcSlot(slot))
    }

    /// BLAKE3 hash of the whole state.
    pub fn hash(&self) -> [u8; 32] {
        *blake3::hash(&postcard::to_stdvec(self).expect("plain data")).as_bytes()
    }
}
