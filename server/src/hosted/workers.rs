//! Workers of NPCs: assignment, hand-over, loss, and messages to workers.

use super::outbox::Outbox;
use super::world::HostedWorld;
use crate::ids::NpcId;
use crate::ids::WorkerId;
use crate::messages::{Assignment, ToWorker};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;
use surefoot_world::{ProfileIdx, TICKS_PER_SECOND};
use tracing::warn;

/// Period of checks for NPCs without a worker, and for silent workers, ticks.
pub(super) const ASSIGN_EVERY: u64 = 30;
/// Ticks without an answer after which a worker's NPCs move to another worker.
const SILENCE_LIMIT: u64 = TICKS_PER_SECOND as u64;
/// The same for lockstep worlds, which wait longer, because workers may wait for plans.
const LOCKSTEP_PATIENCE: Duration = Duration::from_secs(150);

impl HostedWorld {
    /// Assigns every NPC without a worker to one with room.
    pub fn assign_workers(&mut self) {
        while let Some(&id) = self.unassigned.first() {
            if let Some(record) = self.records.get_mut(&id).filter(|record| record.worker.is_none()) {
                let Some(worker) = self.registry.assign() else { break };
                record.worker = Some(worker);
                record.awaiting = None;
                self.outbox.entry(worker).or_default().assign(id);
            }
            self.unassigned.pop_first();
        }
    }

    /// Moves NPCs of workers that have not answered for a second to workers with room.
    pub(super) fn leave_silent_workers(&mut self) {
        let tick = self.tick();
        let silent: Vec<WorkerId> = self
            .unanswered_since
            .iter()
            .filter(|(_, since)| tick.since(**since) >= SILENCE_LIMIT)
            .map(|(worker, _)| *worker)
            .collect();
        silent.into_iter().for_each(|worker| self.leave_silent_worker(worker));
    }

    /// Counts the time that a lockstep world has waited for answers. After the limit, the waiting NPCs move to other
    /// workers.
    pub fn note_waiting(&mut self, time: Duration) {
        self.waited += time;
        if self.waited < LOCKSTEP_PATIENCE {
            return;
        }
        self.waited = Duration::ZERO;
        let waiting = self.records.values().filter(|record| record.awaiting.is_some());
        let silent: BTreeSet<WorkerId> = waiting.filter_map(|record| record.worker).collect();
        silent.into_iter().for_each(|worker| self.leave_silent_worker(worker));
        self.requested_tick = None;
    }

    fn leave_silent_worker(&mut self, silent: WorkerId) {
        self.unanswered_since.remove(&silent);
        self.registry.distrust(silent);
        let mut moved_count = 0;
        for (&id, record) in self.records.iter_mut().filter(|(_, record)| record.worker == Some(silent)) {
            // If there is a next worker, its place is already reserved.
            record.next_worker = record.next_worker.or_else(|| self.registry.move_from_silent(silent));
            if record.next_worker.is_none() {
                continue;
            }
            record.awaiting = None;
            hand_over(&mut self.outbox, id, &mut record.worker, &mut record.next_worker);
            moved_count += 1;
        }
        if moved_count > 0 {
            warn!(
                world_id = self.id.0,
                worker = silent.0,
                moved_count,
                "worker does not answer; its NPCs move to other workers"
            );
        }
    }

    /// Moves NPCs to less loaded workers, each at its next decision, so that no decision is missed.
    pub fn rebalance(&mut self) {
        self.assign_workers();
        for (&id, record) in &mut self.records {
            let (Some(worker), None) = (record.worker, record.next_worker) else { continue };
            let Some(next) = self.registry.move_to_less_loaded(worker) else { continue };
            record.next_worker = Some(next);
            if record.awaiting.is_none() {
                hand_over(&mut self.outbox, id, &mut record.worker, &mut record.next_worker);
            }
        }
    }

