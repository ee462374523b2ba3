//! Ticks of a hosted world, hand-overs and late answers, without sockets: workers are queues.

use std::sync::Arc;
use std::time::Duration;
use surefoot_server::hosted::{HostedWorld, NpcError, NpcStatus, TimeMode};
use surefoot_server::ids::{NpcId, WorkerId, WorldId};
use surefoot_server::messages::{Answer, Decision, Hello, ObservationBatch, ToWorker};
use surefoot_server::quota::Quota;
use surefoot_server::registry::Registry;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{Action, Arrival, End, Map, OBSERVATION_LEN, TICKS_PER_DECISION, Tick, Vec3};
use tokio::sync::mpsc::{Receiver, channel};

const GOAL: Vec3 = Vec3::new(40.0, 1.0, 10.0);

/// A floor of 50 x 20 m.
fn floor() -> Arc<Map> {
    let [a, b, c, d] = [[0.0, 0.0], [0.0, 20.0], [50.0, 20.0], [50.0, 0.0]].map(|[x, z]| Vec3::new(x, 1.0, z));
    let triangles = [[a, b, c], [a, c, d]].into_iter().filter_map(|t| Triangle::new(t, Surface::Ground)).collect();
    Arc::new(Map::from_parts(MapSize { width: 50, height: 10, depth: 20 }, triangles, Placed::default()))
}

/// A world with its registry; workers join as queues.
struct Stage {
    registry: Arc<Registry>,
    quota: Arc<Quota>,
    world: HostedWorld,
}

/// The receiving end of a worker's queue.
struct Worker {
    id: WorkerId,
    queue: Receiver<ToWorker>,
}

impl Stage {
    fn new(mode: TimeMode) -> Self {
        let registry = Arc::new(Registry::default());
        let world = HostedWorld::new(WorldId(1), floor(), mode, registry.clone());
        Self { registry, quota: Quota::new(100, "NPCs"), world }
    }

    fn join(&mut self, capacity: u32, room: usize) -> Worker {
        let (sender, queue) = channel(room);
        let id = self.registry.join(Hello::new("test", "none", capacity), sender).id;
        self.world.rebalance();
        self.world.flush();
        Worker { id, queue }
    }

    fn spawn_at(&mut self, x: f32) -> NpcId {
        let id = self.world.spawn(Vec3::new(x, 1.0, 10.0), 0.0, 100, self.quota.grant("test")).unwrap();
        self.world.set_goal(id, GOAL).unwrap();
        id
    }

    /// Steps the ticks of one decision, in which every NPC gets observations once.
    fn step_decision(&mut self) {
        (0..TICKS_PER_DECISION).for_each(|_| self.world.step());
    }
}

impl Worker {
    fn messages(&mut self) -> Vec<ToWorker> {
        std::iter::from_fn(|| self.queue.try_recv().ok()).collect()
    }

    fn batches(&mut self) -> Vec<ObservationBatch> {
        let batch = |message| if let ToWorker::Observations(batch) = message { Some(batch) } else { None };
        self.messages().into_iter().filter_map(batch).collect()
    }
}

fn forward_to(batch: &ObservationBatch) -> Answer {
    let action = Action { forward: 1.0, ..Action::default() };
    let decide = |(&npc, &attempt)| Decision { npc, attempt, action: Some(action), standing: None };
    let decisions = batch.npcs.iter().zip(&batch.attempts).map(decide).collect();
    Answer { tick: batch.tick, decisions, ..Answer::default() }
}

/// An answer about one of the NPCs of a batch.
fn rest(batch: &ObservationBatch, npc: NpcId) -> Answer {
    let decision = Decision { npc, attempt: 1, action: Some(Action::default()), standing: None };
    Answer { decisions: vec![decision], ..forward_to(batch) }
}

#[test]
fn in_realtime_every_npc_gets_one_request_per_decision_and_a_tenth_of_the_npcs_per_tick() {
    let mut stage = Stage::new(TimeMode::Realtime);
    let mut worker = stage.join(64, 256);
    (0..20).for_each(|idx| _ = stage.spawn_at(2.0 + idx as f32));
    worker.messages();
    for _ in 0..TICKS_PER_DECISION {
        stage.world.step();
        let batches = worker.batches();
        assert_eq!(batches.len(), 1, "one batch a tick");
        assert_eq!(batches[0].npcs.len(), 2, "a tenth of twenty");
        assert_eq!(batches[0].observations.len(), 2 * OBSERVATION_LEN);
        stage.world.answer(worker.id, forward_to(&batches[0]));
    }
    let counters = stage.world.counters();
    assert_eq!((counters.asked, counters.answered, counters.missed, counters.stale), (20, 20, 0, 0));
}

