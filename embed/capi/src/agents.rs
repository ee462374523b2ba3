//! Agents: the minds of the caller's NPCs, with what they sense, their goals and their memory.
//!
//! An observation is written by the simulation's own code (`surefoot_world::sense`), from rays that the caller has
//! cast. Decisions come from the policy. After [`Agents::new`] nothing is allocated, but for the texts of errors.

use crate::abi::{self, CAN_JUMP, GROUNDED, RAY_COUNT, RIDES};
use crate::checks;
use crate::error::{Fault, Status, chain};
use serde::{Deserialize, Serialize};
use std::path::Path;
use surefoot_policy::{Batch as Rows, Manifest, Scratch};
use surefoot_rollout::game::Rehearsals;
use surefoot_rollout::rehearse::NoiseStream;
use surefoot_rollout::{DEFAULT_NOISE_SHARE, Style};
use surefoot_world::arrival::{self, LINE_COUNT};
use surefoot_world::character::{ACTION_LEN, Ride, Support};
use surefoot_world::map::{Device, DeviceKind, Placed};
use surefoot_world::mesh::Surface;
use surefoot_world::sense::{self, Found, LastDecision, RAY_RANGE_M, RayCone, SenseContext};
use surefoot_world::{Action, Body, CharacterProfile, End, Episode, Npc, TaskConfig, Vec3};

/// Most agents of one handle.
const MAX_AGENTS: u32 = 65_536;
/// Most devices.
const MAX_DEVICES: usize = 20_000;
/// Bytes of a saved agent without its rows.
const SAVED_LEN: usize = 192;
/// Largest count in a saved agent; a larger one might overflow later.
const MAX_COUNT: u32 = 1 << 30;

/// `sf_policy`: weights that agents share.
#[derive(Debug)]
pub struct Policy {
    /// The network.
    pub inner: surefoot_policy::Policy,
    /// Name and shortened hash of the weights.
    pub label: String,
}

impl Policy {
    fn of(inner: surefoot_policy::Policy) -> Self {
        Self { label: inner.label(), inner }
    }

    /// The shipped policy of that name.
    pub fn shipped(name: &str) -> Result<Self, Fault> {
        let policy = surefoot_policy::Policy::shipped_named(name).ok_or_else(|| {
            let message = format!("no policy {name} is built in: use general-reactive or general-lstm");
            Fault::new(Status::NotFound, message)
        })?;
        policy.map(Self::of).map_err(|error| Fault::new(Status::Internal, chain(&error)))
    }

    /// Reads a model's folder.
    pub fn load(folder: &Path) -> Result<Self, Fault> {
        let policy = surefoot_policy::Policy::load(folder).map_err(|error| {
            let is_missing = matches!(error, surefoot_policy::CheckpointError::Io { .. });
            Fault::new(if is_missing { Status::NotFound } else { Status::BadFile }, chain(&error))
        })?;
        Ok(Self::of(policy))
    }

    /// Decodes the contents of a model's files.
    pub fn decode(manifest: &[u8], weights: &[u8]) -> Result<Self, Fault> {
        let manifest: Manifest = serde_json::from_slice(manifest)
            .map_err(|error| Fault::file(format!("manifest is not a model's manifest.json: {error}")))?;
        let policy = surefoot_policy::Policy::from_bytes(manifest, weights);
        policy.map(Self::of).map_err(|error| Fault::file(chain(&error)))
    }
}

/// A body as described by the caller.
#[derive(Debug, Clone, Copy)]
pub struct Sensed<'a> {
    body: Body,
    ticks_in_water: u32,
    others: &'a [abi::Other],
}

