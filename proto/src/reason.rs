//! The reasons that errors carry in their `google.rpc.ErrorInfo`: stable names for programs to act on. Each reason has
//! one status code.

use tonic::{Code, Status};
use tonic_types::StatusExt;

/// Domain of every `ErrorInfo`.
pub const DOMAIN: &str = "surefoot";

/// Declares the reasons: variant, code, meaning. The name on the wire is the variant in upper case.
macro_rules! reasons {
    ($($variant:ident $code:ident $meaning:literal,)*) => {
        /// Why a call failed.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[derive(strum::IntoStaticStr, strum::EnumString)]
        #[strum(serialize_all = "SCREAMING_SNAKE_CASE")]
        pub enum Reason {
            $(#[doc = $meaning] $variant,)*
        }

        impl Reason {
            /// All reasons.
            pub const ALL: &[Reason] = &[$(Reason::$variant),*];

            /// Returns the name on the wire.
            pub fn name(self) -> &'static str {
                self.into()
            }

            /// Returns the status code of errors with this reason.
            pub fn code(self) -> Code {
                match self { $(Reason::$variant => Code::$code,)* }
            }

            /// Returns the meaning, as Markdown.
            pub fn meaning(self) -> &'static str {
                match self { $(Reason::$variant => $meaning,)* }
            }
        }
    };
}

reasons! {
    InvalidField InvalidArgument "A field of the request is missing, out of range or malformed; `BadRequest` names it.",
    InvalidPageToken InvalidArgument "The page token is not one that this call returned.",
    RequestIdReused InvalidArgument "The request id was used for another request within the last ten minutes.",
    MalformedRequest InvalidArgument "The request cannot be decoded, or a message of a stream is out of order.",
    WorldNotFound NotFound "There is no such world.",
    NpcNotFound NotFound "There is no such NPC.",
    MoverNotFound NotFound "The map of the world has no mover of that name.",
    PieceNotFound NotFound "The map of the world has no piece of that name.",
    ZoneNotFound NotFound "The world has no zone of that name.",
    PlayerNotFound NotFound "There is no such player.",
    EnvNotFound NotFound "There is no such environment, or it ended because it was not stepped.",
    MapNotFound NotFound "No map with that hash was imported on this service.",
    GraphNotFound NotFound "The graph is not in memory: call `StartBuild`, which loads a cached graph at once.",
    UploadNotFound NotFound "There is no such upload, or it was dropped after five minutes.",
    BuildNotFound NotFound "There is no such build, or it ended more than ten minutes ago.",
    VertexNotFound NotFound "The graph has no such vertex.",
    LayerNotFound NotFound "The level has no such layer.",
    NpcDown FailedPrecondition "The NPC fell, burned or drowned: teleport it first.",
    GoalInSolid FailedPrecondition
        "The goal lies in solid ground or too close to it, and there is no place to stand within `snap`: move it.",
    GoalInAir FailedPrecondition "There is no ground within `snap` of the goal: move it.",
    NoGoal FailedPrecondition "The NPC has no goal that could be moved: set one first.",
    NpcInTheWay FailedPrecondition "A piece would enclose an NPC that finds no place nearby: move the NPC first.",
    NoGround FailedPrecondition "The map has no navigable ground.",
    GameRefused FailedPrecondition "The game could not create the environment; the message has the reason.",
    PolicyMismatch FailedPrecondition
        "The planner proves edges with another policy than the caller's; the message names the one to start.",
    ObservationMismatch FailedPrecondition "The worker expects another layout of observations.",
    TooManyWorlds ResourceExhausted "The server or this client has as many worlds as allowed.",
    TooManyNpcs ResourceExhausted "The world or this client has as many NPCs as allowed.",
    TooManyPieces ResourceExhausted "The map would have more pieces than allowed.",
    TooManyZones ResourceExhausted "The world would have more zones than allowed.",
    TooManyPlayers ResourceExhausted "The world has as many players as allowed.",
    TooManyBodies ResourceExhausted "The world has NPCs of as many bodies as allowed.",
    TooManyEnvs ResourceExhausted "The server or this client has as many environments as allowed.",
    TooManyActors ResourceExhausted "The learner has as many actors as it was started for.",
    OutOfMemory ResourceExhausted
        "The memory budget of the service is exhausted; the message lists the clients that use it.",
    TooManyMaps ResourceExhausted "All kept maps are in use.",
    TooManyUploads ResourceExhausted
        "This client has as many uploads as allowed: import one, or wait until one is dropped.",
    TooManyBuilds ResourceExhausted "As many builds as allowed are running or waiting.",
    TooLarge OutOfRange "The request exceeds a limit of the service; the message has the limit.",
    EventsLost OutOfRange
        "The events after that cursor are no longer kept, or the cursor is of another epoch: read the state again.",
    LayersChanged Aborted "Another caller has changed the layers since that revision.",
    StepInProgress Aborted "Another step of this environment is running.",
    ActorReplaced Aborted "The same actor has connected again.",
    ReaderTooSlow Aborted "The stream was not read in time.",
    Starting Unavailable "The service is starting and restores saved worlds.",
    Busy Unavailable "The world has too many calls waiting.",
    WorldStopped Unavailable "The world has stopped.",
    StoreUnavailable Unavailable
        "The database or the blobs of the fleet are unreachable: reads are served from memory, nothing is stored.",
    WorldElsewhere NotFound
        "Another server of the fleet has the world; its address is `address` in the metadata of the `ErrorInfo`.",
    WorldMoving Unavailable "The server of the world is gone, and another server takes it over: call `LocateWorld`.",
    NotConfirmed Unavailable "The database of the fleet does not answer: the change may be lost, or applied later.",
    ShuttingDown Unavailable "The service is shutting down.",
    DeadlineExceeded DeadlineExceeded "There was no answer before the deadline.",
    Cancelled Cancelled "The caller has cancelled the call.",
    BuildCancelled Cancelled "The build was cancelled.",
    TokenMissing Unauthenticated "The call needs a token.",
    TokenUnknown Unauthenticated "The token is unknown to this service.",
    NotOwner PermissionDenied "The object belongs to another client: only its owner or an admin may change it.",
    RoleForbidden PermissionDenied "The role of the token may not make this call.",
    OriginForbidden PermissionDenied "Pages of this origin may not call the service.",
    UnknownMethod Unimplemented "The service has no such method.",
    StoreFailed FailedPrecondition
        "A file of the service, such as a level's layers, cannot be read or written; the message names it.",
    Internal Internal "A defect of the service.",
}

impl Reason {
    /// Returns the reason of a status; `None` if it has none or one that is unknown to this version.
    pub fn of(status: &Status) -> Option<Self> {
        let info = status.get_details_error_info().filter(|info| info.domain == DOMAIN)?;
        info.reason.parse().ok()
    }
}

/// The address of the server that has a world, from a status with [`Reason::WorldElsewhere`].
pub fn address_of(status: &Status) -> Option<String> {
    let info = status.get_details_error_info().filter(|_| Reason::of(status) == Some(Reason::WorldElsewhere))?;
    info.metadata.get("address").cloned()
}
