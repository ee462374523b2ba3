//! Rehearsals: legs of plans that are run ahead of time, from the very states of the NPCs that are about to run them.
//!
//! Steps and noise are deterministic, so that a rehearsal foretells what its NPC will do as long as nothing else interferes. An NPC
//! that would come to harm or get stuck moves freely instead of composed, draws other noise, or takes another way.

use crate::decision::{DecisionLoop, Lane, Noise, Stage};
use crate::follow::{Follower, Step};
use crate::scene::Scene;
use crate::style::Style;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::collections::VecDeque;
use std::sync::Arc;
use surefoot_planner::LegKey;
use surefoot_policy::Policy;
use surefoot_policy::actor::gaussian;
use surefoot_world::character::{ACTION_LEN, Body};
use surefoot_world::sense::{RAY_CHANNELS, RAY_COUNT, SenseContext, state_vector};
use surefoot_world::{
    CharacterProfile, End, Episode, Map, MoverState, Npc, NpcSlot, OBSERVATION_LEN, TaskConfig, Vec3, World,
};

/// Legs that a rehearsal runs ahead: where the first one ends, the second must be possible.
const LEGS: usize = 2;
/// Most decisions of a rehearsal.
const MAX_DECISIONS: u32 = 160;
/// Decisions without coming closer after which a leg that is rehearsed has failed.
const STALLED_AFTER: u32 = 40;
/// Most decisions for which a body that has arrived is watched until it stands.
const MAX_REST_DECISIONS: u32 = 18;
/// Rehearsals of the same legs, with other noise each time, before another way is looked for.
const HARM_DRAWS: u32 = 3;
const STALL_DRAWS: u32 = 2;
/// Most rehearsals before one leg.
const MAX_REHEARSALS: u32 = 96;
/// Words of a random stream that one action takes: a block.
const WORDS_PER_ACTION: u128 = 16;
/// Distance between the numbers of the streams that an NPC changes to.
const NEXT_STREAM: u64 = 1 << 32;

/// The exploration noise of one NPC: a random stream of its own, so that a copy foretells it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseStream {
    share: f32,
    seed: u64,
    stream: u64,
    /// Actions drawn so far.
    drawn: u32,
}

impl NoiseStream {
    /// The stream of that number under a seed; `share` of the policy's exploration noise is 0 or more.
    pub fn new(share: f32, seed: u64, stream: u64) -> Self {
        Self { share, seed, stream, drawn: 0 }
    }

    /// Noise that is added to the next action of an NPC that moves in `style`, in units of the policy's standard deviation.
    pub fn draw(&mut self, style: Style) -> impl Iterator<Item = f32> + use<> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(self.stream);
        rng.set_word_pos(u128::from(self.drawn) * WORDS_PER_ACTION);
        self.drawn = self.drawn.wrapping_add(1);
        let share = self.share * style.noise_share();
        gaussian(&mut rng, ACTION_LEN).into_iter().map(move |value| value * share)
    }

    /// Goes on with other noise.
    pub fn change(&mut self) {
        self.stream = self.stream.wrapping_add(NEXT_STREAM);
    }
}

/// An NPC that is about to begin a leg of its plan.
#[derive(Debug)]
pub struct Actor {
    /// Its state.
    pub npc: Npc,
    /// Its plan and its leg.
    pub follower: Follower,
    /// Its row of the policy's hidden state.
    pub hidden: Vec<f32>,
    /// Its noise.
    pub noise: NoiseStream,
    /// How far it was rehearsed before; `None` to rehearse anew from its state.
    pub ghost: Option<Ghost>,
}

/// An NPC as it will be once it has run the legs that were rehearsed.
#[derive(Debug, Clone)]
pub struct Ghost {
    npc: Npc,
    follower: Follower,
    hidden: Vec<f32>,
    noise: NoiseStream,
    /// Bodies at the decisions on the way there, the next one first.
    ahead: VecDeque<Body>,
}

impl Ghost {
    /// Whether the next decision was rehearsed.
    pub fn is_ahead(&self) -> bool {
        !self.ahead.is_empty()
    }

    /// Where the NPC will be after each decision of the rehearsal that is still ahead, m.
    pub fn way(&self) -> impl Iterator<Item = Vec3> {
        self.ahead.iter().map(|body| body.feet)
    }

    /// Whether an NPC that has made one more decision did what was rehearsed, as far as it was.
    pub fn foretold(&mut self, body: &Body) -> bool {
        self.ahead.pop_front().is_some_and(|foretold| foretold == *body)
    }
}

/// What went wrong in a rehearsal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mishap {
    /// The leg.
    pub leg: LegKey,
    /// Whether the NPC came to harm; otherwise it made no progress.
    pub is_harm: bool,
}

