//! Converts the server's errors to statuses: one exhaustive match for each error type.

use crate::envs::EnvError;
use crate::hosted::{EditError, EventsLost, LivingError, NpcError, ZonesError};
use crate::messages::Goodbye;
use crate::sim::SimError;
use crate::store::StoreError;
use crate::worlds::WorldsError;
use std::fmt::Display;
use std::time::Duration;
use surefoot_net::levels::{MapError, grpc as levels};
use surefoot_net::status;
use surefoot_proto::reason::Reason;
use surefoot_world::arrival::NoFooting;
use tonic::Status;
use tracing::warn;

/// Retry delay for a busy world, which empties its inbox within a tick or two.
const INBOX_TIME: Duration = Duration::from_millis(50);
/// Retry delay for a world whose server is gone.
const TAKEOVER_TIME: Duration = Duration::from_secs(1);

/// Logs an error of a database or file, whose text is for operators only; clients get `shown`.
fn hidden(reason: Reason, shown: &str, error: &dyn Display) -> Status {
    warn!(%error, reason = reason.name(), "call failed: {shown}");
    status::failure(reason, shown)
}

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
            NpcError::NoFooting(NoFooting::InSolid, _) | NpcError::NoRoom { why: NoFooting::InSolid, .. } => {
                status::failure(Reason::GoalInSolid, message)
            }
            NpcError::NoFooting(NoFooting::InAir, _) | NpcError::NoRoom { why: NoFooting::InAir, .. } => {
                status::failure(Reason::GoalInAir, message)
            }
            NpcError::NoZone(_, name) => status::not_found(Reason::ZoneNotFound, "zone", name, message),
            NpcError::NoGoal(_) => status::failure(Reason::NoGoal, message),
            NpcError::OwnTarget(_) => status::invalid("target_npc_id", message),
            NpcError::OtherWorld(npc, _) => status::not_found(Reason::NpcNotFound, "npc", npc.to_string(), message),
            NpcError::Follows(_) => status::invalid("leader.npc_id", message),
            NpcError::TooDense { .. } => status::invalid("spacing", message),
            NpcError::NoPlayer(_, player) => {
                status::not_found(Reason::PlayerNotFound, "player", player.to_string(), message)
            }
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

impl From<ZonesError> for Status {
    fn from(error: ZonesError) -> Self {
        let message = error.to_string();
        match error {
            ZonesError::NoSuchZone(_, name) => status::not_found(Reason::ZoneNotFound, "zone", name, message),
            ZonesError::TooMany(world, _) => status::quota(Reason::TooManyZones, format!("world:{world}"), message),
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
            WorldsError::TooManyWorlds(_) => status::quota(Reason::TooManyWorlds, "server", message),
            WorldsError::NoThread(error) => {
                warn!(%error, "cannot create a world: the system refuses a thread");
                status::quota(Reason::TooManyWorlds, "server", "the system refuses a thread for another world")
            }
            WorldsError::WorldQuota(error) => status::quota(Reason::TooManyWorlds, error.subject(), message),
            WorldsError::NpcQuota(error) => status::quota(Reason::TooManyNpcs, error.subject(), message),
            WorldsError::Map(error) => map_error(error),
            WorldsError::NotOwner(_) => status::failure(Reason::NotOwner, message),
            WorldsError::Edit(error) => error.into(),
            WorldsError::Zones(error) => error.into(),
            WorldsError::Store(error) => store_error(error),
            WorldsError::Elsewhere(world, address) => status::elsewhere(world.to_string(), &address),
            WorldsError::Moving(_) => status::retry(Reason::WorldMoving, TAKEOVER_TIME, message),
            WorldsError::Unconfirmed(_) => status::failure(Reason::NotConfirmed, message),
            WorldsError::Npc(error) => error.into(),
            WorldsError::Sim(error) => error.into(),
            WorldsError::BadItem(field, _) => status::invalid(field, message),
            WorldsError::Lost(what, error) => hidden(Reason::Internal, &format!("{what} failed"), &error),
        }
    }
}

impl From<EventsLost> for Status {
    fn from(error: EventsLost) -> Self {
        status::failure(Reason::EventsLost, error.to_string())
    }
}

fn store_error(error: StoreError) -> Status {
    match error {
        StoreError::Saved(error) => hidden(Reason::Internal, "the server cannot write the file of the world", &error),
        StoreError::Lost(_) | StoreError::Expired => {
            status::retry(Reason::WorldMoving, TAKEOVER_TIME, error.to_string())
        }
        StoreError::Unavailable(error) => hidden(
            Reason::NotConfirmed,
            "the store of the fleet does not answer: the call may or may not have had an effect",
            &error,
        ),
        StoreError::Silent(_) => status::failure(Reason::NotConfirmed, error.to_string()),
        StoreError::Busy => status::retry(Reason::Busy, INBOX_TIME, error.to_string()),
        StoreError::CannotRun(_) => status::quota(Reason::TooManyWorlds, "server", error.to_string()),
    }
}