impl<'a> Sensed<'a> {
    /// Checks the numbers.
    pub fn new(state: &abi::State, others: &'a [abi::Other], drown_ticks: u32) -> Result<Self, Fault> {
        for (name, value, most) in [
            ("yaw", state.yaw.abs(), f32::MAX),
            ("breath_used", state.breath_used, 1.0),
            ("jetpack_seconds", state.jetpack_seconds, f32::MAX),
        ] {
            if !(0.0..=most).contains(&value) {
                let allowed = match name {
                    "yaw" => "finite",
                    "breath_used" => "0 to 1",
                    _ => "0 or more",
                };
                return Err(Fault::argument(format!("state.{name} is {value}, but must be {allowed}")));
            }
        }
        if state.flags & !(GROUNDED | CAN_JUMP | RIDES) != 0 {
            return Err(Fault::argument(format!(
                "state.flags is {}: it has bits that are not an sf_state_flag",
                state.flags
            )));
        }
        let has = |flag: u32| state.flags & flag != 0;
        let mut body = Body::at(state.feet.checked("state.feet")?, state.yaw);
        body.velocity = state.velocity.checked("state.velocity")?;
        body.support = if has(GROUNDED) { Support::Ground } else { Support::Air };
        body.air_jumps_left = has(CAN_JUMP).into();
        body.ticks_in_air = if has(GROUNDED) { 0 } else { u8::MAX };
        body.ride = has(RIDES).then_some(Ride { line_idx: 0, distance: 0.0 });
        body.fuel = state.jetpack_seconds;
        let ticks_in_water = (state.breath_used * drown_ticks as f32).round() as u32;
        Ok(Self { body, ticks_in_water, others })
    }

    /// The body.
    pub fn body(&self) -> &Body {
        &self.body
    }
}

/// The state of an agent, without its row of the policy's memory.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
struct Mind {
    episode: Option<Episode>,
    last: LastDecision,
    /// Velocity at the last observation, m/s.
    velocity: Vec3,
    /// Whether it was observed and has not decided since.
    is_observed: bool,
    /// Whether it has decided since its goal was set.
    has_decided: bool,
    noise: NoiseStream,
}

/// `sf_agents`: agents of one body that share a policy.
#[derive(Debug)]
pub struct Agents {
    policy: surefoot_policy::Policy,
    profile: CharacterProfile,
    task: TaskConfig,
    cone: RayCone,
    placed: Placed,
    minds: Vec<Mind>,
    /// How each agent that was prepared carries out its next decision, with its NPC on the map.
    prepared: Vec<Option<(Style, Npc)>>,
    /// Share of the noise in the last decision.
    noise_share: f32,
    /// An observation for each agent.
    observations: Vec<f32>,
    /// A row of the policy's memory for each agent.
    memories: Vec<f32>,
    batch: Batch,
    /// Room for the rays of all agents.
    pub rays: Vec<abi::Ray>,
    /// Room for their hits.
    pub hits: Vec<abi::Hit>,
    others: Vec<(Vec3, Vec3)>,
}

/// Rows of the agents that decide together.
#[derive(Debug)]
struct Batch {
    observations: Vec<f32>,
    memories: Vec<f32>,
    noise: Vec<f32>,
    actions: Vec<Action>,
    scratch: Scratch,
}

impl Agents {
    /// Makes room for `count` agents.
    pub fn new(policy: &Policy, profile: CharacterProfile, count: u32) -> Result<Self, Fault> {
        if !(1..=MAX_AGENTS).contains(&count) {
            return Err(Fault::argument(format!("max_agents is {count}, but must be 1 to {MAX_AGENTS}")));
        }
        let count = count as usize;
        let policy = policy.inner.clone();
        let (observation_len, memory_len) = (policy.observation_len(), policy.memory_len());
        let batch = Batch {
            observations: vec![0.0; count * observation_len],
            memories: vec![0.0; count * memory_len],
            noise: vec![0.0; count * ACTION_LEN],
            actions: vec![Action::default(); count],
            scratch: policy.scratch(count),
        };
        Ok(Self {
            observations: batch.observations.clone(),
            memories: batch.memories.clone(),
            batch,
            policy,
            profile,
            task: TaskConfig::default(),
            cone: RayCone::default(),
            placed: Placed::default(),
            minds: vec![Mind::default(); count],
            prepared: vec![None; count],
            noise_share: DEFAULT_NOISE_SHARE,
            rays: vec![abi::Ray::default(); count * RAY_COUNT],
            hits: vec![abi::Hit::default(); count * RAY_COUNT],
            others: Vec::with_capacity(abi::MAX_OTHERS),
        })
    }

