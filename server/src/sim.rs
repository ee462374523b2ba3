//! The thread of a world. It steps the world at 60 Hz on an absolute schedule (realtime), or when all answers have
//! arrived (lockstep).
//!
//! There is one thread per world (ADR 16), so that a slow or stalled world cannot delay another.

use crate::figures::WorldFigures;
use crate::hosted::{HostedWorld, KEPT_EVENTS, NpcEvent, Poses, Snapshot, TimeMode};
pub use crate::inbox::SimError;
use crate::inbox::{CallQueue, Inbox, Popped};
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use surefoot_world::TICKS_PER_SECOND;
use tokio::sync::{broadcast, oneshot, watch};
use tracing::error;

/// Most ticks to catch up after a stall; further ticks are dropped and counted.
const MAX_CATCH_UP: u32 = 2;
/// Least time for calls in each tick, even if the world is behind.
const CALL_TIME: Duration = Duration::from_millis(2);
/// How long a lockstep world that cannot be stepped waits for a call before it checks for silent workers.
const IDLE: Duration = Duration::from_millis(50);

/// Batches of events that wait for a reader: about a second of ticks. A reader that is farther behind reads the world's
/// log.
const EVENT_BATCHES: usize = 64;
/// Most events of a batch, so that all batches together have no more events than the log.
const EVENTS_IN_A_BATCH: usize = KEPT_EVENTS / EVENT_BATCHES;
/// Ticks whose poses wait for a reader: about a second. A reader that is farther behind misses the oldest.
const WAITING_POSES: usize = 64;

/// Time from one tick to the next.
const PERIOD: Duration = Duration::from_nanos(1_000_000_000 / TICKS_PER_SECOND as u64);

/// When the ticks of a realtime world are due. Worlds with different phases do not wake at the same time.
#[derive(Debug, Clone, Copy)]
pub struct Schedule {
    /// When the first period of all worlds began.
    pub epoch: Instant,
    /// When within a period a tick is due, in [0, 1).
    pub phase: f64,
}

impl Schedule {
    /// The first tick after `now`, which is not before the epoch.
    fn first_after(self, now: Instant) -> Instant {
        let periods = now.duration_since(self.epoch).as_nanos() / PERIOD.as_nanos() + 1;
        self.epoch + Duration::from_nanos(PERIOD.as_nanos() as u64 * periods as u64) + PERIOD.mul_f64(self.phase)
    }

    /// The phase that is farthest from all of `phases`.
    pub fn free_phase(phases: impl Iterator<Item = f64>) -> f64 {
        let mut phases: Vec<f64> = phases.collect();
        phases.sort_by(f64::total_cmp);
        let Some(&first) = phases.first() else { return 0.0 };
        let next = phases.iter().skip(1).copied().chain([first + 1.0]);
        let gaps = phases.iter().zip(next).map(|(&phase, next)| (next - phase, phase));
        let (gap, phase) = gaps.fold((0.0, 0.0), |widest, gap| if gap.0 > widest.0 { gap } else { widest });
        (phase + 0.5 * gap).fract()
    }
}

type Call = Box<dyn FnOnce(&mut SimState) + Send>;

/// Resolves when a change is durable in the store of the fleet.
#[derive(Debug)]
pub struct Receipt {
    sequence: u64,
    confirmed: watch::Receiver<u64>,
}

impl Receipt {
    /// Waits until the change is durable.
    pub async fn confirmed(mut self) -> Result<(), SimError> {
        let result = self.confirmed.wait_for(|latest| *latest >= self.sequence).await;
        result.map(drop).map_err(|_| SimError::Stopped)
    }
}

/// Events of a world that follow one another.
#[derive(Debug)]
pub struct EventBatch {
    /// Sequence number before the first event. A reader with a smaller number has missed a batch.
    pub after: u64,
    pub events: Vec<NpcEvent>,
}

