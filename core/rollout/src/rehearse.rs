//! Rehearsals: the next legs of plans, run ahead of time in a copy of the simulation.
//!
//! Steps and noise are deterministic. A rehearsal therefore forecasts what its NPC will do unless something else
//! interferes. [`Attempt::record_rehearsal`](crate::Attempt::record_rehearsal) says what follows a failure.

use crate::decision::{DecidingNpc, DecisionBatch, DecisionLoop, Noise};
use crate::follow::scene::Scene;
use crate::follow::{Follower, Step};
use crate::style::Style;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::sync::Arc;
use surefoot_planner::LegKey;
use surefoot_policy::{Policy, noise};
use surefoot_world::character::Body;
use surefoot_world::sense::{RAY_CHANNELS, RAY_COUNT, SenseContext, state_vector};
use surefoot_world::{
    Ability, Action, CharacterProfile, End, Episode, Map, MoverState, Npc, NpcSlot, OBSERVATION_LEN, POSE_TICKS, Pose,
    TICKS_PER_DECISION, TakeOff, TaskConfig, Trajectory, Vec3, World,
};

/// Legs that a rehearsal runs: where the first one ends, the second must be possible.
const LEGS: usize = 2;
/// Most decisions of a rehearsal.
const MAX_DECISIONS: u32 = 160;
/// Decisions without coming closer after which a rehearsed leg has failed.
const STALLED_AFTER: u32 = 40;
/// Most decisions until a body that has arrived must stand.
const MAX_REST_DECISIONS: u32 = 18;
/// Distance between the numbers of an NPC's streams.
const NEXT_STREAM: u64 = 1 << 32;

/// The exploration noise of one NPC: a random stream of its own, which a rehearsal copies.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct NoiseStream {
    share: f32,
    seed: u64,
    stream: u64,
    /// Actions drawn so far.
    drawn: u32,
}

impl NoiseStream {
    /// Stream number `stream` under `seed`, with this share of the policy's exploration noise, 0 or more.
    pub fn new(share: f32, seed: u64, stream: u64) -> Self {
        Self { share, seed, stream, drawn: 0 }
    }

    /// The same stream with another share of the noise, 0 or more.
    #[must_use]
    pub fn with_share(self, share: f32) -> Self {
        Self { share, ..self }
    }

    /// Noise for the next action of an NPC that moves in `style`, in units of the policy's standard deviation.
    pub fn draw(&mut self, style: Style) -> impl Iterator<Item = f32> + use<> {
        let share = self.share * style.noise_share();
        let values = noise::of_action((self.seed, self.stream), self.drawn.into(), share);
        self.drawn = self.drawn.wrapping_add(1);
        values.into_iter()
    }

    /// Continues with other noise.
    pub fn change(&mut self) {
        self.stream = self.stream.wrapping_add(NEXT_STREAM);
    }
}

/// Where a rehearsal starts.
#[derive(Debug)]
pub struct RehearsalStart {
    /// State of the NPC.
    pub npc: Npc,
    /// Its plan and its leg.
    pub follower: Follower,
    /// Its row of the policy's hidden state.
    pub hidden: Vec<f32>,
    /// Its noise.
    pub noise: NoiseStream,
    /// Where the last rehearsal ended, to continue from there; `None` to start from the NPC's state.
    pub forecast: Option<Forecast>,
}

/// An NPC as it will be after the rehearsed legs.
#[derive(Debug, Clone)]
pub struct Forecast {
    npc: Npc,
    follower: Follower,
    hidden: Vec<f32>,
    noise: NoiseStream,
    /// Bodies after each decision ahead, the next one first.
    ahead: VecDeque<Body>,
    /// Bodies after the decision in which the body arrives and those in which it comes to rest, where an attempt ends
    /// at the tick of its arrival.
    rest: Vec<Body>,
    /// Bodies at the end of `ahead` from the arrival on.
    beyond: usize,
}

impl Forecast {
    /// Whether the next decision was rehearsed.
    pub fn is_ahead(&self) -> bool {
        !self.ahead.is_empty()
    }

    /// Where the NPC will be after each decision ahead, m.
    pub fn way(&self) -> impl Iterator<Item = Vec3> {
        self.ahead.iter().map(|body| body.feet)
    }

