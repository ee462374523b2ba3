//! One world on the server: its NPCs, their decisions, their workers and their attempts.
//!
//! A tick is [`HostedWorld::step`] (in `tick`): move, log motion, end attempts, request decisions. Answers arrive
//! between ticks. `workers` assigns NPCs to workers, `commands` has the calls of clients (`living` those about movers
//! and players, `pieces` edits of the map), `snapshot` and `events` the data for clients (`motion` detects jumps and
//! landings), `saved` the save of a world, and `journal` the changes since then in a fleet. Nothing here awaits or
//! knows wire types.

mod commands;
mod events;
mod journal;
mod living;
mod motion;
mod outbox;
mod pieces;
mod saved;
mod snapshot;
mod tick;
mod workers;
mod world;

pub use crate::messages::TimeMode;
pub use commands::{MAX_BODIES, NpcError, SpawnOrder};
pub use events::{EventKind, EventLog, EventsLost, KEPT_EVENTS, NpcEvent};
pub use journal::{FleetSave, Journal, SavedLog};
pub use living::{Destination, LivingError};
pub use pieces::{EditError, MapEdit, MapEdited};
pub use saved::{RestoredMap, SavedError, SavedMap, StateFolder, WorldSave};
pub use snapshot::{
    Counters, EndedAttempt, NpcPlan, NpcState, NpcStatus, PlanLeg, Snapshot, Support, Tally, WorldStats,
};
pub use world::HostedWorld;