/// What an NPC does after a mishap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resort {
    /// Rehearse the same legs once more, moving freely.
    Loosen,
    /// Rehearse the same legs once more, with other noise.
    Redraw,
    /// Take another way, without the leg of this mishap.
    Avoid(Mishap),
    /// Stop: no way is left.
    Stop,
}

/// What follows once a [`Resort`] was taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// The NPC rehearses the same legs again.
    Again,
    /// The NPC needs another plan, and rehearses that.
    Plan,
    /// The NPC waits until a mover opens a way.
    Wait,
    /// The attempt ends as unreachable.
    Stop,
}

impl Resort {
    /// Takes this resort, for the NPC with that plan and that noise.
    pub fn take(self, follower: &mut Follower, noise: &mut NoiseStream) -> Next {
        match self {
            Self::Loosen => Next::Again,
            Self::Redraw => {
                noise.change();
                Next::Again
            }
            Self::Avoid(Mishap { leg, is_harm }) if follower.avoid(leg, is_harm) == Step::Plan => Next::Plan,
            Self::Avoid(_) | Self::Stop if follower.waits_for_a_way() => Next::Wait,
            Self::Avoid(_) | Self::Stop => Next::Stop,
        }
    }
}

/// What the rehearsals before one leg have shown so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    of_plan: u32,
    in_all: u32,
}

impl Tally {
    /// Records a mishap of the NPC with that plan and returns what it does.
    pub fn note(&mut self, mishap: Mishap, follower: &mut Follower) -> Resort {
        if follower.loosen(mishap.leg) {
            return Resort::Loosen;
        }
        self.of_plan += 1;
        self.in_all += 1;
        let draws = if mishap.is_harm { HARM_DRAWS } else { STALL_DRAWS };
        if self.in_all >= MAX_REHEARSALS {
            Resort::Stop
        } else if self.of_plan < draws {
            Resort::Redraw
        } else {
            self.of_plan = 0;
            Resort::Avoid(mishap)
        }
    }
}

/// A world of its own on which rehearsals run.
#[derive(Debug)]
pub struct Rehearsal {
    worlds: [World; 1],
    decisions: DecisionLoop,
}

impl Rehearsal {
    /// Prepares rehearsals on `map` by the body `profile`.
    pub fn new(map: Arc<Map>, profile: CharacterProfile, task: TaskConfig, policy: &Policy) -> Self {
        Self { worlds: [World::new(map, profile, task)], decisions: DecisionLoop::new(policy) }
    }

    /// Rewrites what an observation of `npc` tells of its goal, for a new one, m.
    ///
    /// # Panics
    /// If `row` is shorter than an observation.
    pub fn aim(&self, npc: &Npc, goal: Vec3, row: &mut [f32]) {
        let [world] = &self.worlds;
        let placed = world.map().placed();
        let context = SenseContext { placed, profile: &world.config().profiles[0], task: world.task() };
        let episode = Episode::new(goal, npc.body.feet);
        row[RAY_COUNT * RAY_CHANNELS..OBSERVATION_LEN]
            .copy_from_slice(&state_vector(context, &npc.body, &episode, &npc.last));
    }

    /// The map.
    pub fn map(&self) -> &Arc<Map> {
        self.worlds[0].map()
    }

