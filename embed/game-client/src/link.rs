//! Connections to games: a blocking client of their environments.

use std::sync::Arc;
use std::time::{Duration, Instant};
use surefoot_net::client::{Credentials, Link, LinkError};
use surefoot_net::serving::MAX_MESSAGE_BYTES;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::env_service_client::EnvServiceClient;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use surefoot_rollout::Goal;
use surefoot_rollout::env::Route;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::sense::{OBSERVATION_VERSION, observation_len};
use surefoot_world::{Ability, Action, CharacterProfile, End, Map, Vec3};
use tokio::runtime::{Handle, Runtime};
use tokio::sync::mpsc;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Code, Request, Status, Streaming};

/// Longest wait for a new environment, including its level.
const OPEN_LIMIT: Duration = Duration::from_secs(600);
/// Longest wait for a step.
const STEP_LIMIT: Duration = Duration::from_secs(60);
/// Longest wait for the end of an environment.
const CLOSE_LIMIT: Duration = Duration::from_secs(2);
/// Bytes of a level in one message.
const UPLOAD_BYTES: usize = 512 * 1024;
/// Most places of a route in one message.
const MAX_ROUTE: usize = 256;

/// Why a game cannot serve as a world.
#[derive(Debug, Clone, thiserror::Error)]
pub enum GameError {
    /// The address or the credentials are unusable.
    #[error("{0}")]
    Link(Arc<LinkError>),
    /// No game answers at the address.
    #[error("cannot reach a game at {uri}: {reason}")]
    Unreachable {
        /// The address.
        uri: Arc<str>,
        /// What went wrong.
        reason: String,
    },
    /// The game refused a call.
    #[error("the game at {uri} refused: {message}")]
    Refused {
        /// The address.
        uri: Arc<str>,
        /// The game's message.
        message: String,
    },
    /// The game has stopped answering.
    #[error("the game at {uri} went away: {reason}")]
    Gone {
        /// The address.
        uri: Arc<str>,
        /// What went wrong.
        reason: String,
    },
    /// The game sent something that the contract does not allow.
    #[error("the game at {uri} breaks the contract: {wrong}")]
    Contract {
        /// The address.
        uri: Arc<str>,
        /// What is wrong, and what the contract requires.
        wrong: String,
    },
}

impl From<LinkError> for GameError {
    fn from(error: LinkError) -> Self {
        Self::Link(Arc::new(error))
    }
}

/// The level of a game, as imported, and the body of its NPCs.
#[derive(Debug, Clone)]
pub struct Level {
    /// The level. A Surefoot server needs a generated level, or a level that it has imported; games run their own.
    pub map: Arc<Map>,
    /// The body.
    pub body: CharacterProfile,
    /// Whether the NPCs collide with and see each other, which games do not offer.
    pub solid_npcs: bool,
}

/// A connection to a game; clones share it. Its calls block, so they must not be made on threads that run async code.
#[derive(Debug, Clone)]
pub struct Game {
    uri: Arc<str>,
    runtime: Arc<Runtime>,
    client: EnvServiceClient<Link>,
    /// A value that must outlive the connection.
    _kept: Option<Arc<dyn std::fmt::Debug + Send + Sync>>,
    maps: MapServiceClient<Link>,
}

impl Game {
    /// Connects to the game at `uri`.
    ///
    /// # Errors
    /// If the address or the credentials are unusable, or no game answers.
    pub fn connect(uri: &str, credentials: &Credentials) -> Result<Self, GameError> {
        let dialer = credentials.dial(uri)?;
        let uri: Arc<str> = uri.into();
        let unreachable = |reason| GameError::Unreachable { uri: uri.clone(), reason };
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build();
        let runtime = runtime.map_err(|error| unreachable(error.to_string()))?;
        let link = runtime.block_on(dialer.connect()).map_err(|error| unreachable(innermost(&error)))?;
        let maps = MapServiceClient::new(link.clone());
        let client = EnvServiceClient::new(link)
            .max_decoding_message_size(MAX_MESSAGE_BYTES)
            .max_encoding_message_size(MAX_MESSAGE_BYTES);
        Ok(Self { uri, runtime: Arc::new(runtime), client, maps, _kept: None })
    }

    /// The connection to a game at `uri` through a proxy, which lives as long as the connection.
    pub fn behind(self, uri: &str, between: impl std::fmt::Debug + Send + Sync + 'static) -> Self {
        Self { uri: uri.into(), _kept: Some(Arc::new(between)), ..self }
    }

