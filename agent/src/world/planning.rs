//! Plans for the NPCs of one world: requests them from the planner, hands them out, and reports traversals.

use super::npc::{Npc, Npcs};
use super::zones::ZoneRules;
use crate::graph::{Graph, Plans};
use std::sync::Arc;
use std::time::{Duration, Instant};
use surefoot_planner::evidence::TryEnd;
use surefoot_planner::live::Traversal;
use surefoot_planner::{Plan, Query, Traffic};
use surefoot_world::Vec3;
use tokio::sync::{mpsc, oneshot};
use tracing::warn;

/// Ticks after which traffic is counted again.
const TRAFFIC_TICKS: u64 = 30;
/// Most batches of plans that wait to be handed out; when the queue is full, further ones wait.
const PLAN_QUEUE: usize = 256;
/// Number of traversals that are reported together; a failed one is reported at once.
const REPORT_LEN: usize = 64;
/// Most queries in one batch; planners allow more.
const MAX_QUERIES: usize = 1024;
/// Longest wait of a lockstep world for the graph of its map. After that its NPCs act without plans until there is a
/// graph.
const GRAPH_LIMIT: Duration = Duration::from_secs(120);
/// Longest silence of a planner that builds the graph for which a lockstep world waits.
const PLANNER_SILENCE: Duration = Duration::from_secs(15);

/// The graph of an edited map.
enum NextGraph {
    /// The current graph belongs to the current map.
    None,
    /// NPCs plan on the graph of the former map until this graph is ready.
    Awaited(Arc<Graph>),
    /// NPCs plan on the unaffected part of the graph until the edited part has been probed.
    Interim,
}

/// An NPC that needs a plan.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlanRequest {
    pub npc_id: u64,
    pub attempt: u32,
    /// Position of the feet, m.
    pub feet: Vec3,
}

/// Plans for requests.
struct Planned {
    requests: Vec<PlanRequest>,
    plans: Plans,
    /// Revision of the zones and tags that the plans respect.
    rules_revision: u32,
}

/// Predicted places of NPCs, for congestion.
#[derive(Default)]
struct CountedTraffic {
    traffic: Traffic,
    tick: u64,
}

/// What the NPCs of a world plan with.
pub(super) struct Planning {
    world_id: u64,
    is_lockstep: bool,
    graph: Option<Arc<Graph>>,
    next_graph: NextGraph,
    /// `None` in lockstep, where results must not depend on how NPCs are shared out, and where NPCs do not get in each
    /// other's way.
    traffic: Option<CountedTraffic>,
    /// Tick of the batch.
    pub tick: u64,
    /// Until when a realtime world waits for urgent plans.
    pub wait_until: Instant,
    /// Whether NPCs plan on a graph whose build is running.
    pub takes_interim: bool,
    /// Whether a lockstep world has waited for the graph in vain.
    has_waited: bool,
    /// What plans respect besides the map.
    pub rules: ZoneRules,
    /// Plans that failed since the last answer.
    pub failed_count: u32,
    /// Plans that have arrived in the background.
    arrived: (mpsc::Sender<Planned>, mpsc::Receiver<Planned>),
    /// Traversals that have not been reported to the planner.
    traversals: Vec<Traversal>,
}

impl Planning {
    /// Plans for a world on `graph`. `has_traffic` says whether plans avoid congestion.
    pub fn new(world_id: u64, is_lockstep: bool, graph: Option<Arc<Graph>>, has_traffic: bool) -> Self {
        Self {
            world_id,
            is_lockstep,
            graph,
            next_graph: NextGraph::None,
            traffic: has_traffic.then(CountedTraffic::default),
            tick: 0,
            wait_until: Instant::now(),
            takes_interim: false,
            has_waited: false,
            rules: ZoneRules::default(),
            failed_count: 0,
            arrived: mpsc::channel(PLAN_QUEUE),
            traversals: Vec::new(),
        }
    }

    /// Whether there is a planner.
    pub fn has_planner(&self) -> bool {
        self.graph.is_some()
    }

    /// The latest revision of designers' edits.
    pub fn revision(&self) -> Option<u64> {
        self.graph.as_ref().and_then(|graph| *graph.revision.borrow())
    }

    /// Whether NPCs stand still because their graph is on its way.
    pub fn awaits_graph(&self) -> bool {
        let is_awaited = |graph: &Arc<Graph>| graph.id_for_plans(self.takes_interim).is_empty() && !graph.is_resting();
        self.graph.as_ref().is_some_and(is_awaited)
    }

    /// Follows an edit of the map, whose graph `graph` will be.
    pub fn follow_edit(&mut self, graph: Arc<Graph>, npcs: &mut Npcs) {
        if self.is_lockstep {
            (self.graph, self.has_waited) = (Some(graph), false);
            npcs.values_mut().for_each(|npc| npc.planning.is_outdated = true);
        } else {
            self.next_graph = NextGraph::Awaited(graph);
        }
    }

    /// Switches to the graph of an edited map as soon as it answers queries. NPCs then plan again, and once more when
    /// it is complete.
    pub fn switch_graph(&mut self, npcs: &mut Npcs) {
        let takes_interim = self.takes_interim;
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
        npcs.values_mut().for_each(|npc| npc.planning.is_outdated = true);
    }

    /// Keeps traversals of edges until they are reported.
    pub fn add_traversals(&mut self, traversals: Vec<Traversal>) {
        self.traversals.extend(traversals);
    }