    /// What an NPC with this `body` will do in the next second. `ability` is that of its next leap or ride;
    /// [`Ability::WALK`] if there is none.
    pub fn trajectory(&self, body: &Body, ability: Ability) -> Trajectory {
        let stands = self.rest.last().filter(|body| body.is_at_rest());
        let until = self.ahead.len().saturating_sub(self.beyond);
        let pose = |ticks: u32| {
            let mut bodies = self.ahead.iter().take(until).chain(&self.rest);
            bodies.nth((ticks / TICKS_PER_DECISION) as usize - 1).or(stands).map(Pose::from)
        };
        Trajectory { poses: POSE_TICKS.map(pose), take_off: self.take_off(body, ability) }
    }

    /// When a body leaves the ground next by `ability`.
    fn take_off(&self, body: &Body, ability: Ability) -> Option<TakeOff> {
        let leaves = |(before, after): (&Body, &Body)| {
            before.is_grounded() && !after.is_grounded() && (after.velocity.y > 0.0 || after.is_carried())
        };
        let decisions = std::iter::once(body).chain(&self.ahead).zip(&self.ahead);
        let mut starts = decisions.zip((0..POSE_TICKS[2]).step_by(TICKS_PER_DECISION as usize));
        let (_, ticks) = starts.find(|(bodies, _)| ability != Ability::WALK && leaves(*bodies))?;
        Some(TakeOff { ticks: ticks as u8, ability })
    }

    /// Whether the body after one more decision is the rehearsed one, or with its feet at most `slack_m` away if that
    /// is above 0; false if that decision was not rehearsed.
    pub fn matches(&mut self, body: &Body, slack_m: f32) -> bool {
        let is_near = |rehearsed: Body| slack_m > 0.0 && rehearsed.feet.distance(body.feet) <= slack_m;
        self.ahead.pop_front().is_some_and(|rehearsed| rehearsed == *body || is_near(rehearsed))
    }

    /// Skips the next decisions.
    pub fn skip(&mut self, decisions: u32) {
        self.ahead.drain(..self.ahead.len().min(decisions as usize));
    }
}

/// How a rehearsal failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RehearsalFailure {
    /// The leg.
    pub leg: LegKey,
    /// Whether the NPC came to harm; otherwise it made no progress.
    pub is_harm: bool,
}

/// A copy of the simulation in which rehearsals run.
#[derive(Debug)]
pub struct Rehearsal {
    worlds: [World; 1],
    decisions: DecisionLoop,
    /// Where NPCs that have arrived come to rest.
    rest: World,
}

impl Rehearsal {
    /// Prepares rehearsals on `map` by the body `profile`.
    pub fn new(map: Arc<Map>, profile: CharacterProfile, task: TaskConfig, policy: &Policy) -> Self {
        let rest = World::new(map.clone(), profile.clone(), task.clone());
        Self { worlds: [World::new(map, profile, task)], decisions: DecisionLoop::new(policy), rest }
    }

    /// Rewrites the part of an observation of `npc` that depends on its waypoint, for a new waypoint, m.
    ///
    /// # Panics
    /// If `row` is shorter than an observation.
    pub fn aim_at(&self, npc: &Npc, goal: Vec3, row: &mut [f32]) {
        let [world] = &self.worlds;
        let placed = world.map().placed();
        let context = SenseContext { placed, profile: &world.config().profiles[0], task: world.task() };
        let episode = Episode::new(goal, npc.body.feet);
        row[RAY_COUNT * RAY_CHANNELS..OBSERVATION_LEN]
            .copy_from_slice(&state_vector(context, &npc.body, &episode, &npc.last));
    }

    /// Observes NPCs in these states among movers in these states: one row of [`OBSERVATION_LEN`] values for each.
    ///
    /// # Panics
    /// If the states do not fit the movers of the map.
    pub fn observe(&mut self, npcs: &[Npc], movers: &[MoverState]) -> Vec<f32> {
        let [world] = &mut self.worlds;
        world.clear();
        if !movers.is_empty() {
            world.set_movers(movers.to_vec());
        }
        let mut rows = vec![0.0; npcs.len() * OBSERVATION_LEN];
        for (npc, row) in npcs.iter().zip(rows.chunks_exact_mut(OBSERVATION_LEN)) {
            let slot = world.adopt(*npc);
            world.observe(slot, row);
        }
        rows
    }

    /// The map.
    pub fn map(&self) -> &Arc<Map> {
        self.worlds[0].map()
    }