#[test]
fn a_lockstep_world_waits_for_every_answer() {
    let mut stage = Stage::new(TimeMode::Lockstep);
    assert!(!stage.world.is_ready(), "nothing to do");
    let npcs = [stage.spawn_at(5.0), stage.spawn_at(8.0)];
    assert!(!stage.world.is_ready(), "nobody to ask");
    let mut worker = stage.join(8, 16);
    assert!(!stage.world.is_ready(), "no worker has answered");
    let batch = worker.batches().pop().unwrap();
    assert_eq!(batch.npcs, npcs);
    stage.world.answer(worker.id, rest(&batch, npcs[0]));
    assert!(!stage.world.is_ready(), "one has not answered");
    stage.world.answer(worker.id, rest(&batch, npcs[1]));
    assert!(stage.world.is_ready());
    stage.world.step();
    assert_eq!(stage.world.tick(), Tick(1));
}

#[test]
fn a_late_answer_is_counted_and_changes_nothing_and_two_misses_stop_the_npc() {
    let mut stage = Stage::new(TimeMode::Realtime);
    let mut worker = stage.join(8, 256);
    let npc = stage.spawn_at(5.0);
    worker.messages();
    stage.step_decision();
    let first = worker.batches().pop().unwrap();
    stage.world.answer(worker.id, forward_to(&first));
    let x = |stage: &Stage| stage.world.npc(npc).unwrap().position.x;
    // One miss: the last action is repeated.
    stage.step_decision();
    let unanswered = worker.batches().pop().unwrap();
    let before = x(&stage);
    stage.step_decision();
    worker.batches();
    let moved = (x(&stage) - before).abs() + (stage.world.npc(npc).unwrap().position.z - 10.0).abs();
    assert!(moved > 0.1, "it goes on as before");
    assert_eq!(stage.world.counters().missed, 1);
    // An answer now is too late.
    stage.world.answer(worker.id, forward_to(&unanswered));
    assert_eq!(stage.world.counters().stale, 1);
    // After a second miss the NPC comes to rest.
    (0..6).for_each(|_| stage.step_decision());
    assert!(stage.world.counters().missed >= 2);
    assert!(stage.world.npc(npc).unwrap().velocity.length() < 1.0e-3, "it stands");
    assert_eq!(stage.world.npc(npc).unwrap().status, NpcStatus::Seeking, "its goal stays");
}

#[test]
fn a_second_worker_takes_its_share_at_a_decision_and_a_lost_one_gives_all_of_its_npcs_away() {
    let mut stage = Stage::new(TimeMode::Realtime);
    let mut first = stage.join(10, 256);
    let npcs: Vec<NpcId> = (0..8).map(|idx| stage.spawn_at(2.0 + 2.0 * idx as f32)).collect();
    stage.step_decision();
    first.batches().iter().for_each(|batch| stage.world.answer(first.id, forward_to(batch)));
    let mut second = stage.join(10, 256);
    stage.step_decision();
    let requested = |worker: &mut Worker| -> Vec<NpcId> {
        let mut npcs: Vec<NpcId> = worker.batches().into_iter().flat_map(|batch| batch.npcs).collect();
        npcs.sort_unstable();
        npcs
    };
    let (mine, theirs) = (requested(&mut first), requested(&mut second));
    assert_eq!((mine.len(), theirs.len()), (4, 4), "half each, one request for each NPC");
    assert_eq!(stage.world.counters().missed, 0, "no decision is lost at a hand-over");
    stage.registry.leave(first.id);
    stage.world.lose_worker(first.id);
    stage.step_decision();
    assert_eq!(requested(&mut second), npcs, "all are the second worker's");
    assert_eq!(stage.world.tally().without_worker, 0);
}

#[test]
fn answers_of_a_worker_that_the_npc_is_not_assigned_to_are_ignored() {
    let mut stage = Stage::new(TimeMode::Lockstep);
    let mut worker = stage.join(8, 16);
    let npc = stage.spawn_at(5.0);
    stage.world.is_ready();
    let batch = worker.batches().pop().unwrap();
    let mut forged = forward_to(&batch);
    forged.waypoints.push((npc, 1, (Vec3::new(1.0, 1.0, 1.0), Arrival::Pass)));
    forged.gave_up.push((npc, 1, End::NoProgress));
    stage.world.answer(WorkerId(99), forged);
    let state = stage.world.npc(npc).unwrap();
    assert_eq!((state.status, state.waypoint, state.last_outcome), (NpcStatus::Seeking, None, None));
    assert!(!stage.world.is_ready(), "it still waits for its own worker");
}