    /// Its address.
    pub fn uri(&self) -> &str {
        &self.uri
    }

    /// Creates an environment with one NPC for each goal, each with one episode.
    ///
    /// # Errors
    /// If the game refuses, does not answer, or breaks the contract.
    pub fn open(&self, level: &Level, goals: &[Goal]) -> Result<GameEnv, GameError> {
        let to_wire = |goal: &Goal| wire::EnvGoal {
            start: Some(convert::to_wire(goal.start)),
            yaw: goal.yaw,
            goal: Some(convert::to_wire(goal.goal)),
        };
        let request = wire::CreateEnvRequest { goals: goals.iter().map(to_wire).collect(), ..self.request_on(level) };
        self.create(request, goals.len())
    }

    /// Creates an environment of `npc_count` NPCs with endless goals at distances in `band`, m, drawn with `seed`.
    ///
    /// # Errors
    /// Same as [`open`](Self::open).
    pub fn open_endless(
        &self,
        level: &Level,
        npc_count: usize,
        band: (f32, f32),
        seed: u64,
    ) -> Result<GameEnv, GameError> {
        let (goal_min_m, goal_max_m) = band;
        let request = wire::CreateEnvRequest {
            npc_count: npc_count as u32,
            seed,
            goal_min_m,
            goal_max_m,
            ..self.request_on(level)
        };
        self.create(request, npc_count)
    }

    fn request_on(&self, level: &Level) -> wire::CreateEnvRequest {
        let map = level.map.spec().map(convert::map_spec_to_wire);
        let map_hash = if map.is_none() { level.map.built_hash().to_hex() } else { String::new() };
        let body = Some(convert::body_to_wire(&level.body));
        wire::CreateEnvRequest { map, map_hash, body, solid_npcs: level.solid_npcs, ..Default::default() }
    }

    /// Uploads a level that is not generated to a Surefoot server, so that environments can be opened on it. The call
    /// is repeatable.
    ///
    /// # Errors
    /// If the server refuses, does not answer, or stores another level.
    pub fn keep(&self, map: &Map) -> Result<(), GameError> {
        let (file, hash) = (surefoot_levels::encode(map), map.built_hash().to_hex());
        let mut client = self.maps.clone();
        let kept = self.runtime.block_on(async {
            for (idx, part) in file.chunks(UPLOAD_BYTES).enumerate() {
                let offset = (idx * UPLOAD_BYTES) as u64;
                let request = wire::UploadChunkRequest { upload_id: hash.clone(), offset, data: part.to_vec() };
                client.upload_chunk(request).await?;
            }
            let (name, upload_id) = (hash.clone(), hash.clone());
            let format = wire::MapFormat::Saved.into();
            client.import_map(wire::ImportMapRequest { name, format, upload_id, ..Default::default() }).await
        });
        let kept = kept.map_err(|status| self.failed(&status))?.into_inner().map.unwrap_or_default().map_hash;
        if kept == hash { Ok(()) } else { Err(self.breach(format!("map_hash is {kept}, expected {hash}"))) }
    }

    fn create(&self, request: wire::CreateEnvRequest, npc_count: usize) -> Result<GameEnv, GameError> {
        let solid_npcs = request.solid_npcs;
        let mut request = Request::new(request);
        request.set_timeout(OPEN_LIMIT);
        let mut client = self.client.clone();
        let created = self.runtime.block_on(client.create_env(request));
        let created = created.map_err(|status| self.failed(&status))?.into_inner();
        let env_id = created.env_id;
        let observation_len = observation_len(solid_npcs);
        let first = self.first_state(&created, (npc_count, observation_len));
        let (requests, stream) = mpsc::channel(1);
        // The stream answers only after the first step, which therefore opens it.
        let mut env = GameEnv {
            game: self.clone(),
            env_id,
            requests,
            waiting: Some(stream),
            responses: None,
            state: EnvState::default(),
            encode_time: Duration::ZERO,
            observation_len,
        };
        env.state = first?;
        Ok(env)
    }