fn map_error(error: MapError) -> Status {
    match error {
        MapError::Memory(error) => error.into(),
        MapError::Lost(error) => hidden(Reason::Internal, "map generation failed", &error),
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
            EnvError::Quota(error) => status::quota(Reason::TooManyEnvs, error.subject(), message),
            EnvError::NoMap => status::invalid("map", message),
            EnvError::Busy(_) => status::failure(Reason::StepInProgress, message),
            EnvError::NoGround(_) => status::failure(Reason::NoGround, message),
            EnvError::Host(_) => status::failure(Reason::GameRefused, message),
            EnvError::Gone(_) => status::failure(Reason::WorldStopped, message),
            EnvError::Failed(_) => status::failure(Reason::Internal, message),
            EnvError::Lost(error) => hidden(Reason::Internal, "the environment failed", &error),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::envs::EnvId;
    use crate::hosted::SavedError;
    use crate::ids::{NpcId, WorldId};
    use crate::quota::Quota;
    use surefoot_net::levels::uploads::UploadError;
    use surefoot_net::memory::MemoryBudget;
    use surefoot_world::navigable::NoGround;
    use tokio::task::JoinError;
    use tonic_types::StatusExt;

    /// Text that only operators may see.
    const SECRET: &str = "db.internal:5432 refused as /var/lib/surefoot was read";

    async fn lost() -> JoinError {
        tokio::task::spawn_blocking(|| -> () { panic!("{SECRET}") }).await.unwrap_err()
    }

    fn saved() -> StoreError {
        SavedError::Io(SECRET.into(), std::io::Error::other(SECRET)).into()
    }

    #[tokio::test]
    async fn each_refusal_has_the_reason_that_fits_and_shows_no_text_of_the_machine() {
        let (world, npc, env) = (WorldId(1), NpcId::new(WorldId(1), 1), EnvId(1));
        let full = || Quota::new(0, "things").acquire("ann").unwrap_err();
        let memory = || MemoryBudget::new(0).reserve("ann", 1).unwrap_err();
        let unavailable = || StoreError::Unavailable(SECRET.to_owned());
        let cases: Vec<(Status, Reason)> = vec![
            (WorldsError::UnknownWorld(world).into(), Reason::WorldNotFound),
            (WorldsError::TooManyWorlds(1).into(), Reason::TooManyWorlds),
            (WorldsError::NoThread(std::io::Error::other(SECRET)).into(), Reason::TooManyWorlds),
            (WorldsError::WorldQuota(full()).into(), Reason::TooManyWorlds),
            (WorldsError::NpcQuota(full()).into(), Reason::TooManyNpcs),
            (WorldsError::NotOwner(world).into(), Reason::NotOwner),
            (WorldsError::Npc(NpcError::Unknown(npc)).into(), Reason::NpcNotFound),
            (WorldsError::Npc(NpcError::NoGround(NoGround)).into(), Reason::NoGround),
            (WorldsError::Sim(SimError::Busy).into(), Reason::Busy),
            (WorldsError::Map(MapError::Memory(memory())).into(), Reason::OutOfMemory),
            (WorldsError::Map(MapError::Lost(lost().await)).into(), Reason::Internal),
            (WorldsError::Store(saved()).into(), Reason::Internal),
            (WorldsError::Store(unavailable()).into(), Reason::NotConfirmed),
            (WorldsError::Store(StoreError::Lost(world)).into(), Reason::WorldMoving),
            (WorldsError::Elsewhere(world, "http://other:7600".to_owned()).into(), Reason::WorldElsewhere),
            (WorldsError::Moving(world).into(), Reason::WorldMoving),
            (WorldsError::Unconfirmed(world).into(), Reason::NotConfirmed),
            (WorldsError::Lost("sampling", lost().await).into(), Reason::Internal),
            (EnvError::Unknown(env).into(), Reason::EnvNotFound),
            (EnvError::TooMany(1).into(), Reason::TooManyEnvs),
            (EnvError::Quota(full()).into(), Reason::TooManyEnvs),
            (EnvError::Busy(env).into(), Reason::StepInProgress),
            (EnvError::NoMap.into(), Reason::InvalidField),
            (EnvError::NoGround(NoGround).into(), Reason::NoGround),
            (EnvError::Host("no level is loaded".to_owned()).into(), Reason::GameRefused),
            (EnvError::Failed(env).into(), Reason::Internal),
            (EnvError::Lost(lost().await).into(), Reason::Internal),
            (UploadError::TooMany.into(), Reason::TooManyUploads),
            (UploadError::Unknown("level".to_owned()).into(), Reason::UploadNotFound),
        ];
        for (status, reason) in cases {
            assert_eq!(Reason::of(&status), Some(reason), "{status}");
            assert_eq!(status.code(), reason.code());
            let shown = format!("{} {:?}", status.message(), status.get_error_details());
            for part in ["db.internal", "5432", "/var/lib", "panicked"] {
                assert!(!shown.contains(part), "{reason:?} shows {shown}");
            }
        }
    }
}
