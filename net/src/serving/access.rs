//! Which roles may call which methods: one table for all services, which is the whole policy.

use Role::{Admin, Client, Designer, Worker};

/// Role of a token, which determines the methods that its holder may call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// A game: worlds, NPCs, plans.
    Client,
    /// An NPC worker.
    Worker,
    /// A level designer: everything that a client may do, and edits.
    Designer,
    /// An administrator, who may call every method.
    Admin,
}

impl Role {
    /// All roles.
    pub const ALL: [Role; 4] = [Client, Worker, Designer, Admin];

    /// Returns the name of the role in a file of tokens.
    pub fn name(self) -> &'static str {
        match self {
            Client => "client",
            Worker => "worker",
            Designer => "designer",
            Admin => "admin",
        }
    }
}

const EVERYBODY: &[Role] = &Role::ALL;
const GAMES: &[Role] = &[Client, Designer, Admin];
const WORKERS: &[Role] = &[Worker, Admin];
const DESIGNERS: &[Role] = &[Designer, Admin];

/// Methods by their full names, and who may call them. A method that is missing here is refused to everybody.
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
    ("surefoot.world.v1.DirectoryService/LocateWorld", EVERYBODY),
    ("surefoot.world.v1.DirectoryService/ListServers", EVERYBODY),
    ("surefoot.world.v1.EnvService/CreateEnv", GAMES),
    ("surefoot.world.v1.EnvService/StepEnv", GAMES),
    ("surefoot.world.v1.EnvService/StreamEnv", GAMES),
    ("surefoot.world.v1.EnvService/CloseEnv", GAMES),
    ("surefoot.learn.v1.LearnerService/Feed", WORKERS),
    ("surefoot.world.v1.MapService/ImportMap", EVERYBODY),
    ("surefoot.world.v1.MapService/UploadChunk", EVERYBODY),
    ("surefoot.world.v1.MapService/GetMap", EVERYBODY),
    ("surefoot.world.v1.MapService/ListMaps", EVERYBODY),
    ("surefoot.planner.v1.PlannerService/StartBuild", EVERYBODY),
    ("surefoot.planner.v1.PlannerService/WatchBuild", EVERYBODY),
    ("surefoot.planner.v1.PlannerService/ListBuilds", GAMES),
    ("surefoot.planner.v1.PlannerService/CancelBuild", GAMES),
    ("surefoot.planner.v1.PlannerService/GetGraph", EVERYBODY),
    ("surefoot.planner.v1.PlannerService/FindPath", EVERYBODY),
    ("surefoot.planner.v1.PlannerService/FindPaths", EVERYBODY),
    ("surefoot.planner.v1.PlannerService/ReportTraversals", EVERYBODY),
    ("surefoot.planner.v1.PlannerService/ListReports", GAMES),
    ("surefoot.planner.v1.PlannerService/DropReports", &[Admin]),
    ("surefoot.planner.v1.PlannerService/GetLayers", GAMES),
    ("surefoot.planner.v1.PlannerService/WatchGraph", EVERYBODY),
    ("surefoot.planner.v1.PlannerService/ListGraphs", GAMES),
    ("surefoot.planner.v1.PlannerService/ProbeEdge", GAMES),
    ("surefoot.planner.v1.PlannerService/CompareGraphs", GAMES),
    ("surefoot.planner.v1.PlannerService/PutLayer", DESIGNERS),
    ("surefoot.planner.v1.PlannerService/AppendEdits", DESIGNERS),
    ("surefoot.planner.v1.PlannerService/UndoEdits", DESIGNERS),
];

/// What a caller needs to be answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Access {
    /// Nothing.
    Open,
    /// Any valid token.
    AnyToken,
    /// A token of one of these roles; if there are none, nobody is answered.
    Roles(&'static [Role]),
}

/// Returns what a caller needs to be answered at a path, such as `/surefoot.world.v1.WorldService/Work`.
pub(super) fn access(path: &str) -> Access {
    let path = path.trim_start_matches('/');
    match path.split_once('/') {
        Some(("grpc.health.v1.Health", _)) => Access::Open,
        Some(("grpc.reflection.v1.ServerReflection", _)) => Access::AnyToken,
        _ if path == "metrics" => Access::AnyToken,
        _ => Access::Roles(roles(path).unwrap_or_default()),
    }
}

/// Returns the roles that may call the method with a full name such as `surefoot.world.v1.WorldService/Work`; `None` if the
/// table lacks the method.
pub fn roles(method: &str) -> Option<&'static [Role]> {
    METHODS.iter().find(|(name, _)| *name == method).map(|(_, roles)| *roles)
}