    /// Whether rehearsals are for the policy and the body of these agents.
    pub fn are_those_of(&self, rehearsals: &Rehearsals) -> bool {
        rehearsals.policy().weights_hash() == self.policy.weights_hash() && *rehearsals.profile() == self.profile
    }

    /// Number of agents.
    pub fn count(&self) -> usize {
        self.minds.len()
    }

    /// Ticks after which a body drowns.
    pub fn drown_ticks(&self) -> u32 {
        self.task.drown_ticks
    }

    /// Replaces the devices that agents sense. Allocates.
    pub fn set_devices(&mut self, devices: &[abi::Device]) -> Result<(), Fault> {
        if devices.len() > MAX_DEVICES {
            return Err(Fault::argument(format!("{} devices are too many: at most {MAX_DEVICES}", devices.len())));
        }
        let mut placed = Placed::default();
        for (idx, device) in devices.iter().enumerate() {
            let from = device.from.checked(format_args!("devices[{idx}].from"))?;
            let of = || format!("devices[{idx}].kind is {}", device.kind);
            let unknown = || Fault::argument(of() + ": it must be a pad, zip line, teleporter or jetpack");
            let kind = checks::surface(device.kind)?.and_then(DeviceKind::of).ok_or_else(unknown)?;
            let to = kind.is_transport().then(|| device.to.checked(format_args!("devices[{idx}].to"))).transpose()?;
            placed.add(Device { to, two_way: device.two_way != 0, ..Device::new(kind, from) });
        }
        self.placed = placed;
        Ok(())
    }

    fn check(&self, agent: u32) -> Result<usize, Fault> {
        let idx = agent as usize;
        let most = self.count() - 1;
        if idx <= most { Ok(idx) } else { Err(Fault::argument(format!("agent {agent} does not exist: 0 to {most}"))) }
    }

    /// Clears an agent for a new body.
    pub fn begin(&mut self, agent: u32, seed: u64) -> Result<(), Fault> {
        let idx = self.check(agent)?;
        self.minds[idx] = Mind { noise: NoiseStream::new(0.0, seed, 0), ..Mind::default() };
        self.prepared[idx] = None;
        let len = self.policy.memory_len();
        self.memories[idx * len..(idx + 1) * len].fill(0.0);
        Ok(())
    }

    /// Gives an agent at `feet` another goal, m.
    pub fn set_goal(&mut self, agent: u32, feet: Vec3, goal: Vec3) -> Result<(), Fault> {
        let idx = self.check(agent)?;
        let mind = &mut self.minds[idx];
        (mind.episode, mind.has_decided, mind.is_observed) = (Some(Episode::new(goal, feet)), false, false);
        Ok(())
    }

    /// Records the position of an agent between decisions, and returns whether it has reached its goal.
    pub fn note(&mut self, agent: u32, feet: Vec3) -> Result<bool, Fault> {
        let idx = self.check(agent)?;
        let episode = self.minds[idx].episode.as_mut().ok_or_else(|| no_goal(agent))?;
        if episode.end.is_none() {
            episode.note_tick(feet, &self.task);
        }
        Ok(episode.end == Some(End::Reached))
    }

    /// The rays of a body.
    pub fn rays_of(&self, sensed: &Sensed<'_>, rays: &mut [abi::Ray]) {
        let origin = RayCone::eye(&self.profile, &sensed.body).into();
        for (ray, direction) in rays.iter_mut().zip(self.cone.directions_of(&sensed.body)) {
            *ray = abi::Ray { origin, direction: direction.into() };
        }
    }