    /// Runs the next legs of each NPC, with the map's movers in these states at first. Returns for each NPC how it will
    /// be after them, or how it failed.
    ///
    /// # Panics
    /// If the states do not fit the movers of the map.
    pub fn run(
        &mut self,
        policy: &Policy,
        starts: Vec<RehearsalStart>,
        movers: &[MoverState],
    ) -> Vec<Result<Forecast, RehearsalFailure>> {
        let mut results: Vec<Option<Result<Forecast, RehearsalFailure>>> = Vec::new();
        results.resize_with(starts.len(), || None);
        let mut running = self.begin(starts, movers);
        while !running.is_empty() {
            if !movers.is_empty() {
                self.watch_movers(&mut running);
            }
            let ends = self.decide(policy, &mut running);
            let [world] = &mut self.worlds;
            let hidden = self.decisions.hidden();
            let mut ends = ends.into_iter();
            running.retain_mut(|run| {
                let result = if run.arrival.is_some() {
                    run.record_rest(world)
                } else {
                    run.record_decision(world, ends.next().expect("an outcome for each NPC that decides"))
                };
                let Some(result) = result else { return true };
                let npc = run.arrival.unwrap_or(*world.npc(run.slot).expect("a running NPC"));
                results[run.idx] = Some(result.map(|()| {
                    let hidden_len = policy.memory_len();
                    let row = run.slot.0 as usize * hidden_len;
                    Forecast { npc, hidden: hidden[row..row + hidden_len].to_vec(), ..run.forecast.clone() }
                }));
                world.despawn(run.slot);
                false
            });
            self.stop_those_there(&mut running);
        }
        results.into_iter().map(|result| result.expect("every rehearsal ends")).collect()
    }

    /// Puts the NPCs into the world.
    fn begin(&mut self, starts: Vec<RehearsalStart>, movers: &[MoverState]) -> Vec<Running> {
        let [world] = &mut self.worlds;
        world.clear();
        if !movers.is_empty() {
            world.set_movers(movers.to_vec());
        }
        let mut all_hidden = Vec::new();
        let mut running = Vec::with_capacity(starts.len());
        for (idx, RehearsalStart { npc, follower, hidden, noise, forecast }) in starts.into_iter().enumerate() {
            let until = follower.leg_after(LEGS);
            // The states of movers are those of now, not those at the end of the last rehearsal.
            let forecast = forecast.filter(|_| movers.is_empty()).unwrap_or_else(|| {
                let follower = follower.rehearsing(STALLED_AFTER);
                let (ahead, rest) = Default::default();
                Forecast { npc, follower, hidden, noise, ahead, rest, beyond: 0 }
            });
            let slot = world.adopt(forecast.npc);
            // A running NPC keeps its episode, because the observation contains the patience used.
            let episode = forecast.npc.episode.filter(|episode| episode.end.is_none());
            let heads_for = episode.map(|episode| (episode.goal, episode.arrival));
            let way = forecast.follower.waypoint().map(|waypoint| (waypoint, forecast.follower.arrival()));
            if let Some((waypoint, arrival)) = way.filter(|way| heads_for != Some(*way)) {
                world.head_for(slot, waypoint, arrival);
            }
            all_hidden.extend_from_slice(&forecast.hidden);
            let before = forecast.npc;
            running.push(Running { idx, slot, until, decisions: 0, forecast, before, arrival: None });
        }
        self.decisions.set_hidden(all_hidden);
        running
    }

    /// Runs one decision of all NPCs that have not arrived, and returns the ends of their ways, in order.
    fn decide(&mut self, policy: &Policy, running: &mut [Running]) -> Vec<Option<End>> {
        let deciding = || running.iter().filter(|run| run.arrival.is_none());
        let npcs: Vec<DecidingNpc> =
            deciding().map(|run| DecidingNpc::of(run.slot).in_style(run.forecast.follower.style())).collect();
        for run in running.iter_mut().filter(|run| run.arrival.is_none()) {
            run.before = *self.worlds[0].npc(run.slot).expect("a running NPC");
        }
        if npcs.is_empty() {
            self.worlds[0].tick_decision();
            return Vec::new();
        }
        let deciding = running.iter_mut().filter(|run| run.arrival.is_none());
        let noise = deciding.zip(&npcs).flat_map(|(run, npc)| run.forecast.noise.draw(npc.style)).collect();
        let mut batch = DecisionBatch { worlds: &mut self.worlds, npcs: &npcs };
        let outcomes = self.decisions.decide(&mut batch, policy, Noise::Rows(noise));
        outcomes.iter().map(|outcome| outcome.end).collect()
    }