    /// Assigns the NPCs of a lost worker to others.
    pub fn lose_worker(&mut self, lost: WorkerId) {
        for (&id, record) in &mut self.records {
            if record.next_worker == Some(lost) {
                record.next_worker = None;
                if let Some(worker) = record.worker.filter(|worker| *worker != lost) {
                    self.registry.retake(worker);
                }
            }
            if record.worker == Some(lost) {
                record.worker = None;
                // The lost worker will not answer: the next worker gets new observations.
                record.awaiting = None;
                hand_over(&mut self.outbox, id, &mut record.worker, &mut record.next_worker);
                self.unassigned.insert(id);
            }
        }
        self.outbox.remove(&lost);
        self.unanswered_since.remove(&lost);
        self.notified.remove(&lost);
        self.requested_tick = None;
        self.assign_workers();
    }

    /// Returns the place of an NPC, if it exists, at its worker.
    pub(super) fn leave_worker(&mut self, id: NpcId) {
        let Some(record) = self.records.get(&id) else { return };
        if let Some(worker) = record.worker {
            self.outbox.entry(worker).or_default().release(id);
        }
        // During a hand-over, the place is at the next worker.
        if let Some(holder) = record.next_worker.or(record.worker) {
            self.registry.release(holder);
        }
    }

    /// Removes all NPCs when the world ends, which returns their places.
    pub fn release_all(&mut self) {
        let ids: Vec<NpcId> = self.records.keys().copied().collect();
        for id in ids {
            // Cannot fail: all ids are from the records.
            let _ = self.despawn(id);
        }
        self.flush();
        for worker in std::mem::take(&mut self.notified) {
            self.registry.send_or_cut(worker, ToWorker::Over(self.id));
        }
    }

    /// Sends the pending messages to workers.
    pub fn flush(&mut self) {
        for (worker, Outbox { released, assigned, ended, tagged }) in std::mem::take(&mut self.outbox) {
            if !released.is_empty() {
                self.registry.send_or_cut(worker, ToWorker::Release(self.id, released));
            }
            if !assigned.is_empty() {
                self.notified.insert(worker);
                for assignment in self.assignments(assigned) {
                    self.registry.send_or_cut(worker, ToWorker::Assignment(assignment));
                }
            }
            if !ended.is_empty() {
                self.registry.send_or_cut(worker, ToWorker::Ended(self.id, ended));
            }
            if !tagged.is_empty() {
                let (world, tags) = (self.id, self.tags_of(tagged));
                self.registry.send_or_cut(worker, ToWorker::ZonesChanged { world, zones: None, tags });
            }
        }
    }
}

impl HostedWorld {
    /// The assignments of NPCs to a worker, one for each body.
    fn assignments(&self, npcs: BTreeSet<NpcId>) -> impl Iterator<Item = Assignment> {
        let mut by_body: BTreeMap<u8, Vec<NpcId>> = BTreeMap::new();
        for id in npcs {
            // Assignments of removed NPCs were withdrawn.
            let Some(npc) = self.records.get(&id).and_then(|record| self.world.npc(record.slot)) else { continue };
            by_body.entry(npc.profile.0).or_default().push(id);
        }
        let map = self.world.map();
        by_body.into_iter().map(|(body, npcs)| Assignment {
            world: self.id,
            spec: map.spec().copied(),
            map_hash: map.built_hash(),
            pieces: map.pieces().to_vec(),
            mode: self.mode,
            solid_npcs: self.has_solid_npcs(),
            zones: self.zones().cloned().collect(),
            tags: self.tags_of(npcs.iter().copied()),
            npcs,
            body: (ProfileIdx(body), self.bodies()[usize::from(body)].clone()),
        })
    }
}

/// Moves an NPC to its next worker, if it has one.
pub(super) fn hand_over(
    outbox: &mut BTreeMap<WorkerId, Outbox>,
    id: NpcId,
    worker: &mut Option<WorkerId>,
    next: &mut Option<WorkerId>,
) {
    let Some(next) = next.take() else { return };
    if let Some(old) = worker.replace(next) {
        outbox.entry(old).or_default().release(id);
    }
    outbox.entry(next).or_default().assign(id);
}
