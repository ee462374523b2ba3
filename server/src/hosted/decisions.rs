//! The tick, and what is exchanged with workers around it.

use super::{HostedWorld, TimeMode};
use crate::registry::WorkerId;
use std::collections::BTreeMap;
use std::sync::Arc;
use surefoot_proto::convert;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::work_response::Message;
use surefoot_world::character::Action;
use surefoot_world::{End, TICKS_PER_DECISION, Vec3};

/// Missed answers in a row after which an NPC stops repeating its last action.
const MISSES_UNTIL_NEUTRAL: u8 = 2;

/// What a worker is to be told before its next observations.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    pub released: Vec<u64>,
    pub assigned: Vec<u64>,
    pub ended: wire::AttemptsEnded,
}

/// A worker's answer, checked.
#[derive(Debug, Clone, Default)]
pub struct Answer {
    /// Tick of the observations.
    pub tick: u64,
    /// Whose actions follow.
    pub npc_ids: Vec<u64>,
    /// One action for each.
    pub actions: Vec<Action>,
    /// New waypoints.
    pub waypoints: Vec<(u64, Vec3)>,
    /// Attempts to be given up.
    pub gave_up: Vec<u64>,
    /// New plans.
    pub plans: Vec<(u64, wire::NpcPlan)>,
}

impl HostedWorld {
    // --- who carries whom ---

    /// Gives every NPC without a worker to one with room.
    pub fn assign_workers(&mut self) {
        for (&id, record) in &mut self.records {
            if record.worker.is_none() {
                let Some(worker) = self.registry.assign() else { break };
                record.worker = Some(worker);
                record.awaiting = None;
                self.outbox.entry(worker).or_default().assigned.push(id);
            }
        }
    }

    /// Lets less loaded workers take NPCs over, each at its next decision, so that none misses one.
    pub fn rebalance(&mut self) {
        self.assign_workers();
        for (&id, record) in &mut self.records {
            let (Some(worker), None) = (record.worker, record.next_worker) else { continue };
            let Some(next) = self.registry.relieve(worker) else { continue };
            record.next_worker = Some(next);
            if record.awaiting.is_none() {
                hand_over(&mut self.outbox, id, &mut record.worker, &mut record.next_worker);
            }
        }
    }

    /// Hands the NPCs of a lost worker to others.
    pub fn lose_worker(&mut self, lost: WorkerId) {
        for (&id, record) in &mut self.records {
            if record.next_worker == Some(lost) {
                record.next_worker = None;
                if let Some(worker) = record.worker.filter(|worker| *worker != lost) {
                    self.registry.keep(worker);
                }
            }
            if record.worker == Some(lost) {
                record.worker = None;
                // An observation that a lost worker will never answer is asked again of the next one.
                record.awaiting = None;
                hand_over(&mut self.outbox, id, &mut record.worker, &mut record.next_worker);
            }
        }
        self.outbox.remove(&lost);
        self.asked_tick = None;
        self.assign_workers();
    }

    /// Gives all places back when the world ends.
    pub fn release_all(&mut self) {
        let ids: Vec<u64> = self.records.keys().copied().collect();
        for id in ids {
            // Every one of them exists.
            let _ = self.despawn(id);
        }
        self.flush();
    }

    /// Tells workers what they have not been told yet.
    pub fn flush(&mut self) {
        for (worker, Outbox { released, assigned, ended }) in std::mem::take(&mut self.outbox) {
            let world_id = self.id;
            if !released.is_empty() {
                self.tell(worker, Message::Release(wire::Release { world_id, npc_ids: released }));
            }
            if !assigned.is_empty() {
                let assignment = wire::Assignment {
                    world_id,
                    map: self.world.map().spec().map(convert::map_spec_to_wire),
                    npc_ids: assigned,
                    mode: self.mode.to_wire().into(),
                    map_hash: self.world.map().hash().to_hex(),
                };
                self.tell(worker, Message::Assignment(assignment));
            }
            if !ended.npc_ids.is_empty() {
                self.tell(worker, Message::Ended(wire::AttemptsEnded { world_id, ..ended }));
            }
        }
    }

    fn tell(&self, worker: WorkerId, message: Message) {
        self.registry.tell(worker, wire::WorkResponse { message: Some(message) });
    }

    // --- the tick ---

    /// Whether a lockstep world can be stepped: every answer is in, and there is something to do.
    pub fn is_ready(&mut self) -> bool {
        if self.asked_tick != Some(self.tick()) {
            let mut seeking = self.records.values().filter(|record| record.goal.is_some()).peekable();
            if seeking.peek().is_none() || seeking.any(|record| record.worker.is_none()) {
                self.flush();
                return false;
            }
            self.ask();
            self.asked_tick = Some(self.tick());
        }
        self.records.values().all(|record| record.awaiting.is_none())
    }

    /// One tick: ask, move, settle. Lockstep worlds have asked already in [`HostedWorld::is_ready`].
    pub fn step(&mut self) {
        if self.mode == TimeMode::Realtime {
            self.ask();
        }
        self.world.tick();
        self.settle();
    }

