//! Reports to the sidecar: in every beat the state, then the health, then the counters.

use crate::sidecar::{Sidecar, SidecarError};
use std::convert::Infallible;
use std::future::Future;
use std::time::Duration;
use surefoot_net::client::LinkError;
use surefoot_server::WorldId;
use surefoot_server::observer::{Observer, Vitals};
use tokio::time::{Instant, MissedTickBehavior};
use tracing::{info, warn};

/// Period of reports, and pauses while the sidecar is unreachable.
#[derive(Debug, Clone, Copy)]
pub struct Pace {
    /// Time between two reports. Agones expects health at least once in `health.periodSeconds`, 5 s by default.
    pub beat: Duration,
    /// Longest time between two tries while the sidecar is unreachable. The first follows after a beat, and each pause
    /// doubles.
    pub longest_retry: Duration,
}

impl Default for Pace {
    fn default() -> Self {
        // Health resumes in less than a period once the sidecar answers.
        Self { beat: Duration::from_secs(1), longest_retry: Duration::from_secs(4) }
    }
}

/// Awaits `serving`, and meanwhile reports what `observer` sees to the sidecar at `uri`. When the server has drained,
/// saved its worlds and ended without an error, this function requests a shutdown of the game server from the sidecar.
/// Failures of the sidecar are logged.
pub async fn run_with_sidecar<E: From<LinkError>>(
    uri: &str,
    pace: Pace,
    observer: Observer,
    serving: impl Future<Output = Result<(), E>>,
) -> Result<(), E> {
    let mut companion = Companion {
        sidecar: Sidecar::at(uri)?,
        uri: uri.to_owned(),
        pace,
        state: State::Starting,
        counters: ["worlds", "npcs"].map(ReportedCounter::new),
        stalled: Vec::new(),
        is_healthy: true,
        outage: None,
    };
    tokio::select! {
        result = serving => result?,
        never = companion.report_forever(observer) => match never {},
    }
    // A failed server reports nothing: Agones sees the process end, and starts another one.
    if let Err(error) = companion.sidecar.shutdown().await {
        warn!(uri, %error, "agones: cannot report to the sidecar that the server has ended");
    }
    Ok(())
}

/// State of the game server that the sidecar has confirmed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Starting,
    Ready,
    Allocated,
}

/// A counter, and the value that the sidecar has.
#[derive(Debug)]
struct ReportedCounter {
    name: &'static str,
    count: Option<i64>,
    /// Whether a warning says that the sidecar has another value.
    is_logged: bool,
}

impl ReportedCounter {
    fn new(name: &'static str) -> Self {
        Self { name, count: None, is_logged: false }
    }

    async fn report(&mut self, sidecar: &mut Sidecar, count: usize) -> Result<(), SidecarError> {
        let (name, count) = (self.name, i64::try_from(count).unwrap_or(i64::MAX));
        if self.count == Some(count) {
            return Ok(());
        }
        let result = set_or_fill(sidecar, name, count).await;
        match &result {
            Ok(value) if *value < count && !self.is_logged => {
                warn!(
                    counter = name,
                    count,
                    capacity = value,
                    "agones: a counter exceeds its capacity; raise it in the Fleet"
                );
            }
            Err(error @ SidecarError::Refused(_)) if !self.is_logged => {
                warn!(counter = name, %error, "agones: the sidecar refuses a counter; declare it in the Fleet");
            }
            _ => {}
        }
        match result {
            Err(error @ SidecarError::Unreachable(_)) => return Err(error),
            // Tried again in the next beat: the sidecar also refuses counters before it knows its game server.
            Err(SidecarError::Refused(_)) => self.is_logged = true,
            Ok(value) => {
                self.is_logged = value < count;
                self.count = Some(count);
            }
        }
        Ok(())
    }
}

/// Sets a counter to `count`, or to its capacity if that is less. Returns the value.
async fn set_or_fill(sidecar: &mut Sidecar, name: &str, count: i64) -> Result<i64, SidecarError> {
    let refused = match sidecar.set_count(name, count).await {
        Err(error @ SidecarError::Refused(_)) => error,
        result => return result.map(|()| count),
    };
    match sidecar.capacity_of(name).await? {
        capacity if capacity < count => sidecar.set_count(name, capacity).await.map(|()| capacity),
        _ => Err(refused),
    }
}

