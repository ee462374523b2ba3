//! The thread of a world, which steps it at 60 Hz on an absolute schedule (realtime) or as soon as all answers are in (lockstep).
//!
//! There is one thread per world (ADR 16), so that a world that stalls or steps slowly cannot delay another.

use crate::errors::SimError;
use crate::hosted::{HostedWorld, Snapshot, TimeMode};
use crate::inbox::{Inbox, Lane, Popped};
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};
use surefoot_world::TICKS_PER_SECOND;
use tokio::sync::{oneshot, watch};
use tracing::error;

/// Most ticks to catch up after a stall; further ticks are dropped and counted.
const MAX_CATCH_UP: u32 = 2;
/// Time for calls in each tick, also if the world is behind. Time that is left until the next tick comes on top.
const CALL_TIME: Duration = Duration::from_millis(2);
/// How long a lockstep world that cannot be stepped waits for a call before it looks for silent workers.
const IDLE: Duration = Duration::from_millis(50);

type Call = Box<dyn FnOnce(&mut SimState) + Send>;

/// A world with the channels to its readers; owned by the world's thread.
#[derive(Debug)]
pub struct SimState {
    /// The world that the thread steps.
    pub world: HostedWorld,
    /// Latest snapshot; each overwrites the one before, so slow readers cost nothing.
    pub snapshots: watch::Sender<Arc<Snapshot>>,
    /// Sequence number of the latest event; when it grows, readers fetch the events from the world's log.
    pub latest_event: watch::Sender<u64>,
    /// Whether the thread is to end.
    pub is_over: bool,
}

/// Access to a world's thread. The thread ends, and releases the workers of its NPCs, when [`SimState::is_over`] is set or all handles
/// are gone.
#[derive(Debug, Clone)]
pub struct SimHandle {
    inbox: Arc<OpenInbox>,
    lane: Lane,
}

/// Closed when the last handle goes.
struct OpenInbox(Arc<Inbox<Call>>);

impl fmt::Debug for OpenInbox {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("OpenInbox")
    }
}

impl Drop for OpenInbox {
    fn drop(&mut self) {
        self.0.close();
    }
}

impl SimHandle {
    /// Starts the thread of a world. `phase`, in [0, 1), is when within a period its ticks are due: worlds that differ in it do not
    /// all wake at once. `failed` is called if the world panics.
    ///
    /// # Errors
    /// If the system refuses a thread.
    pub fn start(
        name: String,
        world: HostedWorld,
        phase: f64,
        failed: impl FnOnce() + Send + 'static,
    ) -> std::io::Result<Self> {
        let inbox = Arc::new(Inbox::default());
        let calls = inbox.clone();
        let state = SimState {
            world,
            snapshots: watch::Sender::default(),
            latest_event: watch::Sender::new(0),
            is_over: false,
        };
        std::thread::Builder::new().name(name).spawn(move || {
            run(state, &calls, phase, failed);
            // Callers that still wait learn that the world has stopped.
            calls.abandon();
        })?;
        Ok(Self { inbox: Arc::new(OpenInbox(inbox)), lane: Lane::Urgent })
    }

    /// A handle whose calls wait in the lane of a client.
    pub fn for_client(self, client: &Arc<str>) -> Self {
        Self { lane: Lane::Client(client.clone()), ..self }
    }

    /// Runs `call` on the thread between two ticks, without waiting for it.
    ///
    /// # Errors
    /// If too many calls are waiting, or the thread has ended.
    pub fn cast(&self, call: impl FnOnce(&mut SimState) + Send + 'static) -> Result<(), SimError> {
        self.inbox.0.push(&self.lane, Box::new(call))
    }

    /// Runs `call` on the thread between two ticks and returns its result.
    ///
    /// # Errors
    /// Those of [`SimHandle::cast`].
    pub async fn call<R: Send + 'static>(
        &self,
        call: impl FnOnce(&mut SimState) -> R + Send + 'static,
    ) -> Result<R, SimError> {
        let (reply, result) = oneshot::channel();
        self.cast(move |state| {
            // The caller may no longer wait for the result.
            let _ = reply.send(call(state));
        })?;
        result.await.map_err(|_| SimError::Stopped)
    }
}

