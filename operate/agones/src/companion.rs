//! What the sidecar is told, and when: in every beat the state, then the health, then the counters.

use crate::sidecar::{Sidecar, SidecarError};
use std::convert::Infallible;
use std::future::Future;
use std::time::Duration;
use surefoot_net::client::LinkError;
use surefoot_server::WorldId;
use surefoot_server::observer::{Observer, Vitals};
use tokio::time::{Instant, MissedTickBehavior};
use tracing::{info, warn};

/// How often the sidecar is told, and how long it is left alone when it is away.
#[derive(Debug, Clone, Copy)]
pub struct Pace {
    /// Time between two reports. Agones expects health at least once in `health.periodSeconds`, 5 s by default.
    pub beat: Duration,
    /// Longest time between two tries while the sidecar is away; the first follows after a beat, and each takes twice as long as the one before.
    pub longest_retry: Duration,
}

impl Default for Pace {
    fn default() -> Self {
        // Health returns in less than a period once the sidecar does.
        Self { beat: Duration::from_secs(1), longest_retry: Duration::from_secs(4) }
    }
}

/// Awaits `serving`, and meanwhile reports what `observer` sees to the sidecar at `uri`. When the server has ended without an error, and so has
/// drained and saved its worlds, the sidecar is told to shut the game server down.
///
/// # Errors
/// If `uri` is not a URI, or `serving` fails. What the sidecar does is never an error.
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
    // A failed server says nothing: Agones sees the process end, and starts another one.
    if let Err(error) = companion.sidecar.shutdown().await {
        warn!(uri, %error, "the Agones sidecar does not learn that the server has ended");
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

/// A counter, and what the sidecar knows of it.
#[derive(Debug)]
struct ReportedCounter {
    name: &'static str,
    count: Option<i64>,
    /// Whether the log already says that it is not told in full.
    is_logged: bool,
}

impl ReportedCounter {
    fn new(name: &'static str) -> Self {
        Self { name, count: None, is_logged: false }
    }

    async fn tell(&mut self, sidecar: &mut Sidecar, count: usize) -> Result<(), SidecarError> {
        let (name, count) = (self.name, i64::try_from(count).unwrap_or(i64::MAX));
        if self.count == Some(count) {
            return Ok(());
        }
        let result = set_or_fill(sidecar, name, count).await;
        match &result {
            Ok(told) if *told < count && !self.is_logged => {
                warn!(
                    counter = name,
                    count,
                    capacity = told,
                    "more than the counter's capacity in the Fleet: raise it"
                );
            }
            Err(error @ SidecarError::Refused(_)) if !self.is_logged => {
                warn!(counter = name, %error, "the Agones sidecar refuses this counter: declare it in the Fleet");
            }
            _ => {}
        }
        match result {
            Err(error @ SidecarError::Away(_)) => return Err(error),
            // Tried again in the next beat: the sidecar refuses counters also while it does not know its game server yet.
            Err(SidecarError::Refused(_)) => self.is_logged = true,
            Ok(told) => {
                self.is_logged = told < count;
                self.count = Some(count);
            }
        }
        Ok(())
    }
}

/// Sets a counter to `count`, or to its capacity if that is less; returns what it was set to.
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

/// Whether health is reported: while at least half of the worlds tick. Without health Agones ends the server with all
/// its worlds, which costs more than it saves while most of them are well.
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
    /// Worlds that stood still at the last look.
    stalled: Vec<WorldId>,
    /// Whether health was to be reported at the last look.
    is_healthy: bool,
    /// The sidecar is away: when it is tried again, and how long after that.
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
        // Also while worlds are restored, however long that takes.
        if is_healthy(vitals) {
            self.sidecar.health().await?;
        }
        if is_ready {
            let [worlds, npcs] = &mut self.counters;
            worlds.tell(&mut self.sidecar, vitals.world_count).await?;
            npcs.tell(&mut self.sidecar, vitals.npc_count).await?;
        }
        Ok(())
    }

    /// A server with worlds is allocated, so that Agones does not remove it. What somebody else allocates stays so until the last world has gone.
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

    /// Logs when worlds begin to stand still, when all go on, and when reports of health end and begin again.
    fn note_stalls(&mut self, vitals: &Vitals) {
        let (stalled, world_count) = (vitals.stalled.len(), vitals.world_count);
        for world in vitals.stalled.iter().filter(|world| !self.stalled.contains(world)) {
            warn!(world_id = world.0, stalled, world_count, "a world stands still");
        }
        if vitals.stalled.is_empty() && !self.stalled.is_empty() {
            info!("all worlds go on");
        }
        self.stalled.clone_from(&vitals.stalled);
        let is_healthy = is_healthy(vitals);
        match (std::mem::replace(&mut self.is_healthy, is_healthy), is_healthy) {
            (true, false) => {
                warn!(
                    stalled,
                    world_count, "most worlds stand still: no health is reported to Agones, which restarts the server"
                );
            }
            (false, true) => info!(stalled, world_count, "health is reported to Agones again"),
            _ => {}
        }
    }

    /// Logs the beginning and the end of an outage, and says when the next try is due.
    fn note_outage(&mut self, result: Result<(), SidecarError>) {
        let uri = &self.uri;
        match (result, self.outage) {
            (Ok(()), None) => {}
            (Ok(()), Some(_)) => {
                info!(uri, "the Agones sidecar answers");
                self.outage = None;
            }
            (Err(error), before) => {
                let wait = before.map_or(self.pace.beat, |(_, wait)| (2 * wait).min(self.pace.longest_retry));
                if before.is_none() {
                    warn!(uri, %error, "the Agones sidecar does not do its part: worlds are served without it, and it is tried again");
                }
                self.outage = Some((Instant::now() + wait, wait));
            }
        }
    }
}
