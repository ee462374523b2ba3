//! From the server's errors to statuses: one match for each, exhaustive.

use crate::envs::EnvError;
use crate::errors::SimError;
use crate::hosted::NpcError;
use crate::messages::Goodbye;
use crate::worlds::WorldsError;
use surefoot_net::status;
use tonic::Status;

impl From<NpcError> for Status {
    fn from(error: NpcError) -> Self {
        let message = error.to_string();
        match error {
            NpcError::Unknown(npc) => status::not_found("npc", npc.to_string(), message),
            NpcError::Full { .. } => status::exhausted(message),
            NpcError::Outside { field, .. } => status::invalid(field, message),
            NpcError::Down(_) | NpcError::NoGround(_) => Status::failed_precondition(message),
        }
    }
}

impl From<SimError> for Status {
    fn from(error: SimError) -> Self {
        match error {
            SimError::Busy => status::exhausted(error.to_string()),
            SimError::Stopped => status::unavailable(error.to_string()),
        }
    }
}

impl From<WorldsError> for Status {
    fn from(error: WorldsError) -> Self {
        let message = error.to_string();
        match error {
            WorldsError::UnknownWorld(world) => status::not_found("world", world.to_string(), message),
            WorldsError::TooManyWorlds(_) | WorldsError::NoThread(_) | WorldsError::Quota(_) => {
                status::exhausted(message)
            }
            WorldsError::Npc(error) => error.into(),
            WorldsError::Sim(error) => error.into(),
            WorldsError::Lost(..) => Status::internal(message),
        }
    }
}

impl From<EnvError> for Status {
    fn from(error: EnvError) -> Self {
        let message = error.to_string();
        match error {
            EnvError::Unknown(env) => status::not_found("environment", env.to_string(), message),
            EnvError::TooMany(_) => status::exhausted(message),
            EnvError::Busy(_) => Status::aborted(message),
            EnvError::NoGround(_) => Status::failed_precondition(message),
            EnvError::Lost(_) => Status::internal(message),
        }
    }
}

impl From<Goodbye> for Status {
    fn from(goodbye: Goodbye) -> Self {
        let message = goodbye.to_string();
        match goodbye {
            Goodbye::ShuttingDown => status::unavailable(message),
            Goodbye::NotReading => Status::aborted(message),
            Goodbye::Unexpected => Status::invalid_argument(message),
            Goodbye::BadAnswer(field, _) => status::invalid(field, message),
            Goodbye::Sim(error) => error.into(),
        }
    }
}