    /// Forecasts how NPCs that have just arrived come to rest.
    fn stop_those_there(&mut self, running: &mut [Running]) {
        for run in running.iter_mut().filter(|run| run.forecast.rest.is_empty()) {
            if let Some(arrival) = run.arrival {
                run.forecast.rest = self.come_to_rest(run.before, arrival.action);
                run.forecast.beyond = 1;
            }
        }
    }

    /// The body of `npc` after the decision in which it arrives by `action`, and after those in which it comes to rest.
    fn come_to_rest(&mut self, npc: Npc, action: Action) -> Vec<Body> {
        let Self { worlds: [world], rest, .. } = self;
        rest.clear();
        if !world.movers().is_empty() {
            rest.set_movers(world.movers().to_vec());
        }
        let slot = rest.adopt(npc);
        rest.decide(slot, action);
        let mut bodies: Vec<Body> = Vec::new();
        while bodies.len() < MAX_REST_DECISIONS as usize && !bodies.last().is_some_and(Body::is_at_rest) {
            for _ in 0..TICKS_PER_DECISION {
                rest.tick();
                let end = rest.npc(slot).and_then(|npc| npc.episode?.end);
                if end == Some(End::Reached) {
                    rest.clear_waypoint(slot);
                }
            }
            bodies.extend(rest.npc(slot).map(|npc| npc.body));
        }
        bodies
    }

    /// Lets all NPCs that decide next watch the movers, and call those that they need.
    fn watch_movers(&mut self, running: &mut [Running]) {
        let [world] = &mut self.worlds;
        for run in running.iter_mut().filter(|run| run.arrival.is_none()) {
            let body = world.npc(run.slot).expect("a running NPC").body;
            let scene = Scene { map: world.map(), states: world.movers() };
            let follower = &mut run.forecast.follower;
            // If movers bar the plan, the NPC itself drops it, in time.
            let plan = follower.clone();
            follower.watch_movers(scene, body.feet, body.is_grounded());
            if follower.waypoint().is_none() {
                *follower = plan;
            }
            if let Some(call) = follower.call() {
                world.call(call);
            }
        }
    }
}

/// One running rehearsal.
struct Running {
    idx: usize,
    slot: NpcSlot,
    /// The leg before which the rehearsal ends.
    until: usize,
    decisions: u32,
    forecast: Forecast,
    /// The NPC before its last decision.
    before: Npc,
    /// The NPC when it arrived at the goal; it comes to rest from then on.
    arrival: Option<Npc>,
}

impl Running {
    /// Records a decision and returns how the rehearsal ended, if it did.
    fn record_decision(&mut self, world: &mut World, end: Option<End>) -> Option<Result<(), RehearsalFailure>> {
        let body = world.npc(self.slot).expect("a running NPC").body;
        let follower = &mut self.forecast.follower;
        self.decisions += 1;
        self.forecast.ahead.push_back(body);
        self.forecast.beyond += usize::from(!self.forecast.rest.is_empty());
        let leg = follower.leg_key();
        if end.is_some_and(End::is_harm) {
            return Some(failed(leg, true));
        }
        if self.decisions >= MAX_DECISIONS {
            return Some(Ok(()));
        }
        if end == Some(End::Reached) && follower.is_last_leg() {
            self.arrival = world.npc(self.slot).copied();
            self.decisions = 0;
            world.clear_waypoint(self.slot);
            return None;
        }
        match follower.record_decision(body.feet, end) {
            Step::HeadFor(waypoint) => world.head_for(self.slot, waypoint, follower.arrival()),
            Step::Keep => {}
            Step::Plan | Step::End(_) => return Some(failed(leg, false)),
        }
        (follower.leg_idx() >= self.until && body.is_grounded()).then_some(Ok(()))
    }

    /// Records a decision of a body that has arrived, until it stands: a body that arrives in flight may fall beyond
    /// its goal.
    fn record_rest(&mut self, world: &World) -> Option<Result<(), RehearsalFailure>> {
        let npc = world.npc(self.slot).expect("a running NPC");
        self.decisions += 1;
        if npc.harm.is_some() {
            return Some(failed(self.forecast.follower.leg_key(), true));
        }
        (npc.body.is_at_rest() || self.decisions >= MAX_REST_DECISIONS).then_some(Ok(()))
    }
}

/// The failure on a leg; without a plan there is no leg to avoid.
fn failed(leg: Option<LegKey>, is_harm: bool) -> Result<(), RehearsalFailure> {
    leg.map_or(Ok(()), |leg| Err(RehearsalFailure { leg, is_harm }))
}
