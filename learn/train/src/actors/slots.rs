//! Places for actors, and what each of them has fed.

use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, MutexGuard};

/// Places for a number of actors; clones share them.
#[derive(Debug, Clone)]
pub(crate) struct Slots(Arc<Mutex<Inner>>);

#[derive(Debug)]
struct Inner {
    slots: Vec<Slot>,
    last_session: u64,
}

/// The place of one actor.
#[derive(Debug, Clone, Default)]
struct Slot {
    state: SlotState,
    /// The connection of the actor, if it is there.
    session: Option<u64>,
}

/// Who had a place, and what was taken from them.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct SlotState {
    /// Empty for a place that nobody ever had.
    actor_id: String,
    /// Number of the last step that was taken.
    taken: u64,
}

/// A connection of an actor to its place. The place is free again when it is dropped.
#[derive(Debug)]
pub(crate) struct Seat {
    slots: Slots,
    session: u64,
    /// Index of the place.
    pub slot_idx: usize,
    /// Number of the last step that was taken from this actor before.
    pub taken: u64,
    /// Whether somebody else had the place before.
    pub is_handed_on: bool,
}

/// What to do with a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// It continues the one before.
    Next,
    /// Steps between it and the last one are missing.
    AfterGap,
    /// It was taken before.
    Repeated,
    /// The actor has connected again; this connection is of no use any more.
    Superseded,
}

impl Slots {
    /// `count` places, some of which may have been taken before.
    pub fn new(count: usize, mut saved: Vec<SlotState>) -> Self {
        saved.resize(count, SlotState::default());
        let slots = saved.into_iter().map(|state| Slot { state, session: None }).collect();
        Self(Arc::new(Mutex::new(Inner { slots, last_session: 0 })))
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().expect("no holder panics")
    }

    /// Who has which place.
    pub fn save(&self) -> Vec<SlotState> {
        self.inner().slots.iter().map(|slot| slot.state.clone()).collect()
    }

    /// Gives an actor the place that it had, a free one, or one whose actor is gone; `None` if there is none.
    pub fn join(&self, actor_id: &str) -> Option<Seat> {
        let mut inner = self.inner();
        let find = |is_wanted: &dyn Fn(&Slot) -> bool| inner.slots.iter().position(is_wanted);
        let known = find(&|slot| slot.state.actor_id == actor_id);
        let slot_idx = known
            .or_else(|| find(&|slot| slot.state.actor_id.is_empty()))
            .or_else(|| find(&|slot| slot.session.is_none()))?;
        inner.last_session += 1;
        let session = inner.last_session;
        let slot = &mut inner.slots[slot_idx];
        let is_handed_on = known.is_none() && !slot.state.actor_id.is_empty();
        if known.is_none() {
            slot.state = SlotState { actor_id: actor_id.to_owned(), taken: 0 };
        }
        slot.session = Some(session);
        let taken = slot.state.taken;
        Some(Seat { slots: self.clone(), session, slot_idx, taken, is_handed_on })
    }
}

impl Seat {
    /// Notes the arrival of a step, which counts as taken from then on.
    pub fn take(&self, number: u64) -> Verdict {
        let mut inner = self.slots.inner();
        let slot = &mut inner.slots[self.slot_idx];
        if slot.session != Some(self.session) {
            return Verdict::Superseded;
        }
        if number <= slot.state.taken {
            return Verdict::Repeated;
        }
        let before = std::mem::replace(&mut slot.state.taken, number);
        if number == before + 1 { Verdict::Next } else { Verdict::AfterGap }
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        let mut inner = self.slots.inner();
        let slot = &mut inner.slots[self.slot_idx];
        if slot.session == Some(self.session) {
            slot.session = None;
        }
    }
}