    /// Reports traversals to the planner, if one failed or enough have accumulated.
    pub fn report(&mut self) {
        let is_urgent = self.traversals.iter().any(|traversal| traversal.end != TryEnd::Arrived);
        let Some(graph) = self.graph.as_ref().filter(|_| is_urgent || self.traversals.len() >= REPORT_LEN) else {
            return;
        };
        graph.report(self.takes_interim, std::mem::take(&mut self.traversals));
    }

    /// Requests plans. A lockstep world waits for them; in a realtime world they are handed out at a later decision,
    /// unless they are urgent. An NPC whose request fails continues without a plan, which is counted.
    pub async fn request(&mut self, requests: &[PlanRequest], npcs: &mut Npcs, is_urgent: bool) {
        for requests in requests.chunks(MAX_QUERIES) {
            let mut requests = requests.to_vec();
            while !requests.is_empty() {
                requests = self.request_once(requests, npcs, is_urgent).await;
            }
        }
    }

    /// Requests plans, and returns the NPCs that want another one at once.
    async fn request_once(&mut self, requests: Vec<PlanRequest>, npcs: &mut Npcs, is_urgent: bool) -> Vec<PlanRequest> {
        let Some(graph) = self.graph.clone() else { return Vec::new() };
        if self.is_lockstep && !self.has_waited && !graph.wait(GRAPH_LIMIT, PLANNER_SILENCE).await {
            warn!(world = self.world_id, "no graph in time: NPCs act without plans");
            self.has_waited = true;
        }
        let graph_id = graph.id_for_plans(self.takes_interim);
        if graph_id.is_empty() || graph.is_resting() {
            self.failed_count = self.failed_count.saturating_add(requests.len() as u32);
            return Vec::new();
        }
        self.has_waited = false;
        let traffic = self.count_traffic(npcs);
        let rules = &self.rules;
        let query = |request: &PlanRequest| -> Query {
            let npc = npcs.get_mut(&request.npc_id).expect("seen in this batch");
            npc.planning.is_requested = true;
            Query { tags: rules.tags_of(request.npc_id), ..npc.attempt.follower.query(request.feet) }
        };
        let queries: Vec<Query> = requests.iter().map(query).collect();
        let (zones, rules_revision) = (rules.zones.clone(), rules.revision);
        let find = async move {
            let plans = graph.find_paths(graph_id, &queries, &zones, traffic.as_ref()).await;
            Planned { plans, requests, rules_revision }
        };
        if self.is_lockstep {
            return self.hand_out(find.await, npcs);
        }
        let (now, mut soon) = oneshot::channel();
        let later = self.arrived.0.clone();
        tokio::spawn(async move {
            if let Err(planned) = now.send(find.await) {
                // The receiver may have been dropped with the world's task.
                let _ = later.send(planned).await;
            }
        });
        let mut planned = None;
        if is_urgent {
            planned = tokio::time::timeout_at(self.wait_until.into(), &mut soon).await.ok().and_then(Result::ok);
        }
        soon.close();
        let planned = planned.or_else(|| soon.try_recv().ok());
        planned.map_or_else(Vec::new, |planned| self.hand_out(planned, npcs))
    }

    /// Predicts the places of this worker's NPCs, at most twice a second.
    fn count_traffic(&mut self, npcs: &Npcs) -> Option<Traffic> {
        let (counted, tick) = (self.traffic.as_mut()?, self.tick);
        if counted.tick + TRAFFIC_TICKS <= tick {
            *counted = CountedTraffic { traffic: Traffic::default(), tick };
            npcs.values().for_each(|npc| npc.attempt.follower.add_to(&mut counted.traffic, npc.feet));
        }
        Some(counted.traffic.clone())
    }

    /// Hands out the plans that have arrived in the background. An NPC that wants another plan requests it at its next
    /// decision.
    pub fn receive(&mut self, npcs: &mut Npcs) {
        while let Ok(planned) = self.arrived.1.try_recv() {
            self.hand_out(planned, npcs);
        }
    }

    /// Hands plans to their NPCs, and returns the requests of those that want another plan.
    fn hand_out(&mut self, planned: Planned, npcs: &mut Npcs) -> Vec<PlanRequest> {
        let Planned { requests, plans, rules_revision } = planned;
        let mut again = Vec::new();
        let mut found = plans.plans.into_iter();
        for request in requests {
            let plan = found.next().flatten();
            let Some(npc) = npcs.get_mut(&request.npc_id).filter(|npc| npc.number == request.attempt) else { continue };
            npc.planning.is_requested = false;
            // The planner knows that there is no path only when the graph is complete.
            let is_known = |plan: &Plan| !plans.is_interim || plan.no_path.is_none();
            let follower = &mut npc.attempt.follower;
            match plan {
                None => self.failed_count = self.failed_count.saturating_add(1),
                // The NPC requests another plan at its next decision.
                Some(_) if rules_revision != self.rules.revision => npc.planning.is_outdated = true,
                Some(plan) if follower.reconsiders_jumps(&plan) => again.push(request),
                Some(plan) if !is_known(&plan) => self.failed_count = self.failed_count.saturating_add(1),
                Some(plan) if follower.reconsiders(&plan) => again.push(request),
                Some(plan) => npc.take_plan(plan, plans.revision),
            }
        }
        again
    }
}

impl Npc {
    fn take_plan(&mut self, plan: Plan, revision: Option<u64>) {
        (self.planning.revision, self.planning.is_outdated) = (revision, false);
        self.news.has_plan = true;
        self.news.waypoint = Some(self.attempt.take_plan(plan));
        (self.hold.unplanned, self.hold.next_try) = (0, 0);
    }
}
