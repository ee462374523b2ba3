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

/// A service, roles, and the names of its methods that these roles may call.
type Methods = (&'static str, &'static [Role], &'static str);

/// All methods. A method that is missing here is refused to all callers.
const METHODS: &[Methods] = &[
    (
        "surefoot.world.v1.WorldService",
        GAMES,
        "GetServer CreateWorld GetWorld ListWorlds DropWorld SampleGround SurveyMap SpawnNpc BatchSpawnNpcs \
         DespawnNpc BatchDespawnNpcs SetGoal BatchSetGoals SetGroupGoal MoveTargets ClearGoals SetRoutes \
         GetRoutes TeleportNpc BatchTeleportNpcs GetNpc BatchGetNpcs ListNpcs WatchWorld WatchSegments WatchEvents \
         WatchStats FollowNpc GetMesh GetFeatures ListMovers SetMover EditMap ListPieces SetZones ListZones SetNpcTags \
         SetGaits LookAt SpawnPlayer MovePlayers RemovePlayer",
    ),
    ("surefoot.world.v1.WorldService", WORKERS, "Work"),
    ("surefoot.world.v1.DirectoryService", ALL_ROLES, "LocateWorld ListServers"),
    ("surefoot.world.v1.EnvService", GAMES, "CreateEnv StepEnv StreamEnv CloseEnv"),
    ("surefoot.learn.v1.LearnerService", WORKERS, "Feed"),
    ("surefoot.world.v1.MapService", ALL_ROLES, "ImportMap UploadChunk GetMap ListMaps"),
    (
        "surefoot.planner.v1.PlannerService",
        ALL_ROLES,
        "StartBuild WatchBuild GetGraph FindPath FindPaths RankPlaces FindReachable ReportTraversals WatchGraph",
    ),
    (
        "surefoot.planner.v1.PlannerService",
        GAMES,
        "ListBuilds CancelBuild ListReports GetLayers ListGraphs ProbeEdge CompareGraphs",
    ),
    ("surefoot.planner.v1.PlannerService", &[Admin], "DropReports"),
    ("surefoot.planner.v1.PlannerService", DESIGNERS, "PutLayer AppendEdits UndoEdits"),
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
    let (service, method) = method.split_once('/')?;
    let is_in = |(name, _, methods): &&Methods| *name == service && methods.split(' ').any(|it| it == method);
    METHODS.iter().find(is_in).map(|(_, roles, _)| *roles)
}