fn run(mut state: SimState, calls: &Inbox<Call>, phase: f64, failed: impl FnOnce()) {
    let stepped = catch_unwind(AssertUnwindSafe(|| match state.world.mode() {
        TimeMode::Realtime => run_realtime(&mut state, calls, phase),
        TimeMode::Lockstep => run_lockstep(&mut state, calls),
    }));
    if stepped.is_err() {
        error!(world_id = state.world.id().0, "the world panicked and has ended");
        failed();
    }
    // After a panic the state may be inconsistent: what cannot be released then is lost with the worker's connection.
    let _ = catch_unwind(AssertUnwindSafe(|| state.world.release_all()));
}

/// Runs calls until `due`, at least for [`CALL_TIME`] if that many wait; false if the world is over.
fn run_calls(state: &mut SimState, calls: &Inbox<Call>, due: Instant) -> bool {
    let limit = due.max(Instant::now() + CALL_TIME);
    while !state.is_over {
        match calls.pop(due) {
            Popped::Item(call) => {
                call(state);
                state.notify_events();
            }
            Popped::Nothing => return true,
            Popped::Closed => return false,
        }
        // A flood of calls must not keep the world from stepping.
        if Instant::now() >= limit {
            return !state.is_over;
        }
    }
    false
}

fn run_realtime(state: &mut SimState, calls: &Inbox<Call>, phase: f64) {
    let period = Duration::from_secs(1) / TICKS_PER_SECOND;
    let mut due = Instant::now() + period.mul_f64(phase);
    while run_calls(state, calls, due) {
        let behind = (due.elapsed().as_nanos() / period.as_nanos()) as u32;
        let dropped = behind.saturating_sub(MAX_CATCH_UP);
        due += period * dropped;
        state.world.note_dropped(u64::from(dropped));
        state.world.step();
        let took = due.elapsed();
        state.world.note_tick(took, took > period);
        state.publish();
        due += period;
    }
}

fn run_lockstep(state: &mut SimState, calls: &Inbox<Call>) {
    while run_calls(state, calls, Instant::now()) {
        let started = Instant::now();
        if state.world.is_ready() {
            state.world.step();
            state.world.note_tick(started.elapsed(), false);
            state.publish();
            continue;
        }
        // Nothing but a call can make it ready.
        match calls.pop(started + IDLE) {
            Popped::Item(call) => {
                call(state);
                state.notify_events();
            }
            Popped::Nothing => state.world.note_waiting(IDLE),
            Popped::Closed => return,
        }
    }
}

impl SimState {
    /// Replaces the latest snapshot if there are readers, and notifies readers of new events.
    pub fn publish(&self) {
        if self.snapshots.receiver_count() > 0 {
            self.snapshots.send_replace(Arc::new(self.world.snapshot()));
        }
        self.notify_events();
    }

    /// Wakes readers that wait for events, if there are new ones.
    fn notify_events(&self) {
        let latest = self.world.events().latest();
        self.latest_event.send_if_modified(|known| std::mem::replace(known, latest) != latest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hosted::SpawnOrder;
    use crate::ids::WorldId;
    use crate::quota::Quota;
    use crate::registry::Registry;
    use surefoot_world::{Map, MapSpec, Vec3};
    use tokio::sync::mpsc::channel;

    #[tokio::test]
    async fn a_world_that_panics_releases_its_workers_and_answers_that_it_has_stopped() {
        let registry = Arc::new(Registry::default());
        let (queue, _messages) = channel(64);
        registry.join("test".to_owned(), "none".to_owned(), 8, queue);
        let map = Arc::new(Map::generate(&MapSpec::with_side(1, 50).unwrap()));
        let world = HostedWorld::new(WorldId(1), map, TimeMode::Realtime, registry.clone());
        let (failed, has_failed) = oneshot::channel();
        let sim = SimHandle::start("test".to_owned(), world, 0.0, || _ = failed.send(())).unwrap();
        let ticket = Quota::new(8, "NPCs").grant("test");
        let order = SpawnOrder { position: Vec3::new(25.0, 40.0, 25.0), yaw: 0.0, goal: None, body: None };
        sim.call(move |state| state.world.spawn_to(order, 8, ticket)).await.unwrap().unwrap();
        assert_eq!(registry.load()[0].npc_count, 1);
        let panicked = sim.call(|_| -> () { panic!("a test's panic") }).await;
        assert_eq!(panicked, Err(SimError::Stopped));
        has_failed.await.unwrap();
        // The inbox closes after the release.
        while sim.cast(|_| {}) != Err(SimError::Stopped) {
            tokio::task::yield_now().await;
        }
        assert_eq!(registry.load()[0].npc_count, 0);
    }
}