    /// The rays from a body to a goal, m, that must meet nothing solid; none if the body has not arrived anyway.
    pub fn arrival_rays(&self, sensed: &Sensed<'_>, goal: Vec3, radius: f32) -> Option<[abi::Ray; LINE_COUNT]> {
        let lines = arrival::lines_to_goal(&self.profile, &sensed.body, goal, radius)?;
        Some(lines.map(|line| abi::Ray { origin: line.from.into(), direction: line.direction.into() }))
    }

    /// Whether a body has arrived at a goal, m, where its rays there have these hits.
    pub fn has_arrived(&self, sensed: &Sensed<'_>, goal: Vec3, radius: f32, hits: &[abi::Hit]) -> Result<bool, Fault> {
        let Some(lines) = arrival::lines_to_goal(&self.profile, &sensed.body, goal, radius) else { return Ok(false) };
        for (line, (idx, hit)) in lines.iter().zip(hits.iter().enumerate()) {
            let met = read_hit(idx, hit)?.filter(|(_, surface)| surface.is_solid());
            if met.is_some_and(|(distance, _)| distance < line.length) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Writes the observation of an agent from the hits of its rays.
    pub fn observe(&mut self, agent: u32, sensed: &Sensed<'_>, hits: &[abi::Hit]) -> Result<(), Fault> {
        let idx = self.check(agent)?;
        let (hits, body_hits) = read_hits(hits)?;
        self.others.clear();
        for other in sensed.others {
            self.others.push((other.feet.checked("others[].feet")?, other.velocity.checked("others[].velocity")?));
        }
        let mind = &mut self.minds[idx];
        let episode = mind.episode.as_mut().ok_or_else(|| no_goal(agent))?;
        if episode.end.is_none() {
            episode.note_tick(sensed.body.feet, &self.task);
        }
        if std::mem::take(&mut mind.has_decided) {
            episode.close_decision(&self.task);
        }
        mind.last.ticks_in_water = sensed.ticks_in_water;
        (mind.velocity, mind.is_observed) = (sensed.body.velocity, true);
        let context = SenseContext { placed: &self.placed, profile: &self.profile, task: &self.task };
        let found = Found { hits: &hits, body_hits: &body_hits, others: &self.others };
        let len = self.policy.observation_len();
        let row = &mut self.observations[idx * len..(idx + 1) * len];
        sense::observe_found(context, found, (&sensed.body, episode, &mind.last), row);
        Ok(())
    }

    /// The last observation of an agent.
    pub fn observation(&self, agent: u32) -> Result<&[f32], Fault> {
        let len = self.policy.observation_len();
        self.check(agent).map(|idx| &self.observations[idx * len..(idx + 1) * len])
    }

    /// Decides for agents that were observed.
    pub fn decide(
        &mut self,
        agents: impl Iterator<Item = u32> + Clone,
        noise_share: f32,
        actions: &mut [abi::Action],
    ) -> Result<(), Fault> {
        if !(0.0..=1.0).contains(&noise_share) {
            return Err(Fault::argument(format!("noise_share is {noise_share}, but must be 0 to 1")));
        }
        if actions.len() > self.count() {
            return Err(Fault::argument(format!("{} agents decide, but there are {}", actions.len(), self.count())));
        }
        for agent in agents.clone() {
            if !self.minds[self.check(agent)?].is_observed {
                let message = format!("agent {agent} was not observed after its last decision: observe it first");
                return Err(Fault::new(Status::BadState, message));
            }
        }
        let count = actions.len();
        self.noise_share = noise_share;
        self.gather(agents.clone());
        let (observation_len, memory_len) = (self.policy.observation_len(), self.policy.memory_len());
        let Batch { observations, memories, noise, actions: decided, scratch } = &mut self.batch;
        let rows = Rows {
            observations: &observations[..count * observation_len],
            memory: &mut memories[..count * memory_len],
            noise: if noise_share > 0.0 { &noise[..count * ACTION_LEN] } else { &[] },
        };
        self.policy.act(rows, scratch, decided);
        for (row, (agent, action)) in agents.zip(actions).enumerate() {
            let idx = agent as usize;
            let decided = self.batch.actions[row];
            let shape = |(style, npc): (Style, Npc)| style.shape(decided, &npc, &self.profile);
            let shaped = self.prepared[idx].take().map_or(decided, shape);
            *action = shaped.into();
            let memory = &self.batch.memories[row * memory_len..(row + 1) * memory_len];
            self.memories[idx * memory_len..(idx + 1) * memory_len].copy_from_slice(memory);
            let mind = &mut self.minds[idx];
            (mind.is_observed, mind.has_decided) = (false, true);
            (mind.last.velocity, mind.last.action) = (mind.velocity, shaped.to_array());
        }
        Ok(())
    }

    /// Copies the rows of agents into the batch, and draws their noise.
    fn gather(&mut self, agents: impl Iterator<Item = u32>) {
        let (observation_len, memory_len) = (self.policy.observation_len(), self.policy.memory_len());
        for (row, agent) in agents.enumerate() {
            let (idx, mind) = (agent as usize, &mut self.minds[agent as usize]);
            let observation = &self.observations[idx * observation_len..(idx + 1) * observation_len];
            self.batch.observations[row * observation_len..(row + 1) * observation_len].copy_from_slice(observation);
            let memory = &self.memories[idx * memory_len..(idx + 1) * memory_len];
            self.batch.memories[row * memory_len..(row + 1) * memory_len].copy_from_slice(memory);
            let style = self.prepared[idx].map_or(Style::Free, |(style, _)| style);
            mind.noise = mind.noise.with_share(self.noise_share);
            let noise = &mut self.batch.noise[row * ACTION_LEN..(row + 1) * ACTION_LEN];
            noise.iter_mut().zip(mind.noise.draw(style)).for_each(|(value, drawn)| *value = drawn);
        }
    }

    /// What a rehearsal needs of an agent, on the map, where its places have their origin at `origin`, m: its NPC, its
    /// row of the policy's memory, and its noise.
    pub fn rehearsing(
        &mut self,
        agent: u32,
        sensed: &Sensed<'_>,
        origin: Vec3,
    ) -> Result<(Npc, &[f32], &mut NoiseStream), Fault> {
        let idx = self.check(agent)?;
        let mind = &mut self.minds[idx];
        let mut episode = mind.episode.ok_or_else(|| no_goal(agent))?;
        episode.goal += origin;
        let mut body = sensed.body;
        body.feet += origin;
        let air_jumps = self.profile.extra_jumps;
        body.air_jumps_left = if body.is_grounded() { air_jumps } else { air_jumps.min(body.air_jumps_left) };
        let mut npc = Npc::outside(body, episode);
        npc.last = LastDecision { ticks_in_water: sensed.ticks_in_water, ..mind.last };
        mind.noise = mind.noise.with_share(self.noise_share);
        let len = self.policy.memory_len();
        Ok((npc, &self.memories[idx * len..(idx + 1) * len], &mut mind.noise))
    }

    /// Sets how an agent, with this NPC on the map, carries out its next decision.
    pub fn prepare(&mut self, agent: u32, style: Style, npc: Npc) -> Result<(), Fault> {
        let idx = self.check(agent)?;
        self.prepared[idx] = Some((style, npc));
        Ok(())
    }

    /// Records that an agent carries out another action than it decided.
    pub fn acted(&mut self, agent: u32, action: Action) -> Result<(), Fault> {
        let idx = self.check(agent)?;
        self.minds[idx].last.action = action.to_array();
        Ok(())
    }

    /// The progress of an agent.
    pub fn progress(&self, agent: u32) -> Result<abi::Progress, Fault> {
        let episode = self.minds[self.check(agent)?].episode.ok_or_else(|| no_goal(agent))?;
        Ok(abi::Progress {
            struct_size: 0,
            reached: (episode.end == Some(End::Reached)).into(),
            best_distance: episode.best_distance,
            stalled_decisions: episode.stalled_decisions,
            decisions: episode.decisions,
        })
    }

    /// Number of bytes of a saved agent.
    pub fn saved_len(&self) -> usize {
        SAVED_LEN + size_of::<f32>() * (self.policy.memory_len() + self.policy.observation_len())
    }

    /// Saves an agent into [`saved_len`](Self::saved_len) bytes.
    pub fn save(&self, agent: u32, bytes: &mut [u8]) -> Result<(), Fault> {
        let idx = self.check(agent)?;
        let (header, rows) = bytes.split_at_mut(SAVED_LEN);
        header.fill(0);
        postcard::to_slice(&self.minds[idx], header).expect("the state of an agent fits");
        let rows = rows.as_chunks_mut::<{ size_of::<f32>() }>().0.iter_mut();
        let (memory, observation) = self.rows(idx);
        let values = self.memories[memory].iter().chain(&self.observations[observation]);
        rows.zip(values).for_each(|(bytes, value)| *bytes = value.to_le_bytes());
        Ok(())
    }

    /// Restores an agent that [`save`](Self::save) saved, of a handle with the same policy.
    pub fn restore(&mut self, agent: u32, bytes: &[u8]) -> Result<(), Fault> {
        let idx = self.check(agent)?;
        let damaged = || Fault::file("these bytes are not an agent that sf_agents_save saved with this policy");
        let (header, rows) = bytes.split_at(SAVED_LEN);
        let mind: Mind = postcard::from_bytes(header).map_err(|_| damaged())?;
        let rows = rows.as_chunks::<{ size_of::<f32>() }>().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
        if !mind.is_sound() || !rows.clone().all(f32::is_finite) {
            return Err(damaged());
        }
        (self.minds[idx], self.prepared[idx]) = (mind, None);
        let (memory, observation) = self.rows(idx);
        let values = self.memories[memory].iter_mut().chain(&mut self.observations[observation]);
        values.zip(rows).for_each(|(to, value)| *to = value);
        Ok(())
    }

    /// Ranges of an agent's memory and observation.
    fn rows(&self, idx: usize) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let (memory, observation) = (self.policy.memory_len(), self.policy.observation_len());
        (idx * memory..(idx + 1) * memory, idx * observation..(idx + 1) * observation)
    }
}

impl Mind {
    fn is_sound(&self) -> bool {
        let is_sound = |episode: Episode| {
            episode.goal.is_finite()
                && episode.best_distance.is_finite()
                && episode.decisions <= MAX_COUNT
                && episode.stalled_decisions <= MAX_COUNT
        };
        self.episode.is_none_or(is_sound) && self.last.velocity.is_finite() && self.velocity.is_finite()
    }
}

fn no_goal(agent: u32) -> Fault {
    Fault::new(Status::BadState, format!("agent {agent} has no goal: call sf_agents_set_goal first"))
}

/// Surfaces and bodies hit by the rays of an agent.
type Hits = ([Option<(f32, Surface)>; RAY_COUNT], [f32; RAY_COUNT]);

/// Checks hits. Hits beyond the range of the rays are dropped.
fn read_hits(hits: &[abi::Hit]) -> Result<Hits, Fault> {
    let (mut found, mut bodies) = ([None; RAY_COUNT], [f32::INFINITY; RAY_COUNT]);
    for (idx, hit) in hits.iter().enumerate() {
        found[idx] = read_hit(idx, hit)?;
        if hit.body_distance != 0.0 {
            bodies[idx] = distance_of(idx, "body_distance", hit.body_distance)?;
        }
    }
    Ok((found, bodies))
}

/// Checks where a ray met a surface.
fn read_hit(idx: usize, hit: &abi::Hit) -> Result<Option<(f32, Surface)>, Fault> {
    let Some(surface) = checks::surface(hit.surface)? else { return Ok(None) };
    let distance = distance_of(idx, "distance", hit.distance)?;
    Ok((distance <= RAY_RANGE_M).then_some((distance, surface)))
}

fn distance_of(idx: usize, name: &str, distance: f32) -> Result<f32, Fault> {
    if distance >= 0.0 {
        return Ok(distance);
    }
    Err(Fault::argument(format!("hits[{idx}].{name} is {distance}: it must be 0 m or more")))
}
