//! The roles that may call each method: one table for all services, which is the whole policy.

use Role::{Admin, Client, Designer, Worker};

/// Role of a token. It determines the methods that may be called with the token.
///
/// In a file of tokens, its name is the variant in lower case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::Display, strum::EnumString)]
#[strum(serialize_all = "lowercase")]
pub enum Role {
    /// A game: worlds, NPCs, plans.
    Client,
    /// An NPC worker.
    Worker,
    /// A level designer: everything that a client may call, and edits.
    Designer,
    /// An administrator, who may call every method.
    Admin,
}

impl Role {
    /// All roles.
    pub const ALL: [Role; 4] = [Client, Worker, Designer, Admin];
}

const ALL_ROLES: &[Role] = &Role::ALL;
const GAMES: &[Role] = &[Client, Designer, Admin];
const WORKERS: &[Role] = &[Worker, Admin];
const DESIGNERS: &[Role] = &[Designer, Admin];

/// Methods by their full names, and the roles that may call them. A method that is missing here is refused to all
/// callers.
const METHODS: &[(&str, &[Role])] = &[
    ("surefoot.world.v1.WorldService/GetServer", GAMES),
    ("surefoot.world.v1.WorldService/CreateWorld", GAMES),
    ("surefoot.world.v1.WorldService/GetWorld", GAMES),
    ("surefoot.world.v1.WorldService/ListWorlds", GAMES),
    ("surefoot.world.v1.WorldService/DropWorld", GAMES),
    ("surefoot.world.v1.WorldService/SampleGround", GAMES),
    ("surefoot.world.v1.WorldService/SurveyMap", GAMES),
    ("surefoot.world.v1.WorldService/SpawnNpc", GAMES),
    ("surefoot.world.v1.WorldService/BatchSpawnNpcs", GAMES),
    ("surefoot.world.v1.WorldService/DespawnNpc", GAMES),
    ("surefoot.world.v1.WorldService/BatchDespawnNpcs", GAMES),
    ("surefoot.world.v1.WorldService/SetGoal", GAMES),
    ("surefoot.world.v1.WorldService/BatchSetGoals", GAMES),
    ("surefoot.world.v1.WorldService/TeleportNpc", GAMES),
    ("surefoot.world.v1.WorldService/BatchTeleportNpcs", GAMES),
    ("surefoot.world.v1.WorldService/GetNpc", GAMES),
    ("surefoot.world.v1.WorldService/BatchGetNpcs", GAMES),
    ("surefoot.world.v1.WorldService/ListNpcs", GAMES),
    ("surefoot.world.v1.WorldService/WatchWorld", GAMES),
    ("surefoot.world.v1.WorldService/WatchEvents", GAMES),
    ("surefoot.world.v1.WorldService/WatchStats", GAMES),
    ("surefoot.world.v1.WorldService/FollowNpc", GAMES),
    ("surefoot.world.v1.WorldService/GetMesh", GAMES),
    ("surefoot.world.v1.WorldService/GetFeatures", GAMES),
    ("surefoot.world.v1.WorldService/ListMovers", GAMES),
    ("surefoot.world.v1.WorldService/SetMover", GAMES),
    ("surefoot.world.v1.WorldService/EditMap", GAMES),
    ("surefoot.world.v1.WorldService/ListPieces", GAMES),
    ("surefoot.world.v1.WorldService/SpawnPlayer", GAMES),
    ("surefoot.world.v1.WorldService/MovePlayers", GAMES),
    ("surefoot.world.v1.WorldService/RemovePlayer", GAMES),
    ("surefoot.world.v1.WorldService/Work", WORKERS),
    ("surefoot.world.v1.DirectoryService/LocateWorld", ALL_ROLES),
    ("surefoot.world.v1.DirectoryService/ListServers", ALL_ROLES),
    ("surefoot.world.v1.EnvService/CreateEnv", GAMES),
    ("surefoot.world.v1.EnvService/StepEnv", GAMES),
    ("surefoot.world.v1.EnvService/StreamEnv", GAMES),
    ("surefoot.world.v1.EnvService/CloseEnv", GAMES),
    ("surefoot.learn.v1.LearnerService/Feed", WORKERS),
    ("surefoot.world.v1.MapService/ImportMap", ALL_ROLES),
    ("surefoot.world.v1.MapService/UploadChunk", ALL_ROLES),
    ("surefoot.world.v1.MapService/GetMap", ALL_ROLES),
    ("surefoot.world.v1.MapService/ListMaps", ALL_ROLES),
    ("surefoot.planner.v1.PlannerService/StartBuild", ALL_ROLES),
    ("surefoot.planner.v1.PlannerService/WatchBuild", ALL_ROLES),
    ("surefoot.planner.v1.PlannerService/ListBuilds", GAMES),
    ("surefoot.planner.v1.PlannerService/CancelBuild", GAMES),
    ("surefoot.planner.v1.PlannerService/GetGraph", ALL_ROLES),
    ("surefoot.planner.v1.PlannerService/FindPath", ALL_ROLES),
    ("surefoot.planner.v1.PlannerService/FindPaths", ALL_ROLES),
    ("surefoot.planner.v1.PlannerService/ReportTraversals", ALL_ROLES),
    ("surefoot.planner.v1.PlannerService/ListReports", GAMES),
    ("surefoot.planner.v1.PlannerService/DropReports", &[Admin]),
    ("surefoot.planner.v1.PlannerService/GetLayers", GAMES),
    ("surefoot.planner.v1.PlannerService/WatchGraph", ALL_ROLES),
    ("surefoot.planner.v1.PlannerService/ListGraphs", GAMES),
    ("surefoot.planner.v1.PlannerService/ProbeEdge", GAMES),
    ("surefoot.planner.v1.PlannerService/CompareGraphs", GAMES),
    ("surefoot.planner.v1.PlannerService/PutLayer", DESIGNERS),
    ("surefoot.planner.v1.PlannerService/AppendEdits", DESIGNERS),
    ("surefoot.planner.v1.PlannerService/UndoEdits", DESIGNERS),
];

/// The credentials that a call needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Access {
    /// Nothing.
    Open,
    /// Any valid token.
    AnyToken,
    /// A token of one of these roles; if the list is empty, all callers are refused.
    Roles(&'static [Role]),
}

/// Returns the credentials that a call of a path needs, such as `/surefoot.world.v1.WorldService/Work`.
pub(super) fn access(path: &str) -> Access {
    let path = path.trim_start_matches('/');
    match path.split_once('/') {
        Some(("grpc.health.v1.Health", _)) => Access::Open,
        Some(("grpc.reflection.v1.ServerReflection", _)) => Access::AnyToken,
        _ if path == "metrics" => Access::AnyToken,
        _ => Access::Roles(roles(path).unwrap_or_default()),
    }
}

/// Returns the roles that may call the method with a full name such as `surefoot.world.v1.WorldService/Work`; `None` if
/// the table lacks the method.
pub fn roles(method: &str) -> Option<&'static [Role]> {
    METHODS.iter().find(|(name, _)| *name == method).map(|(_, roles)| *roles)
}
