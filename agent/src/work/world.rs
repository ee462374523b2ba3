//! A worker's NPCs of one world: plans, waypoints and decisions.

use super::graph::{Graph, revision_from_wire};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::collections::BTreeMap;
use std::time::Duration;
use surefoot_net::client::Link;
use surefoot_planner::Plan;
use surefoot_planner::live::Traversal;
use surefoot_policy::Policy;
use surefoot_proto::convert;
use surefoot_proto::planner::v1 as planner;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::plans::{self, npc_plan_to_wire, query_to_wire, traversal_to_wire};
use surefoot_proto::world::v1 as wire;
use surefoot_rollout::follow::{FollowConfig, Follower, Step};
use surefoot_world::{OBSERVATION_LEN, Vec3};
use tokio::sync::{mpsc, watch};
use tonic::Code;
use tracing::warn;

/// Most batches of plans waiting to be applied; when full, further ones wait.
const PLAN_QUEUE: usize = 256;
/// Number of traversals that are reported together; a failed one is reported at once.
const REPORT_LEN: usize = 64;
/// Most queries in one batch; planners allow more.
const MAX_QUERIES: usize = 1024;
/// Longest wait for a batch of plans.
const PLAN_LIMIT: Duration = Duration::from_secs(5);

/// Messages to a world's task.
pub(super) enum WorldMessage {
    Release(Vec<u64>),
    Ended(wire::AttemptsEnded),
    Observations(wire::ObservationBatch),
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
}

/// A received batch of plans.
struct PlanBatch {
    /// NPC id, attempt and plan; `None` if the planner failed.
    plans: Vec<(u64, u32, Option<Plan>)>,
    /// Revision of designers' edits that the plans were made with.
    revision: Option<u64>,
}

/// The task for all NPCs of one world that this worker decides for.
pub(super) struct WorldTask {
    world_id: u64,
    is_lockstep: bool,
    policy: Policy,
    noise_share: f32,
    graph: Option<Graph>,
    npcs: BTreeMap<u64, Npc>,
    planned: mpsc::Sender<PlanBatch>,
    plans: mpsc::Receiver<PlanBatch>,
    /// Traversals that have not been reported to the planner yet.
    traversals: Vec<Traversal>,
    out: mpsc::Sender<wire::WorkRequest>,
}

impl WorldTask {
    /// Creates a task for the NPCs of one world. Answers go to `out`.
    pub fn new(
        assignment: &wire::Assignment,
        policy: Policy,
        noise_share: f32,
        graph: Option<Graph>,
        out: mpsc::Sender<wire::WorkRequest>,
    ) -> Self {
        let (planned, plans) = mpsc::channel(PLAN_QUEUE);
        Self {
            world_id: assignment.world_id,
            is_lockstep: assignment.mode() == wire::TimeMode::Lockstep,
            policy,
            noise_share,
            graph,
            npcs: BTreeMap::new(),
            planned,
            plans,
            traversals: Vec::new(),
            out,
        }
    }

    /// Handles messages until the channel closes.
    pub async fn run(mut self, mut messages: mpsc::Receiver<WorldMessage>) {
        while let Some(message) = messages.recv().await {
            match message {
                WorldMessage::Release(npc_ids) => {
                    for id in npc_ids {
                        self.npcs.remove(&id);
                    }
                }
                WorldMessage::Ended(ended) => self.note_ends(&ended),
                WorldMessage::Observations(batch) => {
                    let Some(answer) = self.decide(batch).await else { return };
                    let request = wire::WorkRequest { message: Some(wire::work_request::Message::Actions(answer)) };
                    if self.out.send(request).await.is_err() {
                        return;
                    }
                }
            }
        }
    }

