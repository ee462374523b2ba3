//! The tick: move, log motion, end attempts, request the decisions that are due next. Answers arrive between ticks. A
//! lockstep world requests decisions before it moves, because it waits for the answers.

use super::events::EventKind;
use super::movement::PREDICTION_TICKS;
use super::pursuit::NoWay;
use super::workers::{ASSIGN_EVERY, hand_over};
use super::world::{HostedWorld, MISSES_UNTIL_NEUTRAL, NpcRecord};
use crate::ids::NpcId;
use crate::ids::WorkerId;
use crate::messages::TimeMode;
use crate::messages::{Answer, AttemptEnd, Decision, ObservationBatch, ToWorker};
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use surefoot_world::formation::LEADER_SPEED;
use surefoot_world::{Action, Arrival, End, MoverState, Npc, NpcSlot, ProfileIdx, TICKS_PER_DECISION, Vec3, World};
use tracing::warn;

impl HostedWorld {
    /// Requests the decisions that are due in a lockstep world, once per tick. Returns whether the world can be
    /// stepped: some NPC is seeking, turns or rests on its route, every seeking NPC has a worker, and no answer is
    /// missing.
    pub fn is_ready(&mut self) -> bool {
        if self.requested_tick != Some(self.tick()) {
            // Places at workers are also freed by other worlds.
            self.assign_workers();
            self.look_around();
            let needs_time = |record: &NpcRecord| {
                let is_up = self.world.npc(record.slot).is_some_and(|npc| npc.harm.is_none());
                record.goal.is_some() || record.turns_to.is_some() || record.rest().is_some() && is_up
            };
            let lacks_worker = |record: &NpcRecord| record.goal.is_some() && record.worker.is_none();
            if !self.records.values().any(needs_time) || self.records.values().any(lacks_worker) {
                self.flush();
                return false;
            }
            self.request_decisions();
            self.requested_tick = Some(self.tick());
        }
        self.records.values().all(|record| record.awaiting.is_none())
    }

    /// Steps the world by one tick. In lockstep worlds, [`HostedWorld::is_ready`] has requested the decisions before.
    ///
    /// Realtime worlds request decisions after the tick, so that an answer before the next tick acts on the observed
    /// state.
    pub fn step(&mut self) {
        self.waited = Duration::ZERO;
        self.world.tick();
        self.note_motion();
        self.settle();
        self.note_standing();
        if self.mode == TimeMode::Realtime {
            if self.tick().0.is_multiple_of(ASSIGN_EVERY) {
                self.assign_workers();
                self.leave_silent_workers();
            }
            self.request_decisions();
        }
    }

    /// Logs the events of NPCs in this tick.
    fn note_motion(&mut self) {
        let (tick, mut now) = (self.tick(), None);
        let Self { records, world, events, .. } = self;
        for (&id, record) in records {
            let npc = world.npc(record.slot).expect("every record has an NPC");
            let attempt = record.goal.map(|_| record.attempts);
            let used = world.used_in_tick(record.slot);
            record.motion.note((npc, world.profile_of(npc)), used, attempt, |kind| {
                // All events of a tick have the same time.
                let time = *now.get_or_insert_with(SystemTime::now);
                events.push(tick, time, id, kind);
            });
        }
    }

    /// Logs events about NPCs that stand, and warns of missing workers, once in the period of decisions.
    fn note_standing(&mut self) {
        let tick = self.tick();
        if !tick.0.is_multiple_of(u64::from(TICKS_PER_DECISION)) {
            return;
        }
        let Self { id: world, records, world: state, events, .. } = self;
        let mut lacking = 0;
        for (&id, record) in records {
            let npc = state.npc(record.slot).expect("every record has an NPC");
            if let Some(kind) = record.note_standing(npc, tick) {
                events.push(tick, SystemTime::now(), id, kind);
            }
            lacking += u32::from(record.worker.is_none());
        }
        if self.shortage.is_due(lacking > 0, tick) {
            warn!(
                world_id = world.0,
                npcs = lacking,
                "no worker has room for some NPCs, which stand: start another worker, or raise `surefoot work --npcs`"
            );
        }
    }

