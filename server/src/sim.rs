//! A world's thread: steps it at 60 Hz on an absolute schedule, or whenever all answers are in.
//!
//! One thread per world (ADR 16): a world that stalls or is slow to step cannot hold another up.

use crate::errors::{INBOX, SimError};
use crate::hosted::{HostedWorld, Snapshot, TimeMode};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};
use surefoot_world::TICKS_PER_SECOND;
use tokio::sync::{oneshot, watch};

/// Ticks that are made up for after a stall; the rest of the lost time is dropped and counted.
const MAX_CATCH_UP: u32 = 2;
/// How long a thread with nothing to do waits for a call.
const IDLE: Duration = Duration::from_millis(50);
/// Ticks from one look for NPCs without a worker to the next.
const ASSIGN_EVERY: u64 = 30;

type Call = Box<dyn FnOnce(&mut SimState) + Send>;

/// A world with the watchers of its snapshots.
#[derive(Debug)]
pub struct SimState {
    /// The world.
    pub world: HostedWorld,
    /// Latest snapshot; old ones are overwritten, so slow readers cost nothing.
    pub snapshots: watch::Sender<Arc<Snapshot>>,
    /// Sequence number of the latest event: those who watch read the world's log when it grows.
    pub latest_event: watch::Sender<u64>,
    /// Set to end the thread.
    pub is_over: bool,
}

/// The way to a world's thread. The thread ends, and gives the NPCs' places back, when told to or when all handles are gone.
#[derive(Debug, Clone)]
pub struct SimHandle {
    inbox: SyncSender<Call>,
}

impl SimHandle {
    /// Starts the thread of a world. `phase`, in [0, 1), is when within a period its ticks are due: worlds that differ in it do not
    /// all wake at once.
    ///
    /// # Errors
    /// If the system refuses a thread.
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
    /// If too many calls are waiting, or the thread is gone.
    pub fn cast(&self, call: impl FnOnce(&mut SimState) + Send + 'static) -> Result<(), SimError> {
        self.inbox.try_send(Box::new(call)).map_err(|error| match error {
            TrySendError::Full(_) => SimError::Busy,
            TrySendError::Disconnected(_) => SimError::Stopped,
        })
    }

    /// Runs `call` on the thread between two ticks and returns its result.
    ///
    /// # Errors
    /// As [`SimHandle::cast`].
    pub async fn call<R: Send + 'static>(
        &self,
        call: impl FnOnce(&mut SimState) -> R + Send + 'static,
    ) -> Result<R, SimError> {
        let (reply, result) = oneshot::channel();
        self.cast(move |state| {
            // The caller may have gone away in the meantime.
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

/// Takes calls until `due`; false if the world is over.
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
            // Nothing but a call can make it ready.
            due += IDLE;
        }
    }
}

impl SimState {
    /// Replaces the latest snapshot if anyone watches, and notifies of new events.
    pub fn publish(&self) {
        if self.snapshots.receiver_count() > 0 {
            self.snapshots.send_replace(Arc::new(self.world.snapshot()));
        }
        self.notify_events();
    }

    /// Wakes those who wait for events, if there are new ones.
    fn notify_events(&self) {
        let latest = self.world.events().latest();
        self.latest_event.send_if_modified(|known| std::mem::replace(known, latest) != latest);
    }
}