    /// Answers one batch; `None` if the batch is malformed.
    async fn decide(&mut self, batch: wire::ObservationBatch) -> Option<wire::ActionBatch> {
        let count = batch.npc_ids.len();
        let vectors = |bytes: &[u8], field| convert::unpack(bytes, count * 3, field);
        let (observations, positions, goals) = match (
            convert::unpack(&batch.observations, count * OBSERVATION_LEN, "observations"),
            vectors(&batch.positions, "positions"),
            vectors(&batch.goals, "goals"),
        ) {
            (Ok(observations), Ok(positions), Ok(goals)) => (observations, positions, goals),
            _ => {
                warn!(world = self.world_id, "the server sent a malformed batch");
                return None;
            }
        };
        let at = |values: &[f32], idx: usize| Vec3::new(values[3 * idx], values[3 * idx + 1], values[3 * idx + 2]);
        self.apply_received();
        let mut gave_up = Vec::new();
        let mut queries = Vec::new();
        for (idx, &id) in batch.npc_ids.iter().enumerate() {
            let (feet, goal) = (at(&positions, idx), at(&goals, idx));
            let attempt = batch.attempts.get(idx).copied().unwrap_or(0);
            let touched = batch.waypoint_reached.get(idx).copied().unwrap_or(false);
            let grounded = batch.grounded.get(idx).copied().unwrap_or(true);
            match self.note(id, attempt, [feet, goal], touched, grounded) {
                Step::Keep => {}
                Step::Head(waypoint) => self.npc(id).new_waypoint = Some(waypoint),
                Step::Plan => queries.push((id, attempt, feet)),
                Step::GiveUp => gave_up.push(id),
            }
        }
        self.report();
        for queries in queries.chunks(MAX_QUERIES) {
            self.request_plans(queries).await;
        }
        let waypoints = batch.npc_ids.iter().filter_map(|&id| {
            let position = self.npcs.get_mut(&id)?.new_waypoint.take()?;
            Some(wire::Waypoint { npc_id: id, position: Some(convert::to_wire(position)) })
        });
        let waypoints = waypoints.collect();
        let plans = batch.npc_ids.iter().filter_map(|&id| {
            let plan = self.npcs.get_mut(&id)?.new_plan.take()?;
            Some(wire::CarriedPlan { npc_id: id, plan: Some(plan) })
        });
        let plans = plans.collect();
        let actions = self.act(&batch.npc_ids, observations, batch.tick).await?;
        Some(wire::ActionBatch {
            world_id: self.world_id,
            tick: batch.tick,
            npc_ids: batch.npc_ids,
            actions,
            waypoints,
            gave_up,
            plans,
        })
    }

    fn npc(&mut self, id: u64) -> &mut Npc {
        self.npcs.get_mut(&id).expect("noted in this batch")
    }

