//! The thread of a world, which steps it at 60 Hz on an absolute schedule (realtime) or as soon as all answers are in (lockstep).
//!
//! There is one thread per world (ADR 16), so that a world that stalls or steps slowly cannot delay another.

use crate::errors::{INBOX, SimError};
use crate::hosted::{HostedWorld, Snapshot, TimeMode};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};
use surefoot_world::TICKS_PER_SECOND;
use tokio::sync::{oneshot, watch};

/// Most ticks to catch up after a stall; further ticks are dropped and counted.
const MAX_CATCH_UP: u32 = 2;
/// How long a lockstep world that is not ready waits for a call, and how long calls may delay a due tick.
const IDLE: Duration = Duration::from_millis(50);
/// Ticks between two attempts to assign workers to NPCs without one.
const ASSIGN_EVERY: u64 = 30;

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

/// A handle to a world's thread. The thread ends when `is_over` is set or all handles are dropped; it then removes the NPCs,
/// which gives their places back.
#[derive(Debug, Clone)]
pub struct SimHandle {
    inbox: SyncSender<Call>,
}

impl SimHandle {
    /// Starts the thread of a world. `phase`, in [0, 1), is the fraction of a period at which ticks are due, so that worlds do
    /// not all wake at the same time.
    ///
    /// # Errors
    /// If the system cannot create a thread.
    pub fn start(name: String, world: HostedWorld, phase: f64) -> std::io::Result<Self> {
        let (inbox, calls) = sync_channel(INBOX);
        let state = SimState {
            world,
            snapshots: watch::Sender::default(),
            latest_event: watch::Sender::new(0),
            is_over: false,
        };
        std::thread::Builder::new().name(name).spawn(move || run(state, &calls, phase))?;
        Ok(Self { inbox })
    }

    /// Runs `call` on the thread between two ticks, without waiting for it.
    ///
    /// # Errors
    /// If too many calls are waiting, or the thread has ended.
    pub fn cast(&self, call: impl FnOnce(&mut SimState) + Send + 'static) -> Result<(), SimError> {
        self.inbox.try_send(Box::new(call)).map_err(|error| match error {
            TrySendError::Full(_) => SimError::Busy,
            TrySendError::Disconnected(_) => SimError::Stopped,
        })
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

fn run(mut state: SimState, calls: &Receiver<Call>, phase: f64) {
    match state.world.mode() {
        TimeMode::Realtime => run_realtime(&mut state, calls, phase),
        TimeMode::Lockstep => run_lockstep(&mut state, calls),
    }
    state.world.release_all();
}

/// Runs calls until `due`; returns false if the world is over.
fn run_calls(state: &mut SimState, calls: &Receiver<Call>, due: Instant) -> bool {
    while !state.is_over {
        let left = due.saturating_duration_since(Instant::now());
        match calls.recv_timeout(left) {
            Ok(call) => {
                call(state);
                state.notify_events();
            }
            Err(RecvTimeoutError::Timeout) => return true,
            Err(RecvTimeoutError::Disconnected) => return false,
        }
        // A flood of calls must not keep the world from stepping.
        if due.elapsed() > IDLE {
            return !state.is_over;
        }
    }
    false
}

fn run_realtime(state: &mut SimState, calls: &Receiver<Call>, phase: f64) {
    let period = Duration::from_secs(1) / TICKS_PER_SECOND;
    let mut due = Instant::now() + period.mul_f64(phase);
    while run_calls(state, calls, due) {
        let behind = (due.elapsed().as_nanos() / period.as_nanos()) as u32;
        let dropped = behind.saturating_sub(MAX_CATCH_UP);
        due += period * dropped;
        state.world.note_dropped(u64::from(dropped));
        if state.world.tick().0.is_multiple_of(ASSIGN_EVERY) {
            state.world.assign_workers();
        }
        state.world.step();
        let took = due.elapsed();
        state.world.note_tick(took, took > period);
        state.publish();
        due += period;
    }
}

fn run_lockstep(state: &mut SimState, calls: &Receiver<Call>) {
    let mut due = Instant::now();
    while run_calls(state, calls, due) {
        due = Instant::now();
        if state.world.is_ready() {
            state.world.step();
            let took = due.elapsed();
            state.world.note_tick(took, false);
            state.publish();
        } else {
            // Only a call can make the world ready.
            due += IDLE;
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