    /// Runs the next legs of each actor, while the map's movers begin with these states, and returns for each how it will be after them, or
    /// what went wrong.
    ///
    /// # Panics
    /// If the states do not fit the movers of the map.
    pub fn run(&mut self, policy: &Policy, actors: Vec<Actor>, movers: &[MoverState]) -> Vec<Result<Ghost, Mishap>> {
        let hidden_len = policy.memory_len();
        let mut hidden = Vec::with_capacity(actors.len() * hidden_len);
        let [world] = &mut self.worlds;
        world.clear();
        let has_movers = !movers.is_empty();
        if has_movers {
            world.set_movers(movers.to_vec());
        }
        let mut results: Vec<Option<Result<Ghost, Mishap>>> = Vec::new();
        results.resize_with(actors.len(), || None);
        let mut running: Vec<Running> = Vec::with_capacity(actors.len());
        for (idx, Actor { npc, follower, hidden: row, noise, ghost }) in actors.into_iter().enumerate() {
            let until = follower.leg_idx() + LEGS;
            // Movers are known as they are now, not as they are when a former rehearsal ends.
            let ghost = ghost.filter(|_| !has_movers).unwrap_or_else(|| {
                let follower = follower.rehearsing(STALLED_AFTER);
                Ghost { npc, follower, hidden: row, noise, ahead: VecDeque::new() }
            });
            let slot = world.adopt(ghost.npc);
            // An NPC that is under way keeps its episode, of which it is told how long it has lasted.
            let heads_for = ghost.npc.episode.filter(|episode| episode.end.is_none()).map(|episode| episode.goal);
            if let Some(waypoint) = ghost.follower.waypoint().filter(|waypoint| heads_for != Some(*waypoint)) {
                world.set_waypoint(slot, waypoint);
            }
            hidden.extend_from_slice(&ghost.hidden);
            running.push(Running { idx, slot, until, decisions: 0, ghost, arrival: None });
        }
        self.decisions.set_hidden(hidden);
        while !running.is_empty() {
            if has_movers {
                self.look(&mut running);
            }
            let deciding = || running.iter().filter(|it| it.arrival.is_none());
            let lanes: Vec<Lane> = deciding().map(|it| Lane::of(it.slot).in_style(it.ghost.follower.style())).collect();
            let closed = if lanes.is_empty() {
                self.worlds[0].tick_decision();
                Vec::new()
            } else {
                let deciding = running.iter_mut().filter(|it| it.arrival.is_none());
                let noise = deciding.zip(&lanes).flat_map(|(it, lane)| it.ghost.noise.draw(lane.style)).collect();
                let mut stage = Stage { worlds: &mut self.worlds, lanes: &lanes };
                self.decisions.decide(&mut stage, policy, Noise::Rows(noise)).to_vec()
            };
            let mut closed = closed.into_iter();
            let [world] = &mut self.worlds;
            let hidden = self.decisions.hidden();
            running.retain_mut(|it| {
                let result = if it.arrival.is_some() {
                    it.note_rest(world)
                } else {
                    it.note(world, closed.next().expect("an outcome for each lane").end)
                };
                let Some(result) = result else { return true };
                let npc = it.arrival.unwrap_or(*world.npc(it.slot).expect("a running NPC"));
                results[it.idx] = Some(result.map(|()| {
                    let row = it.slot.0 as usize * hidden_len;
                    Ghost { npc, hidden: hidden[row..row + hidden_len].to_vec(), ..it.ghost.clone() }
                }));
                world.despawn(it.slot);
                false
            });
        }
        results.into_iter().map(|result| result.expect("every rehearsal ends")).collect()
    }
}

impl Rehearsal {
    /// Lets all who decide next look at the movers, and call those that they want.
    fn look(&mut self, running: &mut [Running]) {
        let [world] = &mut self.worlds;
        for it in running.iter_mut().filter(|it| it.arrival.is_none()) {
            let body = world.npc(it.slot).expect("a running NPC").body;
            let scene = Scene { map: world.map(), states: world.movers() };
            let follower = &mut it.ghost.follower;
            // A plan that is barred meanwhile is given up by the NPC itself, in time.
            let plan = follower.clone();
            follower.look(scene, body.feet, body.is_grounded());
            if follower.waypoint().is_none() {
                *follower = plan;
            }
            if let Some(call) = follower.call() {
                world.call(call.mover, call.stop);
            }
        }
    }
}

/// One running rehearsal.
struct Running {
    idx: usize,
    slot: NpcSlot,
    /// The leg before which it ends.
    until: usize,
    decisions: u32,
    ghost: Ghost,
    /// How it arrived at the goal; since then it stands, or comes to a stop.
    arrival: Option<Npc>,
}

impl Running {
    /// Records a decision and returns how the rehearsal ended, if it did.
    fn note(&mut self, world: &mut World, end: Option<End>) -> Option<Result<(), Mishap>> {
        let body = world.npc(self.slot).expect("a running NPC").body;
        let follower = &mut self.ghost.follower;
        self.decisions += 1;
        self.ghost.ahead.push_back(body);
        let mishap = |is_harm, leg: Option<LegKey>| leg.map_or(Ok(()), |leg| Err(Mishap { leg, is_harm }));
        let leg = follower.leg_key();
        if end.is_some_and(End::is_harm) {
            return Some(mishap(true, leg));
        }
        let reached = end == Some(End::Reached);
        if self.decisions >= MAX_DECISIONS {
            return Some(Ok(()));
        }
        if reached && follower.is_last_leg() {
            self.arrival = world.npc(self.slot).copied();
            self.decisions = 0;
            world.clear_waypoint(self.slot);
            return None;
        }
        match follower.note(body.feet, reached) {
            Step::Head(waypoint) => world.set_waypoint(self.slot, waypoint),
            Step::Keep => {}
            Step::Plan | Step::GiveUp | Step::Unreachable => return Some(mishap(false, leg)),
        }
        (follower.leg_idx() >= self.until && body.is_grounded()).then_some(Ok(()))
    }

    /// Records what becomes of a body that has arrived, until it stands: one that arrives in flight may fall beyond its goal.
    fn note_rest(&mut self, world: &World) -> Option<Result<(), Mishap>> {
        let npc = world.npc(self.slot).expect("a running NPC");
        self.decisions += 1;
        if npc.harm.is_some() {
            let leg = self.ghost.follower.leg_key();
            return Some(leg.map_or(Ok(()), |leg| Err(Mishap { leg, is_harm: true })));
        }
        (npc.body.is_at_rest() || self.decisions >= MAX_REST_DECISIONS).then_some(Ok(()))
    }
}