/// A world with the channels to its readers; owned by the world's thread.
#[derive(Debug)]
pub struct SimState {
    pub world: HostedWorld,
    /// Latest snapshot. Each overwrites the previous one, so slow readers cost nothing.
    pub snapshots: watch::Sender<Arc<Snapshot>>,
    /// Poses of every tick.
    pub poses: broadcast::Sender<Arc<Poses>>,
    /// New events that readers may see, once a tick.
    pub events: broadcast::Sender<Arc<EventBatch>>,
    /// Sequence number of the last event that was sent to readers.
    published: u64,
    /// Sequence number of the latest event that readers may see, for callers that wait for a receipt.
    latest_event: watch::Sender<u64>,
    figures: watch::Sender<Arc<WorldFigures>>,
    /// Calls that the thread has run.
    calls: u64,
    /// Whether the thread is to end.
    pub is_over: bool,
}

/// Access to a world's thread. The thread ends, and releases the workers of its NPCs, when [`SimState::is_over`] is set
/// or all handles are dropped.
#[derive(Debug, Clone)]
pub struct SimHandle {
    inbox: Arc<OpenInbox>,
    queue: CallQueue,
    figures: watch::Receiver<Arc<WorldFigures>>,
}

/// Closes the inbox when the last handle is dropped.
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
    /// Starts the thread of a world. `failed` is called if the world panics.
    pub fn start(
        name: String,
        world: HostedWorld,
        schedule: Schedule,
        failed: impl FnOnce() + Send + 'static,
    ) -> std::io::Result<Self> {
        let inbox = Arc::new(Inbox::default());
        let calls = inbox.clone();
        let state = SimState::new(world);
        let figures = state.figures.subscribe();
        std::thread::Builder::new().name(name).spawn(move || {
            run(state, &calls, schedule, failed);
            // Waiting callers get the error `Stopped`.
            calls.abandon();
        })?;
        Ok(Self { inbox: Arc::new(OpenInbox(inbox)), queue: CallQueue::Urgent, figures })
    }

    /// A handle whose calls wait in the queue of a client.
    pub fn for_client(self, client: &Arc<str>) -> Self {
        Self { queue: CallQueue::Client(client.clone()), ..self }
    }

    /// The world's figures after its latest tick. Does not wait for the thread.
    pub fn figures(&self) -> Arc<WorldFigures> {
        self.figures.borrow().clone()
    }

    /// Runs `call` on the thread between two ticks, without waiting for it.
    pub fn cast(&self, call: impl FnOnce(&mut SimState) + Send + 'static) -> Result<(), SimError> {
        self.inbox.0.push(&self.queue, Box::new(call))
    }

    /// Runs `call` on the thread between two ticks and returns its result.
    pub async fn call<R: Send + 'static>(
        &self,
        call: impl FnOnce(&mut SimState) -> R + Send + 'static,
    ) -> Result<R, SimError> {
        let (reply, result) = oneshot::channel();
        self.cast(move |state| {
            // The caller may have stopped waiting.
            let _ = reply.send(call(state));
        })?;
        result.await.map_err(|_| SimError::Stopped)
    }

    /// Like [`SimHandle::call`], if the thread begins the call within `limit`. Otherwise the call is not run at all.
    /// [`SimError::Busy`] means that the call was not run.
    pub async fn call_within<R: Send + 'static>(
        &self,
        limit: Duration,
        call: impl FnOnce(&mut SimState) -> R + Send + 'static,
    ) -> Result<R, SimError> {
        // Set by the thread when it begins the call, or by the caller when it gives up, whichever is first.
        let decided = Arc::new(AtomicBool::new(false));
        let begins = decided.clone();
        let mut answer =
            std::pin::pin!(self.call(move |state| (!begins.swap(true, Ordering::AcqRel)).then(|| call(state))));
        let answer = match tokio::time::timeout(limit, &mut answer).await {
            Ok(answer) => answer,
            Err(_) if !decided.swap(true, Ordering::AcqRel) => return Err(SimError::Busy),
            Err(_) => answer.await,
        };
        answer?.ok_or(SimError::Busy)
    }
}

