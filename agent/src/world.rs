//! A worker's NPCs of one world: plans, waypoints and decisions.

mod rehearse;

use super::ahead::{Arrival, Maps};
use super::graph::{Graph, revision_from_wire};
use super::inference::{Decided, Inference, Rows};
use prost::Message;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};
use surefoot_planner::evidence::TryEnd;
use surefoot_planner::live::Traversal;
use surefoot_planner::{Plan, Traffic};
use surefoot_policy::Policy;
use surefoot_proto::convert;
use surefoot_proto::planner::v1 as planner;
use surefoot_proto::plans::{self, npc_plan_to_wire, query_to_wire, traffic_to_wire, traversal_to_wire};
use surefoot_proto::world::v1 as wire;
use surefoot_rollout::Style;
use surefoot_rollout::follow::{FollowConfig, Follower, Step};
use surefoot_rollout::rehearse::{Ghost, NoiseStream, Rehearsal};
use surefoot_rollout::scene::{Call, Scene};
use surefoot_world::{Action, CharacterProfile, MoverState, Vec3};
use tokio::sync::{mpsc, watch};
use tonic::Code;
use tracing::warn;

/// Ticks after which traffic is counted again.
const TRAFFIC_TICKS: u64 = 30;
/// Most batches of plans waiting to be applied; when full, further ones wait.
const PLAN_QUEUE: usize = 256;
/// Number of traversals that are reported together; a failed one is reported at once.
const REPORT_LEN: usize = 64;
/// Most queries in one batch; planners allow more.
const MAX_QUERIES: usize = 1024;
/// Longest wait of a lockstep world for the graph of its map, and for a sign of life of the planner that builds it. After that its
/// NPCs go on without plans until there is a graph.
const GRAPH_LIMIT: Duration = Duration::from_secs(120);
const PLANNER_SILENCE: Duration = Duration::from_secs(15);
/// Largest answer in one message, bytes; servers accept 1 MiB unless configured.
const MAX_ANSWER_BYTES: usize = 512 * 1024;
/// Longest wait for a batch of plans.
const PLAN_LIMIT: Duration = Duration::from_secs(5);
/// Longest wait of a realtime world for plans after a mishap in a rehearsal.
const RESORT_LIMIT: Duration = Duration::from_millis(40);

/// Bytes of a field's tag and length, at most.
const FIELD_BYTES: usize = 6;

