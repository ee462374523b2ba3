//! Which worker decides for which NPC: assignment, hand-over, loss, and notifying workers.

use super::outbox::Outbox;
use super::world::HostedWorld;
use crate::ids::NpcId;
use crate::ids::WorkerId;
use crate::messages::{Assignment, ToWorker};
use std::collections::BTreeMap;

impl HostedWorld {
    /// Assigns every NPC without a worker to one with room.
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

    /// Hands NPCs over to less loaded workers, each at its next decision, so that no decision is missed.
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

    /// Assigns the NPCs of a lost worker to others.
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
                // The lost worker will not answer: the next worker gets new observations.
                record.awaiting = None;
                hand_over(&mut self.outbox, id, &mut record.worker, &mut record.next_worker);
            }
        }
        self.outbox.remove(&lost);
        self.requested_tick = None;
        self.assign_workers();
    }

    /// Removes all NPCs when the world ends, which gives their places back.
    pub fn release_all(&mut self) {
        let ids: Vec<NpcId> = self.records.keys().copied().collect();
        for id in ids {
            // Cannot fail: all ids are from the records.
            let _ = self.despawn(id);
        }
        self.flush();
    }

    /// Sends the pending messages to workers.
    pub fn flush(&mut self) {
        for (worker, Outbox { released, assigned, ended }) in std::mem::take(&mut self.outbox) {
            if !released.is_empty() {
                self.registry.send(worker, ToWorker::Release(self.id, released));
            }
            if !assigned.is_empty() {
                let map = self.world.map();
                let assignment = Assignment {
                    world: self.id,
                    spec: map.spec().copied(),
                    map_hash: map.hash(),
                    mode: self.mode,
                    npcs: assigned,
                };
                self.registry.send(worker, ToWorker::Assignment(assignment));
            }
            if !ended.is_empty() {
                self.registry.send(worker, ToWorker::Ended(self.id, ended));
            }
        }
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
        outbox.entry(old).or_default().released.push(id);
    }
    outbox.entry(next).or_default().assigned.push(id);
}