    fn first_state(
        &self,
        created: &wire::CreateEnvResponse,
        (npc_count, observation_len): (usize, usize),
    ) -> Result<EnvState, GameError> {
        for (what, found, expected) in [
            ("observation_len", created.observation_len, observation_len as u32),
            ("observation_version", created.observation_version, OBSERVATION_VERSION),
            ("action_len", created.action_len, ACTION_LEN as u32),
        ] {
            if found != expected {
                return Err(self.breach(format!("{what} is {found}, expected {expected}")));
            }
        }
        let observations = observations(&created.observations, npc_count * observation_len, "observations");
        let positions = convert::unpack_points(&created.positions, npc_count, "positions");
        Ok(EnvState {
            observations: observations.map_err(|error| self.breach(error.to_string()))?,
            positions: positions.map_err(|error| self.breach(error.to_string()))?,
            rewards: vec![0.0; npc_count],
            abilities: vec![Ability::WALK; npc_count],
            passed: vec![0; npc_count],
            ended: vec![None; npc_count],
            finals: Vec::new(),
        })
    }

    fn failed(&self, status: &Status) -> GameError {
        let uri = self.uri.clone();
        match status.code() {
            Code::Unavailable | Code::Unknown | Code::Cancelled | Code::DeadlineExceeded => {
                GameError::Gone { uri, reason: status.message().to_owned() }
            }
            Code::Unimplemented => self.breach("it does not serve surefoot.world.v1.EnvService".to_owned()),
            code => GameError::Refused { uri, message: format!("{} ({code:?})", status.message()) },
        }
    }

    fn breach(&self, wrong: String) -> GameError {
        GameError::Contract { uri: self.uri.clone(), wrong }
    }
}

/// The text of the root cause of an error.
fn innermost(error: &dyn std::error::Error) -> String {
    let mut error = error;
    while let Some(source) = error.source() {
        error = source;
    }
    error.to_string()
}

/// The state of an environment after a step, NPC by NPC.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EnvState {
    /// Observations, one after another.
    pub observations: Vec<f32>,
    /// Feet, m.
    pub positions: Vec<Vec3>,
    /// Rewards of the last step.
    pub rewards: Vec<f32>,
    /// The most demanding ability of the last step.
    pub abilities: Vec<Ability>,
    /// How many places of its route each NPC has passed.
    pub passed: Vec<u32>,
    /// How the episode of each NPC ended, if it did in the last step.
    pub ended: Vec<Option<End>>,
    /// NPCs whose episodes ended in the last step, each with its last observation.
    pub finals: Vec<(usize, Vec<f32>)>,
}

/// An environment that a game runs. Dropping it ends it there.
#[derive(Debug)]
pub struct GameEnv {
    game: Game,
    env_id: u64,
    requests: mpsc::Sender<wire::StreamEnvRequest>,
    /// The other end of `requests`, until the stream is open.
    waiting: Option<mpsc::Receiver<wire::StreamEnvRequest>>,
    responses: Option<Streaming<wire::StreamEnvResponse>>,
    state: EnvState,
    /// Time spent on packing and reading messages.
    encode_time: Duration,
    observation_len: usize,
}

impl GameEnv {
    /// Number of NPCs.
    pub fn npc_count(&self) -> usize {
        self.state.positions.len()
    }

    /// The state after the last step.
    pub fn state(&self) -> &EnvState {
        &self.state
    }

    /// Returns and resets the time spent on packing and reading messages.
    pub fn take_encode_time(&mut self) -> Duration {
        std::mem::take(&mut self.encode_time)
    }

    /// Steps all NPCs by one decision; the routes begin where it ends. Routes are cut after 256 places: the episode
    /// then ends there, as reached.
    ///
    /// # Errors
    /// If the game refuses, stops answering, or breaks the contract.
    ///
    /// # Panics
    /// If there is not one action for each NPC.
    pub fn step(&mut self, actions: &[Action], routes: &[Route]) -> Result<&EnvState, GameError> {
        self.send(actions, routes)?;
        self.receive()
    }

    /// Sends a step without waiting for its results.
    ///
    /// # Errors
    /// Same as [`step`](Self::step).
    ///
    /// # Panics
    /// If there is not one action for each NPC.
    pub fn send(&mut self, actions: &[Action], routes: &[Route]) -> Result<(), GameError> {
        assert_eq!(actions.len(), self.npc_count(), "one action for each NPC");
        let started = Instant::now();
        let actions = wire::EnvActions {
            actions: convert::pack(actions.iter().flat_map(|action| action.to_array())),
            routes: routes.iter().map(route_to_wire).collect(),
        };
        let request = wire::StreamEnvRequest { env_id: self.env_id, actions: Some(actions) };
        self.encode_time += started.elapsed();
        // If the stream has ended, the reason follows when its results are read.
        let _ = self.game.runtime.block_on(self.requests.send(request));
        let Some(stream) = self.waiting.take() else { return Ok(()) };
        let mut client = self.game.client.clone();
        let opened = self.game.runtime.block_on(client.stream_env(ReceiverStream::new(stream)));
        self.responses = Some(opened.map_err(|status| self.game.failed(&status))?.into_inner());
        Ok(())
    }

