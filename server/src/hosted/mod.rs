//! One world on the server: its NPCs, whose decision is due, who answers, how attempts end.
//!
//! A tick is [`HostedWorld::step`] (`tick`): ask the workers, move, settle. Answers arrive between ticks. `workers` hands NPCs
//! from one worker to another, `commands` is what clients ask for, `snapshot` and `events` what they see (`motion` finds jumps and
//! landings), `saved` what outlives the process.
//! Nothing here awaits, and nothing knows how a message looks on the wire.

mod commands;
mod events;
mod mode;
mod motion;
mod outbox;
mod saved;
mod snapshot;
mod tick;
mod workers;
mod world;

pub use commands::{NpcError, SpawnOrder};
pub use events::{EventKind, EventLog, EventsLost, KEPT_EVENTS, NpcEvent};
pub use mode::TimeMode;
pub use saved::{SavedError, SavedMap, SavedWorld, StateFolder};
pub use snapshot::{
    Counters, EndedAttempt, NpcPlan, NpcState, NpcStatus, PlanLeg, Snapshot, Support, Tally, WorldStats,
};
pub use world::HostedWorld;
