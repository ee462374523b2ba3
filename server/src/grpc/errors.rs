//! Converts the server's errors to statuses: one exhaustive match for each error type.

use crate::envs::EnvError;
use crate::errors::SimError;
use crate::hosted::{EditError, EventsLost, LivingError, NpcError};
use crate::messages::Goodbye;
use crate::store::StoreError;
use crate::worlds::WorldsError;
use std::time::Duration;
use surefoot_net::levels::{MapError, grpc as levels};
use surefoot_net::status;
use surefoot_proto::reason::Reason;
use tonic::Status;

/// When to retry a call to a busy world, which empties its inbox within a tick or two.
const INBOX_TIME: Duration = Duration::from_millis(50);
/// When to look again for a world whose server is gone.
pub(super) const TAKEOVER_TIME: Duration = Duration::from_secs(1);

impl From<NpcError> for Status {
    fn from(error: NpcError) -> Self {
        let message = error.to_string();
        match error {
            NpcError::Unknown(npc) => status::not_found(Reason::NpcNotFound, "npc", npc.to_string(), message),
            NpcError::Full { world, .. } | NpcError::OutOfNumbers(world) => {
                status::quota(Reason::TooManyNpcs, format!("world:{world}"), message)
            }
            NpcError::TooManyBodies(world) => status::quota(Reason::TooManyBodies, format!("world:{world}"), message),
            NpcError::Outside { field, .. } => status::invalid(field, message),
            NpcError::NotOwner(_) => status::failure(Reason::NotOwner, message),
            NpcError::Down(_) => status::failure(Reason::NpcDown, message),
            NpcError::NoGround(_) => status::failure(Reason::NoGround, message),
        }
    }
}

impl From<LivingError> for Status {
    fn from(error: LivingError) -> Self {
        let message = error.to_string();
        match error {
            LivingError::NoSuchMover(_, name) => status::not_found(Reason::MoverNotFound, "mover", name, message),
            LivingError::Order { field, .. } | LivingError::Outside { field, .. } => status::invalid(field, message),
            LivingError::NoSuchPlayer(_, player) => {
                status::not_found(Reason::PlayerNotFound, "player", player.to_string(), message)
            }
            LivingError::TooManyPlayers(world) => {
                status::quota(Reason::TooManyPlayers, format!("world:{world}"), message)
            }
        }
    }
}

impl From<EditError> for Status {
    fn from(error: EditError) -> Self {
        let message = error.to_string();
        match error {
            EditError::Piece(error) => levels::piece_error(&error, "put"),
            EditError::NoSuchPiece(_, name) => status::not_found(Reason::PieceNotFound, "piece", name, message),
            EditError::Enclosed(_) => status::failure(Reason::NpcInTheWay, message),
            EditError::Contended(_) => status::retry(Reason::Busy, INBOX_TIME, message),
        }
    }
}

impl From<SimError> for Status {
    fn from(error: SimError) -> Self {
        match error {
            SimError::Busy => status::retry(Reason::Busy, INBOX_TIME, error.to_string()),
            SimError::Stopped => status::failure(Reason::WorldStopped, error.to_string()),
        }
    }
}

impl From<WorldsError> for Status {
    fn from(error: WorldsError) -> Self {
        let message = error.to_string();
        match error {
            WorldsError::UnknownWorld(world) => {
                status::not_found(Reason::WorldNotFound, "world", world.to_string(), message)
            }
            WorldsError::TooManyWorlds(_) | WorldsError::NoThread(_) => {
                status::quota(Reason::TooManyWorlds, "server", message)
            }
            WorldsError::WorldQuota(error) => status::quota(Reason::TooManyWorlds, error.subject(), message),
            WorldsError::NpcQuota(error) => status::quota(Reason::TooManyNpcs, error.subject(), message),
            WorldsError::Map(error) => map_error(error),
            WorldsError::NotOwner(_) => status::failure(Reason::NotOwner, message),
            WorldsError::Edit(error) => error.into(),
            WorldsError::Store(error) => store_error(error),
            WorldsError::Moving(_) => status::retry(Reason::WorldMoving, TAKEOVER_TIME, message),
            WorldsError::Unconfirmed(_) => status::failure(Reason::NotConfirmed, message),
            WorldsError::Npc(error) => error.into(),
            WorldsError::Sim(error) => error.into(),
            WorldsError::BadItem(field, _) => status::invalid(field, message),
            WorldsError::Lost(..) => status::failure(Reason::Internal, message),
        }
    }
}

impl From<EventsLost> for Status {
    fn from(error: EventsLost) -> Self {
        status::failure(Reason::EventsLost, error.to_string())
    }
}

fn store_error(error: StoreError) -> Status {
    let message = error.to_string();
    match error {
        StoreError::Saved(_) => status::failure(Reason::Internal, message),
        StoreError::Lost(_) | StoreError::Expired => status::retry(Reason::WorldMoving, TAKEOVER_TIME, message),
        StoreError::Unavailable(_) => status::failure(Reason::NotConfirmed, message),
    }
}

fn map_error(error: MapError) -> Status {
    match error {
        MapError::Memory(error) => error.into(),
        MapError::Lost(_) => status::failure(Reason::Internal, error.to_string()),
    }
}

impl From<EnvError> for Status {
    fn from(error: EnvError) -> Self {
        let message = error.to_string();
        match error {
            EnvError::Unknown(env) => status::not_found(Reason::EnvNotFound, "environment", env.to_string(), message),
            EnvError::Map(error) => map_error(error),
            EnvError::Memory(error) => error.into(),
            EnvError::NotOwner(_) => status::failure(Reason::NotOwner, message),
            EnvError::TooMany(_) => status::quota(Reason::TooManyEnvs, "server", message),
            EnvError::Busy(_) => status::failure(Reason::StepInProgress, message),
            EnvError::NoGround(_) | EnvError::Host(_) => status::failure(Reason::NoGround, message),
            EnvError::Gone(_) => status::failure(Reason::WorldStopped, message),
            EnvError::Lost(_) | EnvError::Failed(_) => status::failure(Reason::Internal, message),
        }
    }
}

impl From<Goodbye> for Status {
    fn from(goodbye: Goodbye) -> Self {
        let message = goodbye.to_string();
        match goodbye {
            Goodbye::ShuttingDown => surefoot_net::serving::shutting_down(),
            Goodbye::NotReading => status::failure(Reason::ReaderTooSlow, message),
            Goodbye::Unexpected => status::failure(Reason::MalformedRequest, message),
            Goodbye::BadAnswer(field, _) => status::invalid(field, message),
        }
    }
}