#[test]
fn an_attempt_ends_once_and_its_worker_is_notified() {
    let mut stage = Stage::new(TimeMode::Realtime);
    let mut worker = stage.join(8, 256);
    let npc = stage.spawn_at(39.5);
    stage.world.step();
    let ended = worker.messages().into_iter().find_map(|message| match message {
        ToWorker::Ended(_, ended) => Some(ended),
        _ => None,
    });
    // The end is sent with the next flush.
    let ended = ended.or_else(|| {
        stage.world.flush();
        worker.messages().into_iter().find_map(|message| match message {
            ToWorker::Ended(_, ended) => Some(ended),
            _ => None,
        })
    });
    let ended = ended.expect("the goal lay within reach");
    assert_eq!((ended.len(), ended[0].npc, ended[0].attempt, ended[0].end), (1, npc, 1, End::Reached));
    stage.step_decision();
    assert_eq!(stage.world.history(npc).unwrap().len(), 1);
    assert_eq!(stage.world.npc(npc).unwrap().status, NpcStatus::Idle);
    assert!(matches!(stage.world.set_goal(NpcId(77), GOAL), Err(NpcError::Unknown(NpcId(77)))));
}

#[test]
fn a_worker_that_does_not_answer_loses_its_npcs_within_two_seconds_and_gets_no_new_ones() {
    let mut stage = Stage::new(TimeMode::Realtime);
    let mut silent = stage.join(10, 4096);
    let npcs: Vec<NpcId> = (0..6).map(|idx| stage.spawn_at(2.0 + 2.0 * idx as f32)).collect();
    let mut other = stage.join(10, 4096);
    let mut asked_of_other = Vec::new();
    for _ in 0..12 * TICKS_PER_DECISION {
        stage.world.step();
        for batch in other.batches() {
            asked_of_other.extend(batch.npcs.iter().copied());
            stage.world.answer(other.id, forward_to(&batch));
        }
    }
    asked_of_other.sort_unstable();
    asked_of_other.dedup();
    assert_eq!(asked_of_other, npcs, "the worker that answers decides for all");
    assert!(npcs.iter().all(|&npc| stage.world.npc(npc).unwrap().worker == Some(other.id)));
    let released = silent.messages().into_iter().filter_map(|message| match message {
        ToWorker::Release(_, npcs) => Some(npcs.len()),
        _ => None,
    });
    assert!(released.sum::<usize>() >= 3, "it was notified");
    let late = stage.spawn_at(30.0);
    assert_eq!(stage.world.npc(late).unwrap().worker, Some(other.id), "it is not trusted with new NPCs");
}

#[test]
fn a_worker_without_an_alternative_keeps_its_npcs_and_answers_count_again() {
    let mut stage = Stage::new(TimeMode::Realtime);
    let mut worker = stage.join(10, 4096);
    let npc = stage.spawn_at(5.0);
    (0..20).for_each(|_| stage.step_decision());
    assert_eq!(stage.world.npc(npc).unwrap().worker, Some(worker.id), "there is nobody else");
    worker.messages();
    stage.step_decision();
    let batch = worker.batches().pop().unwrap();
    stage.world.answer(worker.id, forward_to(&batch));
    assert_eq!(stage.world.counters().answered, 1);
}

#[test]
fn a_lockstep_world_gives_the_npcs_of_a_silent_worker_to_another_in_the_end() {
    let mut stage = Stage::new(TimeMode::Lockstep);
    let _silent = stage.join(1, 16);
    let npc = stage.spawn_at(5.0);
    let mut other = stage.join(1, 16);
    assert!(!stage.world.is_ready());
    stage.world.note_waiting(Duration::from_secs(149));
    assert!(!stage.world.is_ready() && other.batches().is_empty(), "a worker may take its time");
    stage.world.note_waiting(Duration::from_secs(2));
    assert!(!stage.world.is_ready());
    let batch = other.batches().pop().expect("the other worker is asked now");
    assert_eq!(batch.npcs, [npc]);
    stage.world.answer(other.id, forward_to(&batch));
    assert!(stage.world.is_ready());
}

