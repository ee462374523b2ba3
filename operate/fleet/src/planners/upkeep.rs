//! What runs beside a planner: the lease is renewed, notifications become news, and leftovers are cleared away.

use super::db::{Note, PATIENCE, PlannerDb};
use super::{graphs, operations, receipts};
use crate::error::FleetError;
use crate::notifications::Heard;
use std::sync::Arc;
use std::time::Duration;
use surefoot_planner_service::replicas::News;
use tokio::sync::mpsc;
use tokio::time::{MissedTickBehavior, interval, timeout};
use tracing::warn;

/// Longest pause between two renewals of the lease.
const RENEW_EVERY: Duration = Duration::from_secs(1);

/// Renews the lease and clears away leftovers.
pub async fn run(db: Arc<PlannerDb>, news: mpsc::Sender<News>) {
    let lease = db.membership.lease();
    let mut due = interval((lease / 3).min(RENEW_EVERY));
    due.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        due.tick().await;
        match timeout(PATIENCE.min(lease), db.renew_lease()).await {
            Ok(Ok(())) => {
                // A full queue has enough work.
                let _ = news.try_send(News::Orphans);
            }
            Ok(Err(error)) => warn!(%error, "planner: cannot renew its lease; trying again"),
            Err(_) => warn!("planner: cannot renew its lease (the database does not answer); trying again"),
        }
        // A slow database must not delay the next renewal.
        match timeout(lease / 3, clear_away(&db)).await {
            Ok(Ok(())) => {}
            Ok(Err(error)) => warn!(%error, "planner: cannot clear away what others left; trying again"),
            Err(_) => warn!("planner: cannot clear away what others left (the database does not answer); trying again"),
        }
    }
}

async fn clear_away(db: &PlannerDb) -> Result<(), FleetError> {
    graphs::sweep(db).await?;
    receipts::forget(db).await?;
    operations::forget(db).await
}

/// Turns notifications into news.
pub async fn pass_on(db: Arc<PlannerDb>, mut notes: mpsc::Receiver<Heard>, sender: mpsc::Sender<News>) {
    while let Some(heard) = notes.recv().await {
        let payload = match heard {
            Heard::Connected => {
                if sender.send(News::Everything).await.is_err() {
                    return;
                }
                continue;
            }
            Heard::Payload(payload) => payload,
        };
        let Some((note, member)) = Note::decode(&payload) else { continue };
        let news = match note {
            // Own changes too: if the answer to its COMMIT was lost, this planner does not know that it was made.
            Note::Layers(level) => News::Layers(level),
            _ if member == db.membership.id() => continue,
            Note::Graph(id) => News::Graph(id),
            Note::Evidence(id) => News::Evidence(id),
            Note::Left => News::Orphans,
        };
        if sender.send(news).await.is_err() {
            return;
        }
    }
}
