//! A worker's NPCs of one world: their attempts, plans, rehearsals and actions.
//!
//! [`WorldTask::decide`] answers one batch of observations. `batch` decodes and encodes, `npc` holds the attempts,
//! `planning` requests plans, `ground` and `rehearse` run legs ahead of time, `zones` follows zones and tags, `act`
//! evaluates the policy, and `standing` says why NPCs stand.

mod act;
mod batch;
mod ground;
mod npc;
mod planning;
mod rehearse;
mod standing;
mod zones;

pub(super) use ground::RehearsalMap;
pub(super) use zones::ZoneNews;

use crate::graph::Graph;
use crate::inference::Inference;
use crate::maps::Arrival;
use batch::{Answer, Batch, Malformed, Sighting};
use ground::RehearsalGround;
use npc::{Npc, Npcs};
use planning::{PlanRequest, Planning};
use standing::Standing;
use std::sync::Arc;
use std::time::{Duration, Instant};
use surefoot_policy::Policy;
use surefoot_proto::world::v1 as wire;
use surefoot_rollout::follow::scene::Scene;
use surefoot_rollout::follow::{FollowConfig, Follower, Step};
use surefoot_rollout::rehearse::NoiseStream;
use surefoot_world::{End, MoverState, OBSERVATION_LEN, TICKS_PER_DECISION, TICKS_PER_SECOND, Trajectory};
use tokio::sync::{mpsc, watch};