fn run(mut state: SimState, calls: &Inbox<Call>, schedule: Schedule, failed: impl FnOnce()) {
    let stepped = catch_unwind(AssertUnwindSafe(|| {
        match state.world.mode() {
            TimeMode::Realtime => run_realtime(&mut state, calls, schedule),
            TimeMode::Lockstep => run_lockstep(&mut state, calls),
        }
        // Events of the last calls.
        state.report();
    }));
    if stepped.is_err() {
        error!(world_id = state.world.id().0, "world panicked; it has ended");
        failed();
    }
    // After a panic the state may be inconsistent. NPCs that cannot be released stay with their worker until it leaves.
    let _ = catch_unwind(AssertUnwindSafe(|| state.world.release_all()));
}

/// Runs calls until `due`, and waiting calls for at least [`CALL_TIME`]. Returns false if the world is over.
fn run_calls(state: &mut SimState, calls: &Inbox<Call>, due: Instant) -> bool {
    let limit = due.max(Instant::now() + CALL_TIME);
    while !state.is_over {
        match calls.pop(due) {
            Popped::Item(call) => state.run_call(call),
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

fn run_realtime(state: &mut SimState, calls: &Inbox<Call>, schedule: Schedule) {
    let mut due = schedule.first_after(Instant::now());
    while run_calls(state, calls, due) {
        let behind = (due.elapsed().as_nanos() / PERIOD.as_nanos()) as u32;
        let dropped = behind.saturating_sub(MAX_CATCH_UP);
        due += PERIOD * dropped;
        state.world.note_dropped(u64::from(dropped));
        state.world.step();
        let took = due.elapsed();
        state.world.note_tick(took, took > PERIOD);
        state.publish();
        due += PERIOD;
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
        state.report();
        // Only a call can make it ready.
        match calls.pop(started + IDLE) {
            Popped::Item(call) => state.run_call(call),
            Popped::Nothing => state.world.note_waiting(IDLE),
            Popped::Closed => return,
        }
    }
}

impl SimState {
    fn new(world: HostedWorld) -> Self {
        let latest = world.events().latest();
        let figures = WorldFigures::of(&world, 0, 0);
        Self {
            world,
            snapshots: watch::Sender::default(),
            poses: broadcast::Sender::new(WAITING_POSES),
            events: broadcast::Sender::new(EVENT_BATCHES),
            published: latest,
            latest_event: watch::Sender::new(latest),
            figures: watch::Sender::new(Arc::new(figures)),
            calls: 0,
            is_over: false,
        }
    }

    fn run_call(&mut self, call: Call) {
        call(self);
        self.calls += 1;
        self.notify_events();
    }

    fn publish(&mut self) {
        self.show_snapshot();
        if self.poses.receiver_count() > 0 {
            // The last reader may just have left.
            let _ = self.poses.send(Arc::new(self.world.poses()));
        }
        self.report();
    }

    /// Replaces the figures, and hands new events to readers.
    fn report(&mut self) {
        self.notify_events();
        let watchers = self.snapshots.receiver_count() + self.poses.receiver_count();
        let figures = WorldFigures::of(&self.world, watchers, self.calls);
        self.figures.send_replace(Arc::new(figures));
        self.hand_out_events();
    }

    /// Replaces the latest snapshot if there are readers.
    pub fn show_snapshot(&self) {
        if self.snapshots.receiver_count() > 0 {
            self.snapshots.send_replace(Arc::new(self.world.snapshot()));
        }
    }

    /// Sends readers the new events that they may see.
    fn hand_out_events(&mut self) {
        let latest = self.world.events().latest();
        while self.published < latest && self.events.receiver_count() > 0 {
            let after = self.published;
            let events = self.world.events().after(after, EVENTS_IN_A_BATCH).unwrap_or_default();
            // If the log has dropped some of them, the batch is empty, and readers read the log.
            self.published = events.last().map_or(latest, |event| event.sequence);
            // The last reader may just have left.
            let _ = self.events.send(Arc::new(EventBatch { after, events }));
        }
        self.published = latest;
    }

    /// The receipt for all changes so far; `None` if they are durable already, or the world is not in a fleet.
    pub fn receipt(&self) -> Option<Receipt> {
        let (sequence, events) = (self.world.events().written(), self.world.events());
        (events.latest() < sequence).then(|| Receipt { sequence, confirmed: self.latest_event.subscribe() })
    }

    /// Wakes callers that wait for a receipt, if there are new confirmed events.
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
    use crate::messages::Hello;
    use crate::quota::Quota;
    use crate::registry::Registry;
    use surefoot_world::{MapSpec, Vec3};
    use tokio::sync::mpsc::channel;

    #[test]
    fn worlds_share_the_period_evenly() {
        let mut phases = Vec::new();
        for _ in 0..8 {
            phases.push(Schedule::free_phase(phases.iter().copied()));
        }
        phases.sort_by(f64::total_cmp);
        assert_eq!(phases, (0..8).map(|idx| f64::from(idx) / 8.0).collect::<Vec<_>>());
        // The next world takes the phase of one that has ended.
        phases.remove(5);
        assert_eq!(Schedule::free_phase(phases.into_iter()), 0.625);
    }

    #[test]
    fn ticks_are_due_at_their_phase_of_every_period() {
        let epoch = Instant::now();
        for elapsed_ms in [0, 1, 16, 17, 40_000_000] {
            let now = epoch + Duration::from_millis(elapsed_ms);
            let due = Schedule { epoch, phase: 0.25 }.first_after(now);
            assert!(due > now && due <= now + 2 * PERIOD);
            assert_eq!(due.duration_since(epoch + PERIOD.mul_f64(0.25)).as_nanos() % PERIOD.as_nanos(), 0);
        }
    }

    #[tokio::test]
    async fn a_call_that_does_not_begin_in_time_is_not_run() {
        let map = Arc::new(surefoot_generate::generate(&MapSpec::with_side(1, 50).unwrap()));
        let world = HostedWorld::new(WorldId(1), map, TimeMode::Lockstep, Arc::default());
        let schedule = Schedule { epoch: Instant::now(), phase: 0.0 };
        let sim = SimHandle::start("test".to_owned(), world, schedule, || {}).unwrap();
        let (release, held) = std::sync::mpsc::channel::<()>();
        sim.cast(move |_| _ = held.recv()).unwrap();
        let runs = Arc::new(AtomicBool::new(false));
        let late = {
            let runs = runs.clone();
            sim.call_within(Duration::from_millis(1), move |_| runs.store(true, Ordering::Relaxed)).await
        };
        assert_eq!(late, Err(SimError::Busy));
        drop(release);
        assert_eq!(sim.call_within(Duration::from_secs(60), |_| 7).await, Ok(7));
        assert!(!runs.load(Ordering::Relaxed), "the call was given up");
    }

    #[tokio::test]
    async fn a_world_that_panics_releases_its_workers_and_answers_that_it_has_stopped() {
        let registry = Arc::new(Registry::default());
        let (queue, _messages) = channel(64);
        registry.join(Hello::new("test", "none", 8), queue);
        let map = Arc::new(surefoot_generate::generate(&MapSpec::with_side(1, 50).unwrap()));
        let world = HostedWorld::new(WorldId(1), map, TimeMode::Realtime, registry.clone());
        let (failed, has_failed) = oneshot::channel();
        let schedule = Schedule { epoch: Instant::now(), phase: 0.0 };
        let sim = SimHandle::start("test".to_owned(), world, schedule, || _ = failed.send(())).unwrap();
        let ticket = Quota::new(8, "NPCs").grant("test");
        let order = SpawnOrder {
            position: Vec3::new(25.0, 40.0, 25.0),
            yaw: 0.0,
            goal: None,
            body: None,
            tags: Default::default(),
            gait: Default::default(),
        };
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