#[test]
fn what_is_about_an_earlier_attempt_changes_nothing() {
    let mut stage = Stage::new(TimeMode::Realtime);
    let mut worker = stage.join(8, 256);
    let npc = stage.spawn_at(5.0);
    worker.messages();
    stage.step_decision();
    let first = worker.batches().pop().unwrap();
    // The client changes its mind before the worker's answer arrives.
    assert_eq!(stage.world.set_goal(npc, Vec3::new(20.0, 1.0, 5.0)).unwrap().attempt, 2);
    let mut late = forward_to(&first);
    late.gave_up.push((npc, 1, End::NoProgress));
    late.waypoints.push((npc, 1, (Vec3::new(1.0, 1.0, 1.0), Arrival::Pass)));
    stage.world.answer(worker.id, late);
    let state = stage.world.npc(npc).unwrap();
    assert_eq!((state.status, state.waypoint, state.last_outcome), (NpcStatus::Seeking, None, None));
    assert_eq!(state.attempts_begun, 2);
    assert_eq!((stage.world.counters().stale, stage.world.counters().answered), (1, 0));
    // What is about the present attempt counts.
    stage.world.answer(worker.id, Answer { gave_up: vec![(npc, 2, End::Unreachable)], ..Answer::default() });
    assert_eq!(stage.world.npc(npc).unwrap().last_outcome, Some(End::Unreachable));
}

#[test]
fn a_decision_that_is_not_finite_stops_its_npc_and_no_other() {
    let mut stage = Stage::new(TimeMode::Lockstep);
    let mut worker = stage.join(8, 16);
    let npcs = [stage.spawn_at(5.0), stage.spawn_at(8.0)];
    stage.world.is_ready();
    let batch = worker.batches().pop().unwrap();
    let mut answer = forward_to(&batch);
    answer.decisions[0].action = None;
    answer.invalid = 1;
    stage.world.answer(worker.id, answer);
    assert!(stage.world.is_ready(), "the world goes on");
    (0..TICKS_PER_DECISION).for_each(|_| stage.world.step());
    let moved = |npc, x: f32| (stage.world.npc(npc).unwrap().position - Vec3::new(x, 1.0, 10.0)).length() > 0.1;
    assert!(!moved(npcs[0], 5.0) && moved(npcs[1], 8.0));
    assert_eq!(stage.world.counters().invalid, 1);
}

#[test]
fn every_worker_that_knew_a_world_learns_of_its_end() {
    let mut stage = Stage::new(TimeMode::Realtime);
    let mut first = stage.join(1, 64);
    stage.spawn_at(5.0);
    stage.world.flush();
    let mut second = stage.join(10, 64);
    stage.spawn_at(8.0);
    stage.world.flush();
    let mut idle = stage.join(10, 64);
    stage.world.release_all();
    let is_over = |message: &ToWorker| matches!(message, ToWorker::Over(WorldId(1)));
    assert!(first.messages().last().is_some_and(is_over));
    assert!(second.messages().last().is_some_and(is_over));
    assert!(!idle.messages().iter().any(is_over), "it never heard of the world");
    assert!(stage.registry.load().iter().all(|worker| worker.npc_count == 0));
}

#[test]
fn an_npc_that_comes_and_goes_between_two_messages_is_never_heard_of() {
    let mut stage = Stage::new(TimeMode::Realtime);
    let mut worker = stage.join(8, 64);
    let npc = stage.spawn_at(5.0);
    stage.world.despawn(npc).unwrap();
    stage.world.flush();
    assert!(worker.messages().is_empty(), "neither its assignment nor its release");
}

#[test]
fn npcs_without_a_worker_get_places_in_the_order_of_their_ids_and_those_that_are_gone_get_none() {
    for mode in [TimeMode::Realtime, TimeMode::Lockstep] {
        let mut stage = Stage::new(mode);
        let first = stage.join(1, 16);
        let npcs: Vec<NpcId> = (0..5).map(|idx| stage.spawn_at(5.0 + 3.0 * idx as f32)).collect();
        let deciders = |world: &HostedWorld| {
            npcs.iter().map(|npc| world.npc(*npc).ok()?.worker).collect::<Vec<Option<WorkerId>>>()
        };
        assert_eq!(deciders(&stage.world), [Some(first.id), None, None, None, None]);
        stage.world.despawn(npcs[1]).unwrap();
        stage.registry.set_capacity(first.id, 2);
        stage.world.assign_workers();
        assert_eq!(deciders(&stage.world), [Some(first.id), None, Some(first.id), None, None]);
        // All are without a worker again.
        stage.registry.leave(first.id);
        stage.world.lose_worker(first.id);
        assert_eq!(deciders(&stage.world), [None; 5]);
        let second = stage.join(3, 16).id;
        assert_eq!(deciders(&stage.world), [Some(second), None, Some(second), Some(second), None]);
    }
}
