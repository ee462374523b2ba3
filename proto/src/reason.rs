//! The reasons that errors carry in their `google.rpc.ErrorInfo`: stable names for programs to act on. Each reason has one
//! status code.

use tonic::{Code, Status};
use tonic_types::StatusExt;

/// Domain of every `ErrorInfo`.
pub const DOMAIN: &str = "surefoot";

/// Declares the reasons: variant, name on the wire, code, meaning.
macro_rules! reasons {
    ($($variant:ident $name:literal $code:ident $meaning:literal,)*) => {
        /// Why a call failed.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Reason {
            $(#[doc = $meaning] $variant,)*
        }

        impl Reason {
            /// All reasons.
            pub const ALL: &[Reason] = &[$(Reason::$variant),*];

            /// Returns the name on the wire.
            pub fn name(self) -> &'static str {
                match self { $(Reason::$variant => $name,)* }
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
    InvalidField "INVALID_FIELD" InvalidArgument "A field of the request is missing, out of range or malformed; `BadRequest` names it.",
    InvalidPageToken "INVALID_PAGE_TOKEN" InvalidArgument "The page token is not one that this call returned.",
    RequestIdReused "REQUEST_ID_REUSED" InvalidArgument "The request id was used for another request within the last ten minutes.",
    MalformedRequest "MALFORMED_REQUEST" InvalidArgument "The request cannot be decoded, or a stream's message comes out of turn.",
    WorldNotFound "WORLD_NOT_FOUND" NotFound "There is no such world.",
    NpcNotFound "NPC_NOT_FOUND" NotFound "There is no such NPC.",
    MoverNotFound "MOVER_NOT_FOUND" NotFound "The map of the world has no mover of that name.",
    PieceNotFound "PIECE_NOT_FOUND" NotFound "The map of the world has no piece of that name.",
    PlayerNotFound "PLAYER_NOT_FOUND" NotFound "There is no such player.",
    EnvNotFound "ENV_NOT_FOUND" NotFound "There is no such environment, or it ended because it was not stepped.",
    MapNotFound "MAP_NOT_FOUND" NotFound "No map with that hash was imported on this service.",
    GraphNotFound "GRAPH_NOT_FOUND" NotFound "The graph is not in memory: call `StartBuild`, which loads a cached graph at once.",
    UploadNotFound "UPLOAD_NOT_FOUND" NotFound "There is no such upload, or it was dropped after five minutes.",
    BuildNotFound "BUILD_NOT_FOUND" NotFound "There is no such build, or it ended more than ten minutes ago.",
    VertexNotFound "VERTEX_NOT_FOUND" NotFound "The graph has no such vertex.",
    LayerNotFound "LAYER_NOT_FOUND" NotFound "The level has no such layer.",
    NpcDown "NPC_DOWN" FailedPrecondition "The NPC fell, burned or drowned: teleport it first.",
    NpcInTheWay "NPC_IN_THE_WAY" FailedPrecondition "A piece would enclose an NPC that finds no place nearby: move the NPC first.",
    NoGround "NO_GROUND" FailedPrecondition "The map has no navigable ground.",
    GameRefused "GAME_REFUSED" FailedPrecondition "The game could not create the environment; the message says why.",
    PolicyMismatch "POLICY_MISMATCH" FailedPrecondition "The planner proves edges with another policy than the caller's; the message says which to start.",
    ObservationMismatch "OBSERVATION_MISMATCH" FailedPrecondition "The worker expects another layout of observations.",
    TooManyWorlds "TOO_MANY_WORLDS" ResourceExhausted "The server or this client has as many worlds as allowed.",
    TooManyNpcs "TOO_MANY_NPCS" ResourceExhausted "The world or this client has as many NPCs as allowed.",
    TooManyPieces "TOO_MANY_PIECES" ResourceExhausted "The map would have more pieces than fit.",
    TooManyPlayers "TOO_MANY_PLAYERS" ResourceExhausted "The world has as many players as it holds.",
    TooManyBodies "TOO_MANY_BODIES" ResourceExhausted "The world has NPCs of as many bodies as allowed.",
    TooManyEnvs "TOO_MANY_ENVS" ResourceExhausted "The server or this client has as many environments as allowed.",
    TooManyActors "TOO_MANY_ACTORS" ResourceExhausted "The learner has as many actors as it was started for.",
    OutOfMemory "OUT_OF_MEMORY" ResourceExhausted "The service's memory budget does not hold this as well; the message says how much is used by whom.",
    TooManyMaps "TOO_MANY_MAPS" ResourceExhausted "All kept maps are in use.",
    TooManyUploads "TOO_MANY_UPLOADS" ResourceExhausted "This client has as many uploads under way as allowed: import one, or wait until it is dropped.",
    TooManyBuilds "TOO_MANY_BUILDS" ResourceExhausted "As many builds as allowed are running or waiting.",
    TooLarge "TOO_LARGE" OutOfRange "The request asks for more than the service allows in one request, or is too large; the message says how much it allows.",
    EventsLost "EVENTS_LOST" OutOfRange "The events after that cursor are no longer kept, or are of another epoch: read the state again.",
    LayersChanged "LAYERS_CHANGED" Aborted "Somebody else has changed the layers since that revision.",
    StepInProgress "STEP_IN_PROGRESS" Aborted "Another step of this environment is running.",
    ActorReplaced "ACTOR_REPLACED" Aborted "The same actor has connected again.",
    ReaderTooSlow "READER_TOO_SLOW" Aborted "The stream was not read in time.",
    Starting "STARTING" Unavailable "The service is starting: it restores what was saved.",
    Busy "BUSY" Unavailable "The world has too many calls waiting.",
    WorldStopped "WORLD_STOPPED" Unavailable "The world has stopped.",
    StoreUnavailable "STORE_UNAVAILABLE" Unavailable "What several services share, the record or the blobs, cannot be reached now: what is in memory goes on being served, nothing is stored.",
    WorldElsewhere "WORLD_ELSEWHERE" NotFound "The world runs on another server of the fleet; `address` in the metadata of the `ErrorInfo` says where.",
    WorldMoving "WORLD_MOVING" Unavailable "The world's server is gone, and another one takes it over: ask `LocateWorld` where it runs.",
    NotConfirmed "NOT_CONFIRMED" Unavailable "The record of the fleet does not answer: the change is not durable, and may be lost or made later.",
    ShuttingDown "SHUTTING_DOWN" Unavailable "The service is shutting down.",
    DeadlineExceeded "DEADLINE_EXCEEDED" DeadlineExceeded "There was no answer in time.",
    Cancelled "CANCELLED" Cancelled "The caller has given the call up.",
    BuildCancelled "BUILD_CANCELLED" Cancelled "The build was cancelled.",
    TokenMissing "TOKEN_MISSING" Unauthenticated "The call needs a token.",
    TokenUnknown "TOKEN_UNKNOWN" Unauthenticated "The token is not known here.",
    NotOwner "NOT_OWNER" PermissionDenied "The object belongs to another client: only its owner or an admin may change it.",
    RoleForbidden "ROLE_FORBIDDEN" PermissionDenied "The role of the token may not make this call.",
    OriginForbidden "ORIGIN_FORBIDDEN" PermissionDenied "Pages of this origin may not call the service.",
    UnknownMethod "UNKNOWN_METHOD" Unimplemented "The service has no such method.",
    StoreFailed "STORE_FAILED" FailedPrecondition "A file of the service cannot be read or written, such as a level's layers, without which no plans are made; the message says which and what to do.",
    Internal "INTERNAL" Internal "A defect of the service.",
}

impl Reason {
    /// Returns the reason of a status; `None` if it has none or one that this version does not know.
    pub fn of(status: &Status) -> Option<Self> {
        let info = status.get_details_error_info().filter(|info| info.domain == DOMAIN)?;
        Self::ALL.iter().copied().find(|reason| reason.name() == info.reason)
    }
}

/// The address at which a world runs, of a status with [`Reason::WorldElsewhere`].
pub fn address_of(status: &Status) -> Option<String> {
    let info = status.get_details_error_info().filter(|_| Reason::of(status) == Some(Reason::WorldElsewhere))?;
    info.metadata.get("address").cloned()
}