/// Why a world's task cannot continue.
#[derive(Debug, thiserror::Error)]
pub(super) enum WorldError {
    /// The server sent a batch of another shape.
    #[error(transparent)]
    Malformed(#[from] Malformed),
    /// Evaluating the policy panicked.
    #[error("the policy failed: {0}")]
    Policy(#[from] tokio::task::JoinError),
    /// Evaluating the policy for several worlds panicked.
    #[error("the policy failed for several worlds at once")]
    Inference,
}

/// Period of decisions. After half of it, the task of a realtime world answers without what takes longer.
const PERIOD: Duration = Duration::from_millis(1000 * TICKS_PER_DECISION as u64 / TICKS_PER_SECOND as u64);

/// Messages to a world's task.
pub(super) enum WorldMessage {
    Release(Vec<u64>),
    Ended(wire::AttemptsEnded),
    /// Observations, and when they arrived.
    Observations(Box<wire::ObservationBatch>, Instant),
    /// Zones or tags have changed.
    Zones(ZoneNews),
    /// The pieces on the map have changed: the new map, and its graph.
    Edited {
        map: Option<watch::Receiver<Arrival>>,
        graph: Option<Arc<Graph>>,
    },
}

/// How a worker's NPCs move.
#[derive(Debug, Clone, Copy)]
pub(super) struct MotionSettings {
    /// Share of the policy's exploration noise.
    pub noise_share: f32,
    /// Whether NPCs move composed where a rehearsal has arrived.
    pub composes: bool,
}

/// What a world's task decides with.
pub(super) struct WorldParts {
    pub policy: Policy,
    /// What realtime worlds decide with.
    pub inference: Inference,
    pub motion: MotionSettings,
    /// `None` without a planner.
    pub graph: Option<Arc<Graph>>,
    /// `None` if NPCs do not rehearse.
    pub map: Option<RehearsalMap>,
    /// Where answers go.
    pub out: mpsc::Sender<wire::WorkRequest>,
}

/// The task for the NPCs of one world that have one body and that this worker decides for.
pub(super) struct WorldTask {
    world_id: u64,
    /// Seed of the exploration noise: equal for worlds on equal maps, so that lockstep worlds repeat themselves.
    seed: u64,
    is_lockstep: bool,
    policy: Policy,
    inference: Inference,
    motion: MotionSettings,
    npcs: Npcs,
    planning: Planning,
    ground: RehearsalGround,
    /// Whether the last observations were left out.
    is_behind: bool,
    out: mpsc::Sender<wire::WorkRequest>,
}

impl WorldTask {
    /// Creates a task for the NPCs of an assignment.
    pub fn new(assignment: &wire::Assignment, parts: WorldParts) -> Self {
        let WorldParts { policy, inference, motion, graph, map, out } = parts;
        let is_lockstep = assignment.mode() == wire::TimeMode::Lockstep;
        let has_traffic = assignment.solid_npcs && assignment.mode() == wire::TimeMode::Realtime;
        Self {
            world_id: assignment.world_id,
            seed: seed_of(&assignment.map_hash),
            is_lockstep,
            planning: Planning::new(assignment.world_id, is_lockstep, graph, has_traffic),
            ground: RehearsalGround::new(policy.clone(), is_lockstep, map),
            policy,
            inference,
            motion,
            npcs: Npcs::new(),
            is_behind: false,
            out,
        }
    }

    /// Handles messages until the channel closes, or the session ends.
    pub async fn run(mut self, mut messages: mpsc::Receiver<WorldMessage>) -> Result<(), WorldError> {
        while let Some(message) = messages.recv().await {
            match message {
                WorldMessage::Release(npc_ids) => {
                    self.planning.rules.release(&npc_ids);
                    npc_ids.iter().for_each(|id| _ = self.npcs.remove(id));
                }
                WorldMessage::Zones(news) => self.follow_zones(news),
                WorldMessage::Ended(ended) => self.record_ends(&ended),
                WorldMessage::Edited { map, graph } => self.follow_edit(map, graph),
                WorldMessage::Observations(batch, arrived) => {
                    if self.leaves_out(arrived.elapsed()) {
                        continue;
                    }
                    self.planning.wait_until = arrived + PERIOD / 2;
                    for answer in self.decide(*batch).await? {
                        if self.out.send(answer).await.is_err() {
                            return Ok(());
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// Whether observations of this age are left out because the task is behind. The server ignores answers after a
    /// period of decisions, so a task that is as late as that goes on with observations that it can answer in time.
    fn leaves_out(&mut self, age: Duration) -> bool {
        let limit = if self.is_behind { PERIOD / 2 } else { PERIOD };
        self.is_behind = !self.is_lockstep && age >= limit;
        self.is_behind
    }

    /// Answers one batch.
    async fn decide(&mut self, batch: wire::ObservationBatch) -> Result<Vec<wire::WorkRequest>, WorldError> {
        let mut batch = Batch::decode(batch, self.policy.observation_len())?;
        let mut answer = Answer::default();
        (self.planning.tick, self.planning.takes_interim) = (batch.tick, self.takes_interim());
        self.planning.receive(&mut self.npcs);
        self.planning.switch_graph(&mut self.npcs);
        let movers = self.ground.movers(&batch.movers);
        let requests = self.advance(&batch, &movers, &mut answer);
        self.planning.report();
        let is_urgent = std::mem::take(&mut self.planning.rules.are_new);
        self.planning.request(&requests, &mut self.npcs, is_urgent).await;
        self.ground.read_states(&mut batch).await;
        // Its map may have arrived with this batch.
        let movers = if movers.is_empty() { self.ground.movers(&batch.movers) } else { movers };
        self.planning.takes_interim = self.takes_interim();
        self.rehearse(&batch, &movers, &mut answer).await?;
        if self.ground.awaits_map() {
            for seen in &batch.sightings {
                self.npc(seen.id).hold.holds = seen.is_grounded;
            }
        } else {
            self.rehearse_straight(&batch, &movers).await?;
        }
        answer.actions = self.act(&batch, &movers).await?;
        answer.observes = self.observes();
        answer.standings = self.standings(&batch);
        answer.trajectories = self.trajectories(&batch);
        let plans_failed = std::mem::take(&mut self.planning.failed_count);
        Ok(answer.encode(self.world_id, &batch, &mut self.npcs, plans_failed))
    }

    fn npc(&mut self, id: u64) -> &mut Npc {
        self.npcs.get_mut(&id).expect("seen in this batch")
    }

    /// Advances the attempts of a batch's NPCs by one decision, and returns the plans that they need.
    fn advance(&mut self, batch: &Batch, movers: &[MoverState], answer: &mut Answer) -> Vec<PlanRequest> {
        let mut requests = Vec::new();
        for (idx, seen) in batch.sightings.iter().enumerate() {
            self.meet(seen, batch.tick << 16 | idx as u64 & 0xffff);
            self.watch_movers(seen, movers, answer);
            self.review_plan(seen);
            let step = self.step(seen);
            let has_planner = self.planning.has_planner();
            let npc = self.npc(seen.id);
            let request = PlanRequest { npc_id: seen.id, attempt: seen.attempt, feet: seen.feet };
            match step {
                // The server ends attempts that reach their goals.
                Step::Keep | Step::End(End::Reached) => {
                    // An NPC in the air cannot turn back.
                    let wants_plan = npc.planning.is_outdated && !npc.planning.is_requested && seen.is_grounded;
                    requests.extend((has_planner && wants_plan).then_some(request));
                }
                Step::HeadFor(waypoint) => {
                    npc.news.waypoint = Some(waypoint);
                    npc.attempt.extend_forecast();
                }
                Step::Plan => requests.push(request),
                Step::End(end) => answer.gave_up.push((seen.id, seen.attempt, end)),
            }
        }
        requests
    }

    /// Begins the attempt of an NPC, unless it is known.
    fn meet(&mut self, seen: &Sighting, stream: u64) {
        if self.npcs.get(&seen.id).is_none_or(|npc| npc.number != seen.attempt) {
            let (composes, arrival) = (self.motion.composes, seen.arrival);
            let config = FollowConfig { composes, arrival, ..FollowConfig::default() };
            // Lockstep worlds repeat their noise, although the ids of their NPCs differ.
            let noise = NoiseStream::new(self.motion.noise_share, self.seed, stream);
            let follower = Follower::new(seen.goal, config);
            self.npcs.insert(seen.id, Npc::begin(seen.attempt, follower, self.policy.memory_len(), noise));
        }
        let npc = self.npc(seen.id);
        npc.feet = seen.feet;
        npc.planning.is_outdated |= npc.attempt.set_gait(seen.gait);
        npc.follow_goal(seen.goal, seen.has_reached);
    }

    /// Lets an NPC watch the movers of its world.
    fn watch_movers(&mut self, seen: &Sighting, movers: &[MoverState], answer: &mut Answer) {
        let Some(map) = self.ground.map().filter(|_| !movers.is_empty()) else { return };
        let follower = &mut self.npcs.get_mut(&seen.id).expect("met in this batch").attempt.follower;
        follower.watch_movers(Scene { map, states: movers }, seen.feet, seen.is_grounded);
        answer.calls.extend(follower.call());
    }

    /// Records a decision of an NPC and returns what it does next.
    fn step(&mut self, seen: &Sighting) -> Step {
        let (has_planner, latest) = (self.planning.has_planner(), self.planning.revision());
        let stands = seen.is_grounded && self.ground.awaits_map();
        let npc = self.npc(seen.id);
        if !has_planner || npc.planning.is_requested || stands {
            // The server itself ends attempts that make no progress.
            return Step::Keep;
        }
        // An NPC in the air cannot turn back.
        let is_outdated = npc.planning.revision.zip(latest).is_some_and(|(revision, latest)| revision != latest);
        if seen.is_grounded && is_outdated && npc.planning.replanned_for != latest {
            npc.planning.replanned_for = latest;
            npc.attempt.follower.drop_plan();
        }
        let follower = &mut npc.attempt.follower;
        let step = follower.record_decision(seen.feet, seen.has_reached.then_some(End::Reached));
        let traversals = follower.take_traversals();
        self.planning.add_traversals(traversals);
        step
    }

    /// Records attempts that ended: harm on an edge counts as a failed traversal of it.
    fn record_ends(&mut self, ended: &wire::AttemptsEnded) {
        for ((id, &attempt), outcome) in ended.npc_ids.iter().zip(&ended.attempts).zip(ended.outcomes()) {
            let is_harm = matches!(outcome, wire::Outcome::Fell | wire::Outcome::Burnt | wire::Outcome::Drowned);
            if let Some(npc) = self.npcs.get_mut(id).filter(|npc| is_harm && npc.number == attempt) {
                npc.attempt.follower.record_harm();
                self.planning.add_traversals(npc.attempt.follower.take_traversals());
            }
        }
        self.planning.report();
    }

    /// Follows an edit of the map: NPCs rehearse again on the new map, and plan again when they have its graph.
    fn follow_edit(&mut self, map: Option<watch::Receiver<Arrival>>, graph: Option<Arc<Graph>>) {
        if let Some(map) = map {
            self.ground.change_map(map);
        }
        self.npcs.values_mut().for_each(|npc| npc.attempt.forget_forecast());
        if let Some(graph) = graph {
            self.planning.follow_edit(graph, &mut self.npcs);
        }
    }

    /// Why the NPCs of a batch stand after its decision.
    fn standings(&self, batch: &Batch) -> Vec<Option<Standing>> {
        let (awaits_map, awaits_graph) = (self.ground.awaits_map(), self.planning.awaits_graph());
        let standing = |seen: &Sighting| self.npcs.get(&seen.id)?.standing(awaits_map, awaits_graph);
        batch.sightings.iter().map(standing).collect()
    }

    /// What the NPCs of a batch will do in the next second, as far as it was rehearsed.
    fn trajectories(&self, batch: &Batch) -> Vec<Trajectory> {
        let predict = |seen: &Sighting| Some(self.npcs.get(&seen.id)?.trajectory(&seen.state.as_ref()?.body));
        batch.sightings.iter().map(|seen| predict(seen).unwrap_or_default()).collect()
    }

    /// Follows changes of zones and tags: the NPCs that they concern plan again at their next decision.
    fn follow_zones(&mut self, news: ZoneNews) {
        let concerned = self.planning.rules.change(news);
        for (id, npc) in &mut self.npcs {
            npc.planning.has_new_rules |= concerned.as_ref().is_none_or(|concerned| concerned.contains(id));
        }
    }

    /// Lets an NPC whose zones have changed plan again. It follows its plan until it has another one, unless the plan
    /// leads into a zone that it must not enter. An NPC in the air cannot turn back.
    fn review_plan(&mut self, seen: &Sighting) {
        let rules = &self.planning.rules;
        let npc = self.npcs.get_mut(&seen.id).expect("seen in this batch");
        if !npc.planning.has_new_rules || !seen.is_grounded {
            return;
        }
        npc.planning.has_new_rules = false;
        npc.planning.is_outdated = true;
        if rules.bar_plan(seen.id, seen.feet, npc) {
            npc.attempt.follower.drop_plan();
            npc.attempt.forget_forecast();
        }
    }

    /// Whether this task observes NPCs itself: most are steered, and need no observation. A policy with a memory needs
    /// all of them, and others cannot be seen from here.
    fn observes(&self) -> bool {
        let is_plain = self.policy.memory_len() == 0 && self.policy.observation_len() == OBSERVATION_LEN;
        is_plain && self.ground.is_ready()
    }

    /// Whether NPCs plan on a graph whose build is running. Lockstep worlds do not: their results must not depend on
    /// the progress of a build. NPCs that cannot rehearse yet do not either, because some edges of such a graph are
    /// unproved.
    fn takes_interim(&self) -> bool {
        !self.is_lockstep && (self.ground.is_absent() || self.ground.is_ready())
    }
}

/// The first 64 bits of a map's hash; 0 if it is malformed.
fn seed_of(map_hash: &str) -> u64 {
    map_hash.get(..16).and_then(|digits| u64::from_str_radix(digits, 16).ok()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use surefoot_proto::convert;

    /// The ticks that a task answers when the observations of 30 ticks wait for it.
    async fn answered(mode: wire::TimeMode) -> Vec<u64> {
        let policy = Policy::shipped().expect("the shipped weights are valid");
        let (out, mut answers) = mpsc::channel(64);
        let parts = WorldParts {
            inference: Inference::start(policy.clone()).expect("a thread"),
            motion: MotionSettings { noise_share: 0.0, composes: true },
            graph: None,
            map: None,
            policy: policy.clone(),
            out,
        };
        let mut assignment = wire::Assignment::default();
        assignment.set_mode(mode);
        let (queue, messages) = mpsc::channel(64);
        let now = Instant::now();
        for tick in 0..30 {
            let batch = wire::ObservationBatch {
                tick,
                npc_ids: vec![1],
                observations: convert::pack(vec![0.0; policy.observation_len()]),
                positions: convert::pack([0.0; 3]),
                goals: convert::pack([9.0; 3]),
                ..Default::default()
            };
            let age = Duration::from_secs(29 - tick) / TICKS_PER_SECOND;
            queue.try_send(WorldMessage::Observations(Box::new(batch), now - age)).expect("room");
        }
        drop(queue);
        WorldTask::new(&assignment, parts).run(messages).await.expect("answers");
        let mut ticks = Vec::new();
        while let Some(answer) = answers.recv().await {
            match answer.message {
                Some(wire::work_request::Message::Actions(actions)) => ticks.push(actions.tick),
                other => panic!("not an answer: {other:?}"),
            }
        }
        ticks
    }

    #[tokio::test]
    async fn a_task_that_is_behind_answers_what_it_can_in_time() {
        assert_eq!(answered(wire::TimeMode::Realtime).await, [25, 26, 27, 28, 29]);
        assert_eq!(answered(wire::TimeMode::Lockstep).await, (0..30).collect::<Vec<_>>(), "no answer may be missing");
    }
}
