//! Slots for actors, and the number of steps taken from each.

use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, MutexGuard};

/// Slots for a number of actors; clones share them.
#[derive(Debug, Clone)]
pub(crate) struct Slots(Arc<Mutex<Inner>>);

#[derive(Debug)]
struct Inner {
    slots: Vec<Slot>,
    last_session: u64,
}

/// The slot of one actor.
#[derive(Debug, Clone, Default)]
struct Slot {
    state: SlotState,
    /// The actor's current session; `None` while it is disconnected.
    session: Option<u64>,
}

/// The actor of a slot, and how many of its steps were taken.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct SlotState {
    /// Empty for a slot that was never used.
    actor_id: String,
    /// Number of the last step that was taken.
    taken: u64,
}

/// An actor's session in its slot. Dropping it frees the slot.
#[derive(Debug)]
pub(crate) struct ActorSession {
    slots: Slots,
    session: u64,
    /// Index of the slot.
    pub slot_idx: usize,
    /// Number of the last step that was taken from this actor.
    pub taken: u64,
    /// Whether another actor had the slot before.
    pub is_reassigned: bool,
}

/// How a step follows the previous one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum StepOrder {
    /// It continues the previous step.
    Next,
    /// Steps before it are missing.
    AfterGap,
    /// It was taken before.
    Repeated,
    /// The actor has connected again, so this session is over.
    Replaced,
}

impl Slots {
    /// `count` slots, some with a saved state.
    pub fn new(count: usize, mut saved: Vec<SlotState>) -> Self {
        saved.resize(count, SlotState::default());
        let slots = saved.into_iter().map(|state| Slot { state, session: None }).collect();
        Self(Arc::new(Mutex::new(Inner { slots, last_session: 0 })))
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().expect("no holder panics")
    }

    /// Returns the state to save.
    pub fn save(&self) -> Vec<SlotState> {
        self.inner().slots.iter().map(|slot| slot.state.clone()).collect()
    }

    /// Gives an actor its previous slot, an unused one, or one of a disconnected actor; `None` if all are in use.
    pub fn join(&self, actor_id: &str) -> Option<ActorSession> {
        let mut inner = self.inner();
        let find = |is_wanted: &dyn Fn(&Slot) -> bool| inner.slots.iter().position(is_wanted);
        let known = find(&|slot| slot.state.actor_id == actor_id);
        let slot_idx = known
            .or_else(|| find(&|slot| slot.state.actor_id.is_empty()))
            .or_else(|| find(&|slot| slot.session.is_none()))?;
        inner.last_session += 1;
        let session = inner.last_session;
        let slot = &mut inner.slots[slot_idx];
        let is_reassigned = known.is_none() && !slot.state.actor_id.is_empty();
        if known.is_none() {
            slot.state = SlotState { actor_id: actor_id.to_owned(), taken: 0 };
        }
        slot.session = Some(session);
        let taken = slot.state.taken;
        Some(ActorSession { slots: self.clone(), session, slot_idx, taken, is_reassigned })
    }
}

impl ActorSession {
    /// Counts a step as taken, unless it was taken before.
    pub fn take(&self, number: u64) -> StepOrder {
        let mut inner = self.slots.inner();
        let slot = &mut inner.slots[self.slot_idx];
        if slot.session != Some(self.session) {
            return StepOrder::Replaced;
        }
        if number <= slot.state.taken {
            return StepOrder::Repeated;
        }
        let before = std::mem::replace(&mut slot.state.taken, number);
        if number == before + 1 { StepOrder::Next } else { StepOrder::AfterGap }
    }
}

impl Drop for ActorSession {
    fn drop(&mut self) {
        let mut inner = self.slots.inner();
        let slot = &mut inner.slots[self.slot_idx];
        if slot.session == Some(self.session) {
            slot.session = None;
        }
    }
}