/// Why a world's task cannot go on.
#[derive(Debug, thiserror::Error)]
pub(super) enum WorldError {
    /// The server sent a batch of another shape.
    #[error("the server sent a malformed batch")]
    Malformed,
    /// Evaluating the policy panicked.
    #[error("the policy failed: {0}")]
    Policy(#[from] tokio::task::JoinError),
    /// Evaluating the policy for several worlds panicked.
    #[error("the policy failed for several worlds at once")]
    Inference,
}

/// Messages to a world's task.
pub(super) enum WorldMessage {
    Release(Vec<u64>),
    Ended(wire::AttemptsEnded),
    Observations(wire::ObservationBatch),
    /// The map has other pieces from now on: the map, and its graph.
    Edited {
        map: Option<watch::Receiver<Arrival>>,
        graph: Option<Arc<Graph>>,
    },
}

/// The graph of an edited map.
enum NextGraph {
    /// Nothing is awaited.
    None,
    /// NPCs plan on the graph of the map as it was until there is this one.
    Awaited(Arc<Graph>),
    /// They plan on what is sure to remain of it until what the edit affects was probed.
    Interim,
}

/// An NPC that this worker decides for.
struct Npc {
    attempt: u32,
    follower: Follower,
    /// Whether a plan is requested and not yet received.
    is_planning: bool,
    /// Revision of designers' edits that its plan was made with.
    revision: Option<u64>,
    /// The latest revision for which it dropped its plan.
    replanned_for: Option<u64>,
    /// A waypoint that has not been sent to the server yet.
    new_waypoint: Option<Vec3>,
    /// A plan that has not been sent to the server yet.
    new_plan: Option<wire::NpcPlan>,
    /// The policy's memory row for the attempt.
    memory: Vec<f32>,
    noise: NoiseStream,
    /// Whether what lies ahead is still to be rehearsed, and for how many decisions it has waited for its turn.
    rehearses_next: bool,
    waited: u32,
    ghost: Option<Ghost>,
    /// Decisions since it lacks a plan.
    unplanned: u32,
    /// Decision without a plan at which it tries, in a rehearsal, to head straight for its goal.
    next_try: u32,
    /// Whether it stands still until it has a plan.
    holds: bool,
    /// Whether its plan is of the map as it was before an edit.
    is_outdated: bool,
    /// Where it was at its last decision, m.
    feet: Vec3,
}

/// State of an NPC's body and episode, from the server.
type State = surefoot_world::Npc;

/// A received batch of plans.
struct PlanBatch {
    /// NPC id, attempt and plan; `None` if the planner failed.
    plans: Vec<(u64, u32, Option<Plan>)>,
    /// Revision of designers' edits that the plans were made with.
    revision: Option<u64>,
}

/// How a worker's NPCs move.
#[derive(Debug, Clone, Copy)]
pub(super) struct Manner {
    /// Share of the policy's exploration noise.
    pub noise_share: f32,
    /// Whether they compose themselves where rehearsals show that they arrive so.
    pub composes: bool,
}

/// What a world's NPCs rehearse on.
pub(super) struct Stage {
    /// The maps, whose pace all realtime worlds share.
    pub maps: Arc<Maps>,
    /// The world's map.
    pub map: watch::Receiver<Arrival>,
    /// When the map was asked for.
    pub awaited_since: Instant,
    /// The body of the NPCs.
    pub body: CharacterProfile,
}

/// The task for the NPCs of one world that have one body and that this worker decides for.
pub(super) struct WorldTask {
    world_id: u64,
    /// Seed of the exploration noise: equal for worlds on equal maps, so that lockstep worlds repeat themselves.
    seed: u64,
    is_lockstep: bool,
    /// Where its NPCs are about to be, and when that was counted; `None` if plans go around nobody: in lockstep what an NPC does must not
    /// depend on which worker has the others.
    traffic: Option<(u64, planner::Traffic)>,
    /// Tick of the latest batch.
    tick: u64,
    policy: Policy,
    /// What realtime worlds decide with.
    inference: Inference,
    manner: Manner,
    graph: Option<Arc<Graph>>,
    next_graph: NextGraph,
    stage: Option<Stage>,
    /// Made once the map is there.
    rehearsal: Option<Rehearsal>,
    /// Whether a lockstep world has waited for the graph, in vain.
    has_waited: bool,
    /// Plans that failed since the last answer.
    plans_failed: u32,
    npcs: BTreeMap<u64, Npc>,
    planned: mpsc::Sender<PlanBatch>,
    plans: mpsc::Receiver<PlanBatch>,
    /// Traversals that have not been reported to the planner yet.
    traversals: Vec<Traversal>,
    out: mpsc::Sender<wire::WorkRequest>,
}

impl WorldTask {
    /// Creates a task for the NPCs of an assignment. Answers go to `out`.
    pub fn new(
        assignment: &wire::Assignment,
        (policy, inference): (Policy, Inference),
        manner: Manner,
        graph: Option<Arc<Graph>>,
        stage: Option<Stage>,
        out: mpsc::Sender<wire::WorkRequest>,
    ) -> Self {
        let (planned, plans) = mpsc::channel(PLAN_QUEUE);
        Self {
            world_id: assignment.world_id,
            seed: seed_of(&assignment.map_hash),
            is_lockstep: assignment.mode() == wire::TimeMode::Lockstep,
            traffic: (assignment.solid_npcs && assignment.mode() == wire::TimeMode::Realtime).then(Default::default),
            tick: 0,
            policy,
            inference,
            manner,
            graph,
            next_graph: NextGraph::None,
            stage,
            rehearsal: None,
            has_waited: false,
            plans_failed: 0,
            npcs: BTreeMap::new(),
            planned,
            plans,
            traversals: Vec::new(),
            out,
        }
    }

