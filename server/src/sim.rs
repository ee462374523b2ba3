//! A simulation thread: owns several worlds, holds 60 Hz for the realtime ones, steps the others when ready.

use crate::hosted::{HostedWorld, TimeMode};
use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};
use surefoot_proto::world::v1::WatchWorldResponse;
use surefoot_world::TICKS_PER_SECOND;
use tokio::sync::{oneshot, watch};
use tonic::Status;

/// Calls waiting for a thread; one more is refused with RESOURCE_EXHAUSTED.
const INBOX: usize = 4096;
/// Ticks that are made up for after a stall; the rest of the lost time is dropped and counted.
const MAX_CATCH_UP: u32 = 2;
/// How long a thread with nothing to do waits for a call.
const IDLE: Duration = Duration::from_millis(50);

type Call = Box<dyn FnOnce(&mut Sim) + Send>;

/// A world with the watchers of its snapshots.
#[derive(Debug)]
pub struct Seat {
    /// The world.
    pub world: HostedWorld,
    /// Latest snapshot; old ones are overwritten, so slow readers cost nothing.
    pub snapshots: watch::Sender<WatchWorldResponse>,
}

/// What a simulation thread owns.
#[derive(Debug, Default)]
pub struct Sim {
    /// Worlds by id.
    pub seats: BTreeMap<u64, Seat>,
}

/// The way to a simulation thread. It ends when all handles are gone.
#[derive(Debug, Clone)]
pub struct SimHandle {
    inbox: SyncSender<Call>,
}

impl SimHandle {
    /// Starts a thread.
    ///
    /// # Errors
    /// If the system refuses one.
    pub fn start(name: String) -> std::io::Result<Self> {
        let (inbox, calls) = sync_channel(INBOX);
        std::thread::Builder::new().name(name).spawn(move || run(&calls))?;
        Ok(Self { inbox })
    }

    /// Runs `call` on the thread between two ticks, without waiting for it.
    ///
    /// # Errors
    /// RESOURCE_EXHAUSTED if too many calls are waiting, UNAVAILABLE if the thread is gone.
    pub fn cast(&self, call: impl FnOnce(&mut Sim) + Send + 'static) -> Result<(), Status> {
        self.inbox.try_send(Box::new(call)).map_err(|error| match error {
            TrySendError::Full(_) => {
                Status::resource_exhausted(format!("{INBOX} calls are waiting already: try again"))
            }
            TrySendError::Disconnected(_) => Status::unavailable("the simulation has stopped"),
        })
    }

    /// Runs `call` on the thread between two ticks and returns its result.
    ///
    /// # Errors
    /// As [`SimHandle::cast`].
    pub async fn call<R: Send + 'static>(
        &self,
        call: impl FnOnce(&mut Sim) -> R + Send + 'static,
    ) -> Result<R, Status> {
        let (reply, result) = oneshot::channel();
        self.cast(move |sim| {
            // Whoever asked may have gone away in the meantime.
            let _ = reply.send(call(sim));
        })?;
        result.await.map_err(|_| Status::unavailable("the simulation has stopped"))
    }
}

fn run(calls: &Receiver<Call>) {
    let period = Duration::from_secs(1) / TICKS_PER_SECOND;
    let mut sim = Sim::default();
    let mut next_tick = Instant::now();
    loop {
        for _ in 0..INBOX {
            match calls.try_recv() {
                Ok(call) => call(&mut sim),
                Err(_) => break,
            }
        }
        let now = Instant::now();
        if !sim.has(TimeMode::Realtime) {
            next_tick = now + period;
        } else if now >= next_tick {
            next_tick += sim.drop_lost_time(now - next_tick, period);
            sim.step_realtime();
            next_tick += period;
            continue;
        }
        if sim.step_lockstep() {
            continue;
        }
        let wait = next_tick.saturating_duration_since(Instant::now()).min(IDLE);
        match calls.recv_timeout(wait) {
            Ok(call) => call(&mut sim),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

impl Sim {
    fn has(&self, mode: TimeMode) -> bool {
        self.seats.values().any(|seat| seat.world.mode() == mode)
    }

    /// How far the schedule moves on because it is `late` by more than can be caught up.
    fn drop_lost_time(&mut self, late: Duration, period: Duration) -> Duration {
        let ticks_late = (late.as_nanos() / period.as_nanos()) as u32;
        let dropped = ticks_late.saturating_sub(MAX_CATCH_UP);
        if dropped > 0 {
            for seat in self.seats.values_mut().filter(|seat| seat.world.mode() == TimeMode::Realtime) {
                seat.world.note_dropped(u64::from(dropped));
            }
        }
        period * dropped
    }

    fn step_realtime(&mut self) {
        for seat in self.seats.values_mut().filter(|seat| seat.world.mode() == TimeMode::Realtime) {
            seat.step();
        }
    }

    /// Steps every lockstep world that is ready; false if none was.
    fn step_lockstep(&mut self) -> bool {
        let mut stepped = false;
        for seat in self.seats.values_mut().filter(|seat| seat.world.mode() == TimeMode::Lockstep) {
            if seat.world.is_ready() {
                seat.step();
                stepped = true;
            }
        }
        stepped
    }
}

impl Seat {
    fn step(&mut self) {
        let started = Instant::now();
        self.world.step();
        self.world.note_duration(started.elapsed().as_secs_f32() * 1.0e6);
        self.publish();
    }

    /// Replaces the latest snapshot if anyone watches.
    pub fn publish(&self) {
        if self.snapshots.receiver_count() > 0 {
            self.snapshots.send_replace(self.world.snapshot());
        }
    }
}
