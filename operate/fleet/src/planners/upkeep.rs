//! What runs besides: the lease is renewed, notifications are listened to, and what is left over is cleared away.

use super::db::{CHANNEL, Note, PATIENCE, PlannerDb};
use super::graphs;
use super::operations;
use super::receipts;
use crate::error::FleetError;
use sqlx::postgres::PgListener;
use std::sync::{Arc, Mutex, Weak};
use std::time::{Duration, Instant};
use surefoot_planner_service::replicas::News;
use tokio::sync::mpsc;
use tracing::{info, warn};

/// Silence after which the connection that listens counts as broken: pings come more than once a second.
const SILENCE: Duration = Duration::from_secs(3);
/// Pause before listening again.
const PAUSE: Duration = Duration::from_millis(200);
/// Longest pause between two pings.
const PING: Duration = Duration::from_secs(1);

/// Renews the lease and clears away until the planner is gone or leaves.
pub async fn keep(db: Weak<PlannerDb>, news: mpsc::Sender<News>, lease: Duration) {
    let mut due = tokio::time::interval((lease / 3).min(PING));
    due.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    loop {
        due.tick().await;
        let Some(db) = db.upgrade() else { return };
        if db.has_left() {
            return;
        }
        let renewed = tokio::time::timeout(PATIENCE.min(lease), db.membership.renew()).await;
        match renewed {
            Ok(Ok(())) => {
                // While it is full, there is enough to do.
                let _ = news.try_send(News::Orphans);
            }
            Ok(Err(error)) => warn!(%error, "the lease of this planner is not renewed"),
            Err(_) => warn!("the lease of this planner is not renewed: the database does not answer"),
        }
        // Whatever the rest waits for, the next renewal is in time.
        match tokio::time::timeout(lease / 3, clear_away(&db)).await {
            Ok(Ok(())) => {}
            Ok(Err(error)) => warn!(%error, "planner: cannot clear away what others left; trying again"),
            Err(_) => warn!("planner: cannot clear away what others left (the database does not answer); trying again"),
        }
    }
}

async fn clear_away(db: &PlannerDb) -> Result<(), FleetError> {
    let mut connection = db.database.pool.acquire().await.map_err(|error| db.failed(error))?;
    db.notify(&mut connection, &Note::Ping).await?;
    drop(connection);
    graphs::sweep(db).await?;
    receipts::forget(db).await?;
    operations::forget(db).await
}

/// Passes on news of other planners until this one is gone.
pub async fn listen(db: Weak<PlannerDb>, news: mpsc::Sender<News>) {
    loop {
        let Some(living) = db.upgrade() else { return };
        let heard = Mutex::new(Instant::now());
        let silent = async {
            let since = || heard.lock().expect("no holder of this lock panics").elapsed();
            while since() < SILENCE {
                tokio::time::sleep(PAUSE).await;
            }
            FleetError::new(living.database.place(), "no notification arrives")
        };
        // Not cancelled between two notifications: one that was read in part would be lost.
        let error = tokio::select! {
            error = listen_once(&living, &news, &heard) => error,
            error = silent => error,
        };
        if living.has_left() || news.is_closed() {
            return;
        }
        warn!(%error, "news of other planners may be lost; listening again");
        drop(living);
        tokio::time::sleep(PAUSE).await;
    }
}

async fn listen_once(db: &Arc<PlannerDb>, news: &mpsc::Sender<News>, heard: &Mutex<Instant>) -> FleetError {
    let mut listener = match connect(db).await {
        Ok(listener) => listener,
        Err(error) => return error,
    };
    info!("listening to other planners");
    // What came before is known only to the database.
    let mut latest = Some(News::Everything);
    loop {
        if let Some(latest) = latest
            && news.send(latest).await.is_err()
        {
            return FleetError::new(db.database.place(), "nobody listens any more");
        }
        let (note, member) = match listener.try_recv().await {
            Ok(Some(notification)) => match Note::decode(notification.payload()) {
                Some(note) => note,
                None => continue,
            },
            Ok(None) => return FleetError::new(db.database.place(), "the connection is broken"),
            Err(error) => return db.failed(error),
        };
        *heard.lock().expect("no holder of this lock panics") = Instant::now();
        let is_own = member == db.membership.id();
        latest = match note {
            Note::Ping => None,
            // Also after a change of this planner: if the answer to its COMMIT was lost, it does not know that the layers have changed.
            Note::Layers(level) => Some(News::Layers(level)),
            _ if is_own => None,
            Note::Graph(id) => Some(News::Graph(id)),
            Note::Evidence(id) => Some(News::Evidence(id)),
            Note::Left => Some(News::Orphans),
        };
    }
}

async fn connect(db: &PlannerDb) -> Result<PgListener, FleetError> {
    let fail = |error| db.failed(error);
    let mut listener = PgListener::connect_with(&db.database.pool).await.map_err(fail)?;
    // Whoever reconnects has to read everything again.
    listener.eager_reconnect(false);
    listener.listen(CHANNEL).await.map_err(fail)?;
    Ok(listener)
}