    /// Handles messages until the channel closes, or the session ends.
    pub async fn run(mut self, mut messages: mpsc::Receiver<WorldMessage>) -> Result<(), WorldError> {
        while let Some(message) = messages.recv().await {
            match message {
                WorldMessage::Release(npc_ids) => {
                    for id in npc_ids {
                        self.npcs.remove(&id);
                    }
                }
                WorldMessage::Ended(ended) => self.note_ends(&ended),
                WorldMessage::Edited { map, graph } => self.follow_edit(map, graph),
                WorldMessage::Observations(batch) => {
                    for answer in split(self.decide(batch).await?, MAX_ANSWER_BYTES) {
                        let request = wire::WorkRequest { message: Some(wire::work_request::Message::Actions(answer)) };
                        if self.out.send(request).await.is_err() {
                            return Ok(());
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// Answers one batch.
    async fn decide(&mut self, batch: wire::ObservationBatch) -> Result<wire::ActionBatch, WorldError> {
        let count = batch.npc_ids.len();
        let vectors = |bytes: &[u8], field| convert::unpack(bytes, count * 3, field);
        let (mut observations, positions, goals) = match (
            convert::unpack(&batch.observations, count * self.policy.observation_len(), "observations"),
            vectors(&batch.positions, "positions"),
            vectors(&batch.goals, "goals"),
        ) {
            (Ok(observations), Ok(positions), Ok(goals)) => (observations, positions, goals),
            _ => return Err(WorldError::Malformed),
        };
        let at = |values: &[f32], idx: usize| Vec3::new(values[3 * idx], values[3 * idx + 1], values[3 * idx + 2]);
        self.apply_received();
        self.take_next_graph();
        self.tick = batch.tick;
        let movers = self.movers(&batch.movers);
        let mut calls = BTreeSet::new();
        let mut attempts = Vec::with_capacity(count);
        let mut gave_up = Vec::new();
        let mut queries = Vec::new();
        for (idx, &id) in batch.npc_ids.iter().enumerate() {
            let (feet, goal) = (at(&positions, idx), at(&goals, idx));
            let attempt = batch.attempts.get(idx).copied().unwrap_or(0);
            let touched = batch.waypoint_reached.get(idx).copied().unwrap_or(false);
            let grounded = batch.grounded.get(idx).copied().unwrap_or(true);
            self.meet(id, attempt, goal, (batch.tick, idx));
            self.npc(id).feet = feet;
            calls.extend(self.look(id, &movers, feet, grounded));
            match self.note(id, feet, touched, grounded) {
                Step::Keep if self.is_outdated(id) => queries.push((id, attempt, feet)),
                Step::Keep => {}
                Step::Head(waypoint) => {
                    let npc = self.npc(id);
                    npc.new_waypoint = Some(waypoint);
                    npc.rehearses_next = true;
                }
                Step::Plan => queries.push((id, attempt, feet)),
                Step::GiveUp => gave_up.push(wire::GivenUp { npc_id: id, attempt, unreachable: false }),
                Step::Unreachable => gave_up.push(wire::GivenUp { npc_id: id, attempt, unreachable: true }),
            }
            attempts.push(attempt);
        }
        self.report();
        for queries in queries.chunks(MAX_QUERIES) {
            self.request_plans(queries.to_vec(), false).await;
        }
        let states = self.states(&batch.npc_ids, &batch.states, batch.state_version).await;
        let mut no_way = Vec::new();
        self.rehearse(&states, &movers, &mut no_way).await?;
        let no_way = no_way.into_iter();
        gave_up.extend(no_way.map(|(npc_id, attempt)| wire::GivenUp { npc_id, attempt, unreachable: true }));
        if self.awaits_map() {
            for (idx, &id) in batch.npc_ids.iter().enumerate() {
                self.npc(id).holds = batch.grounded.get(idx).copied().unwrap_or(true);
            }
        } else {
            self.rehearse_straight(&states, &movers, &batch.npc_ids).await?;
        }
        self.aim(&states, &batch.npc_ids, &mut observations);
        let waypoints = batch.npc_ids.iter().filter_map(|&id| {
            let npc = self.npcs.get_mut(&id)?;
            let position = Some(convert::to_wire(npc.new_waypoint.take()?));
            Some(wire::Waypoint { npc_id: id, position, attempt: npc.attempt })
        });
        let waypoints = waypoints.collect();
        let plans = batch.npc_ids.iter().filter_map(|&id| {
            let npc = self.npcs.get_mut(&id)?;
            let plan = Some(npc.new_plan.take()?);
            Some(wire::CarriedPlan { npc_id: id, plan, attempt: npc.attempt })
        });
        let plans = plans.collect();
        let actions = self.act(&batch.npc_ids, &states, observations).await?;
        Ok(wire::ActionBatch {
            world_id: self.world_id,
            tick: batch.tick,
            npc_ids: batch.npc_ids,
            actions,
            waypoints,
            gave_up,
            plans,
            attempts,
            plans_failed: std::mem::take(&mut self.plans_failed),
            mover_calls: calls
                .into_iter()
                .map(|call| wire::MoverCall { mover: call.mover.into(), stop: call.stop.into() })
                .collect(),
        })
    }

    fn npc(&mut self, id: u64) -> &mut Npc {
        self.npcs.get_mut(&id).expect("noted in this batch")
    }

    /// Makes the NPC known; a new attempt begins anew.
    fn meet(&mut self, id: u64, attempt: u32, goal: Vec3, (tick, idx): (u64, usize)) {
        let memory_len = self.policy.memory_len();
        let follow = FollowConfig { composes: self.manner.composes, ..FollowConfig::default() };
        let begin = || Npc {
            attempt,
            follower: Follower::new(goal, follow),
            is_planning: false,
            revision: None,
            replanned_for: None,
            new_waypoint: None,
            new_plan: None,
            memory: vec![0.0; memory_len],
            // Worlds that repeat themselves in lockstep repeat their noise, whatever the ids of their NPCs are.
            noise: NoiseStream::new(self.manner.noise_share, self.seed, tick << 16 | idx as u64 & 0xffff),
            rehearses_next: false,
            waited: 0,
            ghost: None,
            unplanned: 0,
            next_try: 0,
            holds: false,
            is_outdated: false,
            feet: Vec3::ZERO,
        };
        let npc = self.npcs.entry(id).or_insert_with(begin);
        if npc.attempt != attempt {
            *npc = begin();
        }
    }

    /// The map has other pieces from now on: NPCs rehearse anew, on that map, and plan anew once there is its graph.
    fn follow_edit(&mut self, map: Option<watch::Receiver<Arrival>>, graph: Option<Arc<Graph>>) {
        if let Some((stage, map)) = self.stage.as_mut().zip(map) {
            (stage.map, stage.awaited_since) = (map, Instant::now());
            self.rehearsal = None;
        }
        for npc in self.npcs.values_mut() {
            (npc.ghost, npc.rehearses_next) = (None, true);
        }
        match graph {
            Some(graph) if self.is_lockstep => {
                (self.graph, self.has_waited) = (Some(graph), false);
                self.npcs.values_mut().for_each(|npc| npc.is_outdated = true);
            }
            Some(graph) => self.next_graph = NextGraph::Awaited(graph),
            None => {}
        }
    }

    /// Goes over to the graph of an edited map as soon as plans can be made on it, and once more when it is complete.
    fn take_next_graph(&mut self) {
        let takes_interim = self.takes_interim();
        let is_ready = |graph: &Graph| !graph.id_for_plans(takes_interim).is_empty();
        let is_complete = |graph: &Graph| !graph.id.borrow().is_empty();
        let next = match std::mem::replace(&mut self.next_graph, NextGraph::None) {
            NextGraph::Awaited(graph) if is_ready(&graph) => {
                let next = if is_complete(&graph) { NextGraph::None } else { NextGraph::Interim };
                self.graph = Some(graph);
                next
            }
            NextGraph::Interim if self.graph.as_deref().is_some_and(is_complete) => NextGraph::None,
            same => {
                self.next_graph = same;
                return;
            }
        };
        self.next_graph = next;
        self.npcs.values_mut().for_each(|npc| npc.is_outdated = true);
    }

    /// Whether an NPC wants another plan because its own is of the map before an edit. It goes on along that one meanwhile.
    fn is_outdated(&self, id: u64) -> bool {
        self.graph.is_some() && self.npcs.get(&id).is_some_and(|npc| npc.is_outdated && !npc.is_planning)
    }

    /// Lets an NPC look at the movers of its world, and returns the one that it calls.
    fn look(&mut self, id: u64, movers: &[MoverState], feet: Vec3, grounded: bool) -> Option<Call> {
        let map = self.rehearsal.as_ref().filter(|_| !movers.is_empty())?.map().clone();
        let npc = self.npc(id);
        npc.follower.look(Scene { map: &map, states: movers }, feet, grounded);
        npc.follower.call()
    }

    /// The states of the movers of a batch; none if there are none, or it is not known yet where they are.
    fn movers(&self, bytes: &[u8]) -> Vec<MoverState> {
        self.rehearsal.as_ref().and_then(|it| MoverState::unpack(bytes, it.map())).unwrap_or_default()
    }

    /// Updates an NPC's follower with its position and returns the follower's step.
    fn note(&mut self, id: u64, feet: Vec3, touched: bool, grounded: bool) -> Step {
        let (has_planner, stands) = (self.graph.is_some(), grounded && self.awaits_map());
        let latest = self.graph.as_ref().and_then(|graph| *graph.revision.borrow());
        let npc = self.npcs.get_mut(&id).expect("met in this batch");
        if !has_planner || npc.is_planning || stands {
            // The server itself ends attempts that make no progress.
            return Step::Keep;
        }
        // An NPC in the air cannot turn back.
        let is_outdated = npc.revision.zip(latest).is_some_and(|(revision, latest)| revision != latest);
        if grounded && is_outdated && npc.replanned_for != latest {
            npc.replanned_for = latest;
            npc.follower.forget_plan();
        }
        let step = npc.follower.note(feet, touched);
        self.traversals.extend(npc.follower.take_traversals());
        step
    }

    /// Whether NPCs plan on a graph that is still being built. Not in lockstep: what such a world does must not depend on how far a build has
    /// come. And not before they can rehearse, since nobody has tried all of its edges.
    fn takes_interim(&self) -> bool {
        !self.is_lockstep && (self.stage.is_none() || self.rehearsal.is_some())
    }

    /// Records attempts that ended: harm on an edge counts as a failed traversal of it.
    fn note_ends(&mut self, ended: &wire::AttemptsEnded) {
        for ((id, &attempt), outcome) in ended.npc_ids.iter().zip(&ended.attempts).zip(ended.outcomes()) {
            let harmed = matches!(outcome, wire::Outcome::Fell | wire::Outcome::Burnt | wire::Outcome::Drowned);
            if let Some(npc) = self.npcs.get_mut(id).filter(|npc| harmed && npc.attempt == attempt) {
                npc.follower.note_harm();
                self.traversals.extend(npc.follower.take_traversals());
            }
        }
        self.report();
    }

    /// Reports traversals to the planner, if one failed or enough have accumulated.
    fn report(&mut self) {
        let is_urgent = self.traversals.iter().any(|traversal| traversal.end != TryEnd::Arrived);
        let Some(graph) = self.graph.as_ref().filter(|_| is_urgent || self.traversals.len() >= REPORT_LEN) else {
            return;
        };
        let graph_id = graph.id_for_plans(self.takes_interim());
        let traversals = std::mem::take(&mut self.traversals);
        if graph_id.is_empty() {
            // The planner has lost the graph of these traversals.
            return;
        }
        let request = planner::ReportTraversalsRequest {
            graph_id,
            traversals: traversals.iter().map(traversal_to_wire).collect(),
            // The link gives it one.
            request_id: String::new(),
        };
        let mut client = graph.client.clone();
        tokio::spawn(async move {
            if let Ok(Err(status)) = tokio::time::timeout(PLAN_LIMIT, client.report_traversals(request)).await {
                warn!(%status, "cannot report traversals to the planner");
            }
        });
    }

    /// Requests plans. In lockstep waits for the answer, otherwise the plans apply from a later decision on, unless they are urgent. Without an answer NPCs go
    /// on without a plan, which is counted.
    async fn request_plans(&mut self, mut queries: Vec<(u64, u32, Vec3)>, is_urgent: bool) {
        while !queries.is_empty() {
            let again = self.request_plans_once(&queries, is_urgent).await;
            queries.retain(|(id, ..)| again.contains(id));
        }
    }

    /// Requests plans, and returns the NPCs that want another one at once.
    async fn request_plans_once(&mut self, queries: &[(u64, u32, Vec3)], is_urgent: bool) -> Vec<u64> {
        let Some(graph) = self.graph.clone() else { return Vec::new() };
        if self.is_lockstep && !self.has_waited && !graph.wait(GRAPH_LIMIT, PLANNER_SILENCE).await {
            warn!(world = self.world_id, "no graph in time: NPCs go on without plans");
            self.has_waited = true;
        }
        let graph_id = graph.id_for_plans(self.takes_interim());
        if graph_id.is_empty() || graph.is_resting() {
            self.plans_failed = self.plans_failed.saturating_add(queries.len() as u32);
            return Vec::new();
        }
        self.has_waited = false;
        let traffic = self.count_traffic();
        let mut request = planner::FindPathsRequest { graph_id, queries: Vec::with_capacity(queries.len()), traffic };
        for &(id, _, feet) in queries {
            let npc = self.npcs.get_mut(&id).expect("noted in this batch");
            npc.is_planning = true;
            request.queries.push(query_to_wire(&npc.follower.query(feet)));
        }
        let requested: Vec<(u64, u32)> = queries.iter().map(|&(id, attempt, _)| (id, attempt)).collect();
        if self.is_lockstep {
            let plans = find_paths(&graph, request, requested).await;
            self.apply(plans)
        } else if is_urgent {
            let lost: Vec<u64> = requested.iter().map(|&(id, _)| id).collect();
            match tokio::time::timeout(RESORT_LIMIT, find_paths(&graph, request, requested)).await {
                Ok(plans) => self.apply(plans),
                // The followers ask again.
                Err(_) => {
                    lost.into_iter().for_each(|id| self.npc(id).is_planning = false);
                    Vec::new()
                }
            }
        } else {
            let planned = self.planned.clone();
            tokio::spawn(async move {
                let plans = find_paths(&graph, request, requested).await;
                // The receiver is gone if the world's task has ended.
                let _ = planned.send(plans).await;
            });
            Vec::new()
        }
    }

    /// Where the NPCs of this worker are about to be, counted at most twice a second.
    fn count_traffic(&mut self) -> Option<planner::Traffic> {
        let (counted, traffic) = self.traffic.as_mut()?;
        if *counted + TRAFFIC_TICKS <= self.tick {
            let mut now = Traffic::default();
            self.npcs.values().for_each(|npc| npc.follower.add_to(&mut now, npc.feet));
            (*counted, *traffic) = (self.tick, traffic_to_wire(&now));
        }
        Some(traffic.clone())
    }

    fn apply_received(&mut self) {
        while let Ok(plans) = self.plans.try_recv() {
            // Those who want another plan ask for it at their next decision.
            self.apply(plans);
        }
    }

    /// Hands plans to their NPCs, and returns those that want another one.
    fn apply(&mut self, planned: PlanBatch) -> Vec<u64> {
        let mut again = Vec::new();
        for (id, attempt, plan) in planned.plans {
            let Some(npc) = self.npcs.get_mut(&id).filter(|npc| npc.attempt == attempt) else { continue };
            npc.is_planning = false;
            self.plans_failed = self.plans_failed.saturating_add(u32::from(plan.is_none()));
            if let Some(plan) = plan {
                if npc.follower.reconsiders(&plan) {
                    again.push(id);
                    continue;
                }
                (npc.revision, npc.is_outdated) = (planned.revision, false);
                npc.new_plan = Some(npc_plan_to_wire(&plan));
                npc.new_waypoint = Some(npc.follower.take_plan(plan));
                (npc.rehearses_next, npc.ghost) = (true, None);
                (npc.unplanned, npc.next_try) = (0, 0);
            }
        }
        again
    }

    /// Evaluates the policy for these NPCs on another thread and returns packed actions.
    async fn act(
        &mut self,
        npc_ids: &[u64],
        states: &[(u64, State)],
        observations: Vec<f32>,
    ) -> Result<Vec<u8>, WorldError> {
        let memory: Vec<f32> = npc_ids.iter().flat_map(|&id| self.npc(id).memory.clone()).collect();
        let holds: Vec<bool> = npc_ids.iter().map(|&id| self.npc(id).holds).collect();
        let styles = self.styles(npc_ids, states);
        let style = |idx: usize| styles[idx].map_or(Style::Free, |(style, _)| style);
        let noise: Vec<f32> =
            npc_ids.iter().enumerate().flat_map(|(idx, &id)| self.npc(id).noise.draw(style(idx))).collect();
        let body = self.stage.as_ref().map(|stage| stage.body.clone()).unwrap_or_default();
        let rows = Rows { observations, memory, noise };
        let Decided { mut actions, memory } = if self.is_lockstep {
            let policy = self.policy.clone();
            tokio::task::spawn_blocking(move || rows.decide(&policy)).await?
        } else {
            self.inference.decide(rows).await.ok_or(WorldError::Inference)?
        };
        for (action, style) in actions.iter_mut().zip(styles) {
            if let Some((style, state)) = style {
                *action = style.shape(*action, &state, &body);
            }
        }
        let held = actions.iter_mut().zip(holds).filter(|(_, holds)| *holds);
        held.for_each(|(action, _)| *action = Action::default());
        for (&id, row) in npc_ids.iter().zip(memory.chunks_exact(self.policy.memory_len().max(1))) {
            self.npc(id).memory.copy_from_slice(row);
        }
        Ok(convert::pack(actions.iter().flat_map(|action| action.to_array())))
    }
}

/// The first 64 bits of a map's hash; 0 if it is malformed.
fn seed_of(map_hash: &str) -> u64 {
    map_hash.get(..16).and_then(|digits| u64::from_str_radix(digits, 16).ok()).unwrap_or(0)
}

async fn find_paths(graph: &Graph, request: planner::FindPathsRequest, requested: Vec<(u64, u32)>) -> PlanBatch {
    let mut client = graph.client.clone();
    let answer = tokio::time::timeout(PLAN_LIMIT, client.find_paths(request)).await;
    let planner::FindPathsResponse { plans, revision, interim } = match answer {
        Ok(Ok(response)) => {
            graph.note_answer(true);
            response.into_inner()
        }
        Ok(Err(status)) if status.code() == Code::NotFound => {
            // It is alive, but has evicted the graph.
            warn!(%status, "the planner has lost the graph");
            graph.ready.send_replace(String::new());
            Default::default()
        }
        Ok(Err(status)) => {
            warn!(%status, "the planner did not answer");
            graph.note_answer(false);
            Default::default()
        }
        Err(_) => {
            warn!("the planner did not answer within {} s", PLAN_LIMIT.as_secs());
            graph.note_answer(false);
            Default::default()
        }
    };
    let mut plans = plans.into_iter();
    // Whether there is no path, the planner knows only once the graph is built.
    let is_known = |plan: &Plan| !interim || plan.no_path.is_none();
    let mut next = move || plans::plan(&plans.next()?).ok().filter(is_known);
    let plans = requested.into_iter().map(|(id, attempt)| (id, attempt, next())).collect();
    PlanBatch { plans, revision: revision_from_wire(revision) }
}

/// Splits an answer into messages of at most about `limit` bytes each. A single plan is never larger than that.
fn split(mut answer: wire::ActionBatch, limit: usize) -> Vec<wire::ActionBatch> {
    if answer.encoded_len() <= limit {
        return vec![answer];
    }
    let empty = || wire::ActionBatch { world_id: answer.world_id, tick: answer.tick, ..wire::ActionBatch::default() };
    let mut parts = Vec::new();
    let mut part = empty();
    let mut part_len = 0;
    let mut make_room = |part: &mut wire::ActionBatch, part_len: &mut usize, len: usize| {
        if *part_len + len > limit && *part_len > 0 {
            parts.push(std::mem::replace(part, empty()));
            *part_len = 0;
        }
        *part_len += len;
    };
    for plan in std::mem::take(&mut answer.plans) {
        make_room(&mut part, &mut part_len, plan.encoded_len() + FIELD_BYTES);
        part.plans.push(plan);
    }
    for waypoint in std::mem::take(&mut answer.waypoints) {
        make_room(&mut part, &mut part_len, waypoint.encoded_len() + FIELD_BYTES);
        part.waypoints.push(waypoint);
    }
    for given_up in std::mem::take(&mut answer.gave_up) {
        make_room(&mut part, &mut part_len, given_up.encoded_len() + FIELD_BYTES);
        part.gave_up.push(given_up);
    }
    let action_bytes = answer.actions.len() / answer.npc_ids.len().max(1);
    for (idx, (&npc_id, &attempt)) in answer.npc_ids.iter().zip(&answer.attempts).enumerate() {
        // An id takes at most ten bytes, an attempt five.
        make_room(&mut part, &mut part_len, action_bytes + 15);
        part.npc_ids.push(npc_id);
        part.attempts.push(attempt);
        part.actions.extend_from_slice(&answer.actions[idx * action_bytes..][..action_bytes]);
    }
    part.plans_failed = answer.plans_failed;
    part.mover_calls = answer.mover_calls;
    parts.push(part);
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_answer_is_split_and_nothing_is_lost() {
        let count = 4096_u64;
        let plan = wire::NpcPlan { waypoints: vec![wire::Vec3 { x: 1.0, y: 2.0, z: 3.0 }; 40], ..Default::default() };
        let answer = wire::ActionBatch {
            world_id: 7,
            tick: 9,
            npc_ids: (0..count).map(|id| u64::MAX - id).collect(),
            actions: (0..count * 16).map(|byte| byte as u8).collect(),
            attempts: (0..count as u32).collect(),
            waypoints: (0..count).map(|npc_id| wire::Waypoint { npc_id, position: None, attempt: 1 }).collect(),
            plans: (0..count)
                .map(|npc_id| wire::CarriedPlan { npc_id, plan: Some(plan.clone()), attempt: 1 })
                .collect(),
            gave_up: vec![wire::GivenUp { npc_id: 1, attempt: 1, unreachable: true }],
            plans_failed: 3,
            mover_calls: vec![wire::MoverCall { mover: 2, stop: 1 }],
        };
        assert!(answer.encoded_len() > 2 << 20);
        let parts = split(answer.clone(), MAX_ANSWER_BYTES);
        assert!(parts.len() > 3 && parts.iter().all(|part| part.encoded_len() <= MAX_ANSWER_BYTES));
        let mut whole = parts[0].clone();
        for part in &parts[1..] {
            assert_eq!((part.world_id, part.tick), (7, 9));
            whole.npc_ids.extend(&part.npc_ids);
            whole.actions.extend(&part.actions);
            whole.attempts.extend(&part.attempts);
            whole.waypoints.extend(part.waypoints.iter().cloned());
            whole.plans.extend(part.plans.iter().cloned());
            whole.gave_up.extend(part.gave_up.iter().cloned());
            whole.plans_failed += part.plans_failed;
            whole.mover_calls.extend(&part.mover_calls);
        }
        assert_eq!(whole, answer);
        assert_eq!(split(parts[0].clone(), MAX_ANSWER_BYTES), [parts[0].clone()], "a small one stays whole");
    }
}