    /// Updates an NPC's follower with its position and returns the follower's step; a new attempt gets a new follower.
    fn note(&mut self, id: u64, attempt: u32, [feet, goal]: [Vec3; 2], touched: bool, grounded: bool) -> Step {
        let has_planner = self.graph.is_some();
        let latest = self.graph.as_ref().and_then(|graph| *graph.revision.borrow());
        let memory_len = self.policy.memory_len();
        let begin = || Npc {
            attempt,
            follower: Follower::new(goal, FollowConfig::default()),
            is_planning: false,
            revision: None,
            replanned_for: None,
            new_waypoint: None,
            new_plan: None,
            memory: vec![0.0; memory_len],
        };
        let npc = self.npcs.entry(id).or_insert_with(begin);
        if npc.attempt != attempt {
            *npc = begin();
        }
        if !has_planner || npc.is_planning {
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
        let is_urgent = self.traversals.iter().any(|traversal| !traversal.reached);
        let Some(graph) = self.graph.as_ref().filter(|_| is_urgent || self.traversals.len() >= REPORT_LEN) else {
            return;
        };
        let graph_id = graph.id.borrow().clone();
        let traversals = std::mem::take(&mut self.traversals);
        if graph_id.is_empty() {
            // The planner has lost the graph of these traversals.
            return;
        }
        let request = planner::ReportTraversalsRequest {
            graph_id,
            traversals: traversals.iter().map(traversal_to_wire).collect(),
        };
        let mut client = graph.client.clone();
        tokio::spawn(async move {
            if let Ok(Err(status)) = tokio::time::timeout(PLAN_LIMIT, client.report_traversals(request)).await {
                warn!(%status, "cannot report traversals to the planner");
            }
        });
    }

    /// Requests plans. In lockstep waits for the answer, otherwise the plans apply from a later decision on.
    async fn request_plans(&mut self, queries: &[(u64, u32, Vec3)]) {
        let Some(graph) = &mut self.graph else { return };
        if self.is_lockstep && graph.id.wait_for(|id| !id.is_empty()).await.is_err() {
            return;
        }
        let graph_id = graph.id.borrow().clone();
        if graph_id.is_empty() {
            return;
        }
        let mut request = planner::FindPathsRequest { graph_id, queries: Vec::with_capacity(queries.len()) };
        for &(id, _, feet) in queries {
            let npc = self.npcs.get_mut(&id).expect("noted in this batch");
            npc.is_planning = true;
            request.queries.push(query_to_wire(&npc.follower.query(feet)));
        }
        let (client, ready, planned) = (graph.client.clone(), graph.ready.clone(), self.planned.clone());
        let requested: Vec<(u64, u32)> = queries.iter().map(|&(id, attempt, _)| (id, attempt)).collect();
        if self.is_lockstep {
            let plans = find_paths(client, request, requested, &ready).await;
            self.apply(plans);
        } else {
            tokio::spawn(async move {
                let plans = find_paths(client, request, requested, &ready).await;
                // The receiver is gone if the world's task has ended.
                let _ = planned.send(plans).await;
            });
        }
    }

    fn apply_received(&mut self) {
        while let Ok(plans) = self.plans.try_recv() {
            self.apply(plans);
        }
    }

    fn apply(&mut self, planned: PlanBatch) {
        for (id, attempt, plan) in planned.plans {
            let Some(npc) = self.npcs.get_mut(&id).filter(|npc| npc.attempt == attempt) else { continue };
            npc.is_planning = false;
            if let Some(plan) = plan {
                npc.revision = planned.revision;
                npc.new_plan = Some(npc_plan_to_wire(&plan));
                npc.new_waypoint = Some(npc.follower.take_plan(plan));
            }
        }
    }

    /// Evaluates the policy for these NPCs on a blocking thread and returns packed actions.
    async fn act(&mut self, npc_ids: &[u64], observations: Vec<f32>, tick: u64) -> Option<Vec<u8>> {
        let (policy, noise_share, world_id) = (self.policy.clone(), self.noise_share, self.world_id);
        let mut memory: Vec<f32> = npc_ids.iter().flat_map(|&id| self.npc(id).memory.clone()).collect();
        let task = tokio::task::spawn_blocking(move || {
            let mut rng = ChaCha8Rng::seed_from_u64(world_id);
            rng.set_stream(tick);
            let mut actions = Vec::new();
            policy.act(&observations, &mut memory, noise_share, &mut rng, &mut actions);
            (memory, convert::pack(actions.iter().flat_map(|action| action.to_array())))
        });
        let (memory, actions) = task.await.ok()?;
        for (&id, row) in npc_ids.iter().zip(memory.chunks_exact(self.policy.memory_len().max(1))) {
            self.npc(id).memory.copy_from_slice(row);
        }
        Some(actions)
    }
}

async fn find_paths(
    mut client: PlannerServiceClient<Link>,
    request: planner::FindPathsRequest,
    requested: Vec<(u64, u32)>,
    graph_ready: &watch::Sender<String>,
) -> PlanBatch {
    let answer = tokio::time::timeout(PLAN_LIMIT, client.find_paths(request)).await;
    let planner::FindPathsResponse { plans, revision } = match answer {
        Ok(Ok(response)) => response.into_inner(),
        Ok(Err(status)) => {
            warn!(%status, "the planner did not answer");
            if status.code() == Code::NotFound {
                graph_ready.send_replace(String::new());
            }
            Default::default()
        }
        Err(_) => {
            warn!("the planner did not answer in time");
            Default::default()
        }
    };
    let mut plans = plans.into_iter();
    let mut next = move || plans::plan(&plans.next()?).ok();
    let plans = requested.into_iter().map(|(id, attempt)| (id, attempt, next())).collect();
    PlanBatch { plans, revision: revision_from_wire(revision) }
}
