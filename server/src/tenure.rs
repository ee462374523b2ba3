//! A server's time in a fleet: it keeps its lease, takes over worlds of servers that are gone, records what happens in its own, and drops
//! them when its lease is not sure.

use crate::ids::WorldId;
use crate::store::{SharedStore, StoreError, Tenure};
use crate::worlds::Worlds;
use std::time::Duration;
use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval};
use tracing::{info, warn};

/// Time between two records of what happened: so much longer than alone do clients wait for events, and for the answers to changes.
const RECORD_EVERY: Duration = Duration::from_millis(25);
/// Longest time between two looks for worlds without a server.
const LOOK_EVERY: Duration = Duration::from_secs(2);
/// Pause before a world that was taken over is read again.
const READ_PAUSE: Duration = Duration::from_millis(500);

/// Does all this until it is dropped. `ready` becomes true once this server has looked for worlds.
pub async fn hold(worlds: Worlds, ready: watch::Sender<bool>) {
    tokio::join!(renew(&worlds), claim(&worlds, ready), record(&worlds), guard(&worlds));
}

/// The shared part of the store, which a server of a fleet has.
fn shared(worlds: &Worlds) -> &dyn SharedStore {
    worlds.shared_store().expect("only for a server of a fleet")
}

/// Bounds a call: a link that is cut answers nothing at all.
async fn bounded<T>(limit: Duration, call: impl Future<Output = Result<T, StoreError>>) -> Result<T, StoreError> {
    let silent = |_| StoreError::Unavailable(format!("no answer within {} s", limit.as_secs_f32()));
    tokio::time::timeout(limit, call).await.map_err(silent)?
}

async fn renew(worlds: &Worlds) {
    let shared = shared(worlds);
    let pause = shared.lease() / 3;
    loop {
        tokio::time::sleep(pause).await;
        let renewed = if shared.is_sure() { bounded(pause, shared.renew()).await } else { Err(StoreError::Expired) };
        match renewed {
            Ok(()) => {}
            // It has left.
            Err(StoreError::Expired) if worlds.shutdown().is_triggered() => return,
            Err(StoreError::Expired) => {
                worlds.lose_all("the lease of this server is over");
                match bounded(shared.lease(), shared.rejoin()).await {
                    Ok(()) => info!("this server is a new member of the fleet"),
                    Err(error) => warn!(%error, "this server cannot join the fleet again"),
                }
            }
            Err(error) => warn!(%error, "the lease of this server is not renewed"),
        }
    }
}

/// Drops all worlds as soon as others may have them.
async fn guard(worlds: &Worlds) {
    let shared = shared(worlds);
    let mut due = interval(shared.lease() / 20);
    due.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        due.tick().await;
        if !shared.is_sure() {
            worlds.lose_all("the lease of this server is not sure");
        }
    }
}

async fn claim(worlds: &Worlds, ready: watch::Sender<bool>) {
    let shared = shared(worlds);
    let pause = (shared.lease() / 3).min(LOOK_EVERY);
    while !worlds.shutdown().is_triggered() {
        if shared.is_sure() {
            let (asked, tenure) = (Instant::now(), shared.tenure());
            match bounded(pause, shared.claim(worlds.config().max_worlds)).await {
                Ok(claimed) => {
                    if !claimed.is_empty() {
                        info!(count = claimed.len(), ms = asked.elapsed().as_millis(), "worlds are taken over");
                    }
                    for id in claimed {
                        tokio::spawn(take_over(worlds.clone(), id, tenure));
                    }
                    ready.send_replace(true);
                }
                Err(error) => warn!(%error, "no look for worlds without a server"),
            }
        }
        // Whoever has left has done so before this returns.
        let _ = tokio::time::timeout(pause, shared.changed()).await;
    }
}

/// Restores a world that this server has claimed, as soon as it can be read.
async fn take_over(worlds: Worlds, id: WorldId, tenure: Tenure) {
    while !worlds.shutdown().is_triggered() {
        match worlds.restore(id, tenure).await {
            Ok(()) => return worlds.note_takeover(),
            Err(StoreError::Unavailable(error)) => warn!(world_id = id.0, error, "a world cannot be read yet"),
            Err(StoreError::Lost(_)) => return,
            Err(error) => {
                warn!(world_id = id.0, %error, "a saved world is not restored; it stays as it was saved");
                return;
            }
        }
        tokio::time::sleep(READ_PAUSE).await;
    }
}

async fn record(worlds: &Worlds) {
    let shared = shared(worlds);
    let mut due = interval(RECORD_EVERY);
    due.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut is_failing = false;
    loop {
        due.tick().await;
        let tenure = shared.tenure();
        let journals = worlds.unconfirmed().await;
        if journals.is_empty() || shared.tenure() != tenure {
            continue;
        }
        match bounded(shared.lease(), shared.record(tenure, &journals)).await {
            // What there is by now are the worlds of the next tenure.
            Ok(_) if shared.tenure() != tenure => {}
            Ok(recorded) => {
                is_failing = false;
                for (id, journal) in &journals {
                    match recorded.get(id) {
                        Some(true) => worlds.confirm(*id, journal.through),
                        Some(false) => worlds.lose(*id, "another server has it"),
                        None => {}
                    }
                }
            }
            Err(error) => {
                if !std::mem::replace(&mut is_failing, true) {
                    warn!(%error, "what happens in worlds is not recorded: their clients wait");
                }
            }
        }
    }
}