    /// Sends the observations of all NPCs whose decision is due to their workers.
    ///
    /// In realtime a tenth of the NPCs is due at each tick; in lockstep all of them are at every tenth.
    fn ask(&mut self) {
        let tick = self.tick();
        let period = u64::from(TICKS_PER_DECISION);
        for (&id, record) in &mut self.records {
            let phase = if self.mode == TimeMode::Realtime { u64::from(record.slot.0) } else { 0 };
            if !(tick + phase).is_multiple_of(period) {
                continue;
            }
            if record.awaiting.take().is_some() {
                self.counters.missed += 1;
                record.misses = record.misses.saturating_add(1);
                if record.misses >= MISSES_UNTIL_NEUTRAL {
                    self.world.decide(record.slot, Action::default());
                }
            }
            hand_over(&mut self.outbox, id, &mut record.worker, &mut record.next_worker);
            let (Some(goal), Some(worker)) = (record.goal, record.worker) else { continue };
            self.world.close_decision(record.slot);
            self.world.observe(record.slot, &mut self.row);
            let npc = self.world.npc(record.slot).expect("every record has an NPC");
            let batch = self.batches.entry(worker).or_default();
            batch.npc_ids.push(id);
            extend_packed(&mut batch.observations, &self.row);
            extend_packed(&mut batch.positions, &npc.body.feet.to_array());
            extend_packed(&mut batch.goals, &goal.to_array());
            batch.attempts.push(record.attempts);
            let touched = npc.episode.and_then(|episode| episode.end) == Some(End::Reached);
            batch.waypoint_reached.push(touched);
            batch.grounded.push(npc.body.is_grounded());
            record.awaiting = Some(tick);
            self.counters.asked += 1;
        }
        // Before its observations a worker must know whose they are.
        self.flush();
        for (worker, mut batch) in std::mem::take(&mut self.batches) {
            (batch.world_id, batch.tick) = (self.id, tick);
            self.registry.offer(worker, wire::WorkResponse { message: Some(Message::Observations(batch)) });
        }
    }

    /// Takes a worker's answers. Answers that nobody waits for any more are counted and ignored.
    pub fn answer(&mut self, worker: WorkerId, answer: Answer) {
        for (&id, &action) in answer.npc_ids.iter().zip(&answer.actions) {
            let awaited = self.records.get_mut(&id);
            let awaited = awaited.filter(|it| it.worker == Some(worker) && it.awaiting == Some(answer.tick));
            let Some(record) = awaited else {
                self.counters.stale += 1;
                continue;
            };
            record.awaiting = None;
            record.misses = 0;
            self.counters.answered += 1;
            self.world.decide(record.slot, action);
        }
        for (id, plan) in answer.plans {
            if let Some(record) = self.records.get_mut(&id).filter(|it| it.is_sought_by(worker)) {
                record.plan = Some(Arc::new(plan));
            }
        }
        for (id, position) in answer.waypoints {
            if let Some(record) = self.records.get_mut(&id).filter(|it| it.is_sought_by(worker)) {
                record.waypoint = Some(position);
                self.world.set_goal(record.slot, position);
            }
        }
        for id in answer.gave_up {
            if self.records.get(&id).is_some_and(|it| it.is_sought_by(worker)) {
                self.end_attempt(id, End::NoProgress);
            }
        }
    }

    /// Ends the attempts that this tick decided.
    fn settle(&mut self) {
        let goal_radius = self.world.task().goal_radius;
        let mut ended = Vec::new();
        for (&id, record) in &self.records {
            let Some(goal) = record.goal else { continue };
            let npc = self.world.npc(record.slot).expect("every record has an NPC");
            let stuck = npc.episode.and_then(|episode| episode.end).filter(|end| *end == End::NoProgress);
            let reached = (npc.body.feet.distance(goal) <= goal_radius).then_some(End::Reached);
            if let Some(end) = reached.or(npc.harm).or(stuck) {
                ended.push((id, end));
            }
        }
        for (id, end) in ended {
            self.end_attempt(id, end);
        }
    }

    fn end_attempt(&mut self, id: u64, end: End) {
        let record = self.records.get_mut(&id).expect("an attempt has a record");
        record.note_end(end, self.world.current_tick());
        record.clear_goal();
        self.world.clear_goal(record.slot);
        if let Some(worker) = record.worker {
            let ended = &mut self.outbox.entry(worker).or_default().ended;
            ended.npc_ids.push(id);
            ended.attempts.push(record.attempts);
            ended.outcomes.push(convert::outcome(Some(end)).into());
        }
        let at = End::ALL.iter().position(|other| *other == end).expect("all ends are listed");
        self.counters.ends[at] += 1;
    }
}

impl super::Record {
    /// Whether `worker` carries it to a goal.
    fn is_sought_by(&self, worker: WorkerId) -> bool {
        self.worker == Some(worker) && self.goal.is_some()
    }
}

/// Moves an NPC to the worker that is to take it over, if one is.
fn hand_over(
    outbox: &mut BTreeMap<WorkerId, Outbox>,
    id: u64,
    worker: &mut Option<WorkerId>,
    next: &mut Option<WorkerId>,
) {
    let Some(next) = next.take() else { return };
    if let Some(old) = worker.replace(next) {
        outbox.entry(old).or_default().released.push(id);
    }
    outbox.entry(next).or_default().assigned.push(id);
}

fn extend_packed(bytes: &mut Vec<u8>, values: &[f32]) {
    for value in values {
        bytes.extend(value.to_le_bytes());
    }
}