    /// Sends observations of all NPCs that are due for a decision to their workers.
    ///
    /// In realtime a tenth of the NPCs is due at each tick; in lockstep all NPCs are due at each tenth tick.
    fn request_decisions(&mut self) {
        let tick = self.tick();
        let period = u64::from(TICKS_PER_DECISION);
        for (&id, record) in &mut self.records {
            let phase = if self.mode == TimeMode::Realtime { u64::from(record.slot.0) } else { 0 };
            if !(tick + phase).0.is_multiple_of(period) {
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
            let seeks = record.heads_for().zip(record.worker).filter(|_| !record.is_at_target && !record.awaits_group);
            let Some((goal, worker)) = seeks else { continue };
            self.world.close_decision(record.slot);
            let npc = self.world.npc(record.slot).expect("every record has an NPC");
            let new_batch = || {
                let movers = MoverState::pack(self.world.movers());
                let observation_len = self.registry.observation_len(worker);
                ObservationBatch { movers, ..ObservationBatch::new(self.id, tick, npc.profile, observation_len) }
            };
            let batch = self.batches.entry((worker, npc.profile.0)).or_insert_with(new_batch);
            batch.npcs.push(id);
            batch.positions.push(npc.body.feet);
            batch.goals.push(goal);
            batch.touches.push(record.pursuit.arrival == Arrival::Pass);
            let leads = self.groups.contains_key(&id);
            batch.gaits.push(if leads { record.gait.at_most(LEADER_SPEED) } else { record.gait });
            batch.attempts.push(record.attempts);
            let touched = npc.episode.and_then(|episode| episode.end) == Some(End::Reached);
            batch.waypoint_reached.push(touched);
            batch.grounded.push(npc.body.is_grounded());
            // Workers have a world for each body.
            batch.states.push(Npc { profile: ProfileIdx::default(), ..*npc }.to_bytes());
            record.awaiting = Some(tick);
            self.unanswered_since.entry(worker).or_insert(tick);
            self.counters.asked += 1;
        }
        // A worker must receive assignments before the observations of the assigned NPCs.
        self.flush();
        for ((worker, _), mut batch) in std::mem::take(&mut self.batches) {
            self.observe(worker, &mut batch);
            self.registry.try_observe(worker, ToWorker::Observations(batch));
        }
    }

    /// Observes the NPCs of a batch, unless its worker observes all of them itself.
    fn observe(&self, worker: WorkerId, batch: &mut ObservationBatch) {
        if batch.npcs.iter().all(|id| self.records[id].observer == Some(worker)) {
            return;
        }
        batch.observations.resize(batch.npcs.len() * batch.observation_len, 0.0);
        for (id, row) in batch.npcs.iter().zip(batch.observations.chunks_exact_mut(batch.observation_len)) {
            self.world.observe(self.records[id].slot, row);
        }
    }

    /// Applies a worker's answers. Answers that are late, or about an attempt that has ended, are counted and ignored.
    pub fn answer(&mut self, worker: WorkerId, answer: Answer) {
        self.counters.plans_failed += u64::from(answer.plans_failed);
        self.counters.invalid += answer.invalid;
        if self.tick().since(answer.tick) <= u64::from(TICKS_PER_DECISION) {
            self.unanswered_since.remove(&worker);
        }
        for Decision { npc, attempt, action, standing } in answer.decisions {
            let awaited = self.records.get_mut(&npc).filter(|it| it.is_sought_by(worker, attempt));
            let Some(record) = awaited.filter(|it| it.awaiting == Some(answer.tick)) else {
                self.counters.stale += 1;
                continue;
            };
            record.awaiting = None;
            record.misses = 0;
            record.observer = answer.observes.then_some(worker);
            record.stand.reported = standing;
            let Some(action) = action else {
                // The NPC comes to rest; other NPCs of the answer are not affected.
                self.world.decide(record.slot, Action::default());
                continue;
            };
            self.counters.answered += 1;
            self.world.decide(record.slot, action);
        }
        for call in answer.mover_calls {
            self.world.call(call);
        }
        for (id, attempt, plan) in answer.plans {
            if let Some(record) = self.records.get_mut(&id).filter(|it| it.is_sought_by(worker, attempt)) {
                record.plan = Some(Arc::new(plan));
                self.note_path(id);
            }
        }
        for (id, attempt, (position, arrival)) in answer.waypoints {
            if let Some(record) = self.records.get_mut(&id).filter(|it| it.is_sought_by(worker, attempt)) {
                record.waypoint = Some(position);
                self.world.head_for(record.slot, position, arrival);
            }
        }
        let tick = self.tick();
        let is_current = answer.tick <= tick && tick.since(answer.tick) <= PREDICTION_TICKS;
        for (id, attempt, trajectory) in answer.predictions.into_iter().filter(|_| is_current) {
            if let Some(record) = self.records.get_mut(&id).filter(|it| it.is_sought_by(worker, attempt)) {
                record.prediction = Some((answer.tick, trajectory));
            }
        }
        for (id, attempt, end) in answer.gave_up {
            if self.records.get(&id).is_some_and(|it| it.is_sought_by(worker, attempt)) {
                self.end_attempt(id, end);
            }
        }
    }

    /// Ends the attempts whose outcome this tick decided.
    fn settle(&mut self) {
        self.lead_groups();
        self.follow_targets();
        self.follow_routes();
        let mut ended: Vec<(NpcId, End)> = self.gather().into_iter().map(|id| (id, End::ReachedNear)).collect();
        let (mut keeping, mut braking) = (Vec::new(), Vec::new());
        for (&id, record) in self.records.iter().filter(|(_, record)| record.goal.is_some()) {
            let npc = self.world.npc(record.slot).expect("every record has an NPC");
            let stuck = npc.episode.and_then(|episode| episode.end).filter(|end| *end == End::NoProgress);
            match npc.harm.or(stuck) {
                Some(end) => ended.push((id, end)),
                None if record.pursuit.keeps => keeping.push(id),
                None => match self.arrival_of(record) {
                    Some(end) if self.has_stopped(record) => ended.push((id, end)),
                    arrived if record.pursuit.stops => braking.push((id, arrived.is_some())),
                    _ => {}
                },
            }
        }
        keeping.into_iter().for_each(|id| self.keep_still(id));
        braking.into_iter().for_each(|(id, is_there)| _ = self.brake(id, is_there));
        for (id, end) in ended {
            self.end_attempt(id, end);
        }
        self.look_around();
        self.turn_bodies();
    }

    pub(super) fn end_attempt(&mut self, id: NpcId, end: End) {
        let tick = self.tick();
        let record = self.records.get_mut(&id).expect("an attempt has a record");
        let Some(goal) = record.goal else { return };
        let distance_m = distance_to(&self.world, record.slot, goal);
        let no_path = record.why_unreachable(end);
        record.note_end(end, tick, distance_m, no_path.clone());
        let (pursuit, reserved) = (record.pursuit, record.reserved);
        record.clear_goal();
        self.world.clear_waypoint(record.slot);
        if let Some(worker) = record.worker {
            let ended = AttemptEnd { npc: id, attempt: record.attempts, end };
            self.outbox.entry(worker).or_default().ended.push(ended);
        }
        let (attempt, seconds) = (record.attempts, record.lasted(tick));
        let reached = record.note_route(end, tick);
        let at = End::ALL.iter().position(|other| *other == end).expect("all ends are listed");
        self.counters.ends[at] += 1;
        let (outcome, at_goal) = (Some(end), Some(goal));
        let reason = no_path.clone();
        let ended = EventKind::AttemptEnded { attempt, end: outcome, goal: at_goal, distance_m, seconds, no_path };
        self.log_event(id, ended);
        if let Some(stop) = reached {
            self.log_event(id, EventKind::StopReached { attempt, stop });
        }
        match end {
            End::Reached | End::ReachedNear => self.stay_at(id, goal, (reserved, pursuit.facing)),
            _ => self.gatherings.release(id),
        }
        if end.is_truncation() && pursuit.keeps {
            if end == End::Unreachable {
                self.tell_no_way(id, NoWay::Failed, reason);
            }
            self.retry_later(id, goal, pursuit);
        }
        if self.groups.contains_key(&id) {
            self.end_group(id, end, goal, pursuit);
        }
    }

    /// Logs that the current attempt, if any, ends without an outcome because it is replaced.
    pub(super) fn log_replaced_attempt(&mut self, id: NpcId) {
        let Some(record) = self.records.get(&id).filter(|record| record.goal.is_some()) else { return };
        let (attempt, goal, seconds) = (record.attempts, record.goal, record.lasted(self.tick()));
        let distance_m = goal.map_or(0.0, |goal| distance_to(&self.world, record.slot, goal));
        let no_path = Arc::default();
        self.log_event(id, EventKind::AttemptEnded { attempt, end: None, goal, distance_m, seconds, no_path });
    }
}

/// Distance of an NPC's feet from a place, m.
fn distance_to(world: &World, slot: NpcSlot, place: Vec3) -> f32 {
    world.npc(slot).expect("every record has an NPC").body.feet.distance(place)
}

impl NpcRecord {
    /// Whether `worker` decides for the NPC and `attempt` is its current attempt.
    fn is_sought_by(&self, worker: WorkerId, attempt: u32) -> bool {
        self.worker == Some(worker) && self.goal.is_some() && self.attempts == attempt
    }
}
