//! One world on the server: its NPCs, which decisions are due, which worker makes them, and how attempts end.
//!
//! A tick is [`HostedWorld::step`] (in `tick`): move, end attempts, request decisions. Answers arrive between ticks.
//! `workers` hands NPCs from one worker to another, `commands` has the calls of clients (`living` those about movers
//! and players, `pieces` edits of the map), `snapshot` and `events` what clients see (`motion` detects jumps and
//! landings), `saved` what outlives the process (`journal`: what a fleet knows beyond it). Nothing here awaits, and
//! nothing knows wire types.

mod commands;
mod events;
mod journal;
mod living;
mod motion;
mod pieces;
mod saved;
mod snapshot;
mod tick;
mod workers;
mod world;

pub use commands::{MAX_BODIES, NpcError, SpawnOrder};
pub use events::{EventKind, EventLog, EventsLost, KEPT_EVENTS, NpcEvent};
pub use journal::{FleetSave, Journal, SavedLog};
pub use living::{Destination, LivingError};
pub use pieces::{EditError, MapEdit, MapEdited};
pub use saved::{RestoredMap, SavedError, SavedMap, StateFolder, WorldSave};
pub use snapshot::{
    Counters, EndedAttempt, NpcPlan, NpcState, NpcStatus, PlanLeg, Snapshot, Support, Tally, WorldStats,
};
pub use world::{HostedWorld, TimeMode};