/// Whether to report health: while at least half of the worlds tick. Without health, Agones ends the server with all
/// its worlds, which costs more than it saves while most of them tick.
fn is_healthy(vitals: &Vitals) -> bool {
    2 * vitals.stalled.len() <= vitals.world_count
}

#[derive(Debug)]
struct Companion {
    sidecar: Sidecar,
    uri: String,
    pace: Pace,
    state: State,
    counters: [ReportedCounter; 2],
    /// Worlds that were stalled at the last check.
    stalled: Vec<WorldId>,
    /// Whether health was reported at the last check.
    is_healthy: bool,
    /// While the sidecar is unreachable: time of the next try, and the pause after it.
    outage: Option<(Instant, Duration)>,
}

impl Companion {
    async fn report_forever(&mut self, observer: Observer) -> Infallible {
        let mut due = tokio::time::interval(self.pace.beat);
        due.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            due.tick().await;
            let vitals = observer.look();
            self.note_stalls(&vitals);
            if self.outage.is_some_and(|(next, _)| Instant::now() < next) {
                continue;
            }
            let result = self.report(&vitals, observer.is_ready()).await;
            self.note_outage(result);
        }
    }

    async fn report(&mut self, vitals: &Vitals, is_ready: bool) -> Result<(), SidecarError> {
        if is_ready {
            self.report_state(vitals.world_count > 0).await?;
        }
        // Health is also reported while worlds are restored, however long that takes.
        if is_healthy(vitals) {
            self.sidecar.health().await?;
        }
        if is_ready {
            let [worlds, npcs] = &mut self.counters;
            worlds.report(&mut self.sidecar, vitals.world_count).await?;
            npcs.report(&mut self.sidecar, vitals.npc_count).await?;
        }
        Ok(())
    }

    /// A server with worlds is allocated, so that Agones does not remove it. If another component allocates it, it
    /// stays allocated until its last world is gone.
    async fn report_state(&mut self, is_used: bool) -> Result<(), SidecarError> {
        if self.state == State::Starting || self.state == State::Allocated && !is_used {
            self.sidecar.ready().await?;
            self.state = State::Ready;
        }
        if self.state == State::Ready && is_used {
            self.sidecar.allocate().await?;
            self.state = State::Allocated;
        }
        Ok(())
    }

    /// Logs when worlds stall and tick again, and when reports of health stop and resume.
    fn note_stalls(&mut self, vitals: &Vitals) {
        let (stalled, world_count) = (vitals.stalled.len(), vitals.world_count);
        for world in vitals.stalled.iter().filter(|world| !self.stalled.contains(world)) {
            warn!(world_id = world.0, stalled, world_count, "agones: a world is stalled");
        }
        if vitals.stalled.is_empty() && !self.stalled.is_empty() {
            info!("agones: all worlds tick again");
        }
        self.stalled.clone_from(&vitals.stalled);
        let is_healthy = is_healthy(vitals);
        match (std::mem::replace(&mut self.is_healthy, is_healthy), is_healthy) {
            (true, false) => {
                warn!(
                    stalled,
                    world_count, "agones: most worlds are stalled; without health, Agones restarts the server"
                );
            }
            (false, true) => info!(stalled, world_count, "agones: reporting health again"),
            _ => {}
        }
    }

    /// Logs the start and the end of an outage, and schedules the next try.
    fn note_outage(&mut self, result: Result<(), SidecarError>) {
        let uri = &self.uri;
        match (result, self.outage) {
            (Ok(()), None) => {}
            (Ok(()), Some(_)) => {
                info!(uri, "agones: the sidecar answers again");
                self.outage = None;
            }
            (Err(error), before) => {
                let wait = before.map_or(self.pace.beat, |(_, wait)| (2 * wait).min(self.pace.longest_retry));
                if before.is_none() {
                    warn!(uri, %error, "agones: the sidecar is unreachable; worlds are served without it");
                }
                self.outage = Some((Instant::now() + wait, wait));
            }
        }
    }
}