    /// Waits for the results of the step that was sent.
    ///
    /// # Errors
    /// Same as [`step`](Self::step).
    ///
    /// # Panics
    /// If no step was sent.
    pub fn receive(&mut self) -> Result<&EnvState, GameError> {
        let responses = self.responses.as_mut().expect("a step was sent");
        let next = async { tokio::time::timeout(STEP_LIMIT, responses.next()).await };
        let gone = |reason: String| GameError::Gone { uri: self.game.uri.clone(), reason };
        let message = match self.game.runtime.block_on(next) {
            Err(_) => return Err(gone(format!("no answer to a step for {} s", STEP_LIMIT.as_secs()))),
            Ok(None) => return Err(gone("it ended the stream of steps".to_owned())),
            Ok(Some(message)) => message.map_err(|status| self.game.failed(&status))?,
        };
        let started = Instant::now();
        let results = message.results.ok_or_else(|| self.game.breach("results is missing".to_owned()))?;
        self.state =
            state(results, (self.npc_count(), self.observation_len)).map_err(|wrong| self.game.breach(wrong))?;
        self.encode_time += started.elapsed();
        Ok(&self.state)
    }
}

impl Drop for GameEnv {
    fn drop(&mut self) {
        let mut client = self.game.client.clone();
        let request = wire::CloseEnvRequest { env_id: self.env_id };
        let close = async move {
            // A game ends idle environments by itself.
            let _ = tokio::time::timeout(CLOSE_LIMIT, client.close_env(request)).await;
        };
        match Handle::try_current() {
            Ok(_) => _ = self.game.runtime.spawn(close),
            Err(_) => self.game.runtime.block_on(close),
        }
    }
}

fn route_to_wire(route: &Route) -> wire::EnvRoute {
    wire::EnvRoute {
        npc: route.npc_idx as u32,
        waypoints: route.waypoints.iter().take(MAX_ROUTE).copied().map(convert::to_wire).collect(),
        start: route.start.map(|(start, _)| convert::to_wire(start)),
        yaw: route.start.map_or(0.0, |(_, yaw)| yaw),
    }
}

/// Reads observations.
fn observations(bytes: &[u8], len: usize, field: &'static str) -> Result<Vec<f32>, FieldError> {
    let values = convert::unpack(bytes, len, field)?;
    if values.iter().all(|value| value.is_finite()) { Ok(values) } else { Err(FieldError::NotFinite(field)) }
}

/// Reads the results of a step, or returns what is wrong with them.
fn state(results: wire::EnvResults, (npc_count, observation_len): (usize, usize)) -> Result<EnvState, String> {
    let text = |error: FieldError| error.to_string();
    for (what, found) in [("abilities", results.abilities.len()), ("passed", results.passed.len())] {
        if found != npc_count {
            return Err(format!("results.{what} has {found} values for {npc_count} NPCs"));
        }
    }
    let (mut ended, mut finals) = (vec![None; npc_count], Vec::new());
    for wire::EnvEnd { npc, outcome, final_observation } in results.ends {
        let place = ended.get_mut(npc as usize).ok_or(format!("results.ends names npc {npc} of {npc_count} NPCs"))?;
        *place = Some(convert::end(outcome).ok_or(format!("results.ends.outcome has the unknown value {outcome}"))?);
        let last = observations(&final_observation, observation_len, "results.ends.final_observation").map_err(text)?;
        finals.push((npc as usize, last));
    }
    let rewards = convert::unpack(&results.rewards, npc_count, "results.rewards").map_err(text)?;
    if !rewards.iter().all(|reward| reward.is_finite()) {
        return Err(text(FieldError::NotFinite("results.rewards")));
    }
    Ok(EnvState {
        observations: observations(&results.observations, npc_count * observation_len, "results.observations")
            .map_err(text)?,
        positions: convert::unpack_points(&results.positions, npc_count, "results.positions").map_err(text)?,
        rewards,
        abilities: results.abilities.iter().map(|ability| convert::ability((*ability).into())).collect(),
        passed: results.passed,
        ended,
        finals,
    })
}
