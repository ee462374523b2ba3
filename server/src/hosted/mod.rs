//! One world on the server: its NPCs, their decisions, their workers and their attempts.
//!
//! A tick is [`HostedWorld::step`] (in `tick`): move, log motion, end attempts, request decisions. Answers arrive
//! between ticks. `workers` assigns NPCs to workers, `commands` has the calls of clients (`goals` those about goals,
//! `routes` those about routes, whose data is in `itinerary`, `looking` what NPCs at rest turn to, `living` those about
//! movers and players, `pieces` edits of the map, `zones` zones and tags), `gathering` the places of NPCs that share
//! goals, `groups` those of NPCs in formation, `snapshot` and `events` the data for clients (`motion` detects jumps and
//! landings, `movement` says how NPCs move, `standing` why they stand), `saved` the save of a world, and `journal` the
//! changes since then in a fleet. Nothing here awaits or knows wire types.

mod commands;
mod events;
mod fleeing;
mod gathering;
mod goals;
mod groups;
mod itinerary;
mod journal;
mod living;
mod looking;
mod motion;
mod movement;
mod outbox;
mod pieces;
mod pursuit;
mod routes;
mod saved;
mod snapshot;
mod standing;
mod tick;
mod workers;
mod world;
mod zones;

pub use crate::messages::TimeMode;
pub use commands::{MAX_BODIES, NpcError, SpawnOrder};
pub use events::{EventKind, EventLog, EventsLost, KEPT_EVENTS, NpcEvent};
pub use itinerary::{Area, MAX_DWELL_TICKS, Route, RouteKind, STOP_COUNT, Stop, Threat};
pub use journal::{FleetSave, Journal, SavedLog};
pub use living::{Destination, LivingError};
pub use pieces::{EditError, MapEdit, MapEdited};
pub use pursuit::{GoalOrder, GoalSet, Pursuit, Rank, Target};
pub use saved::{RestoredMap, SavedError, SavedMap, StateFolder, WorldSave};
pub use snapshot::{
    BodyId, BodyPose, Counters, EndedAttempt, Movement, NpcPlan, NpcState, NpcStatus, PlanLeg, Poses, Snapshot,
    Standing, Support, Tally, WorldStats,
};
pub use world::HostedWorld;
pub use zones::{ZonesEdit, ZonesError};
