//! Notifications between processes, over LISTEN and NOTIFY of PostgreSQL. A connection that breaks silently is noticed:
//! listeners send pings while a channel is quiet.

use crate::database::Database;
use crate::error::{DATABASE, FleetError};
use parking_lot::Mutex;
use sqlx::PgConnection;
use sqlx::postgres::PgListener;
use std::time::{Duration, Instant};
use tokio::sync::mpsc;
use tracing::{info, warn};

/// Payload of pings.
const PING: &str = "ping 0";
/// Silence after which a listener sends a ping.
const PING_AFTER: Duration = Duration::from_secs(1);
/// Silence after which the connection counts as broken.
const SILENCE: Duration = Duration::from_secs(3);
/// Pause between checks of the silence, and before listening again.
const PAUSE: Duration = Duration::from_millis(200);
/// Longest wait for a ping to be sent.
const PATIENCE: Duration = Duration::from_millis(500);

/// What a listener hears.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Heard {
    /// The connection is new: earlier notifications may be lost.
    Connected,
    /// The payload of a notification.
    Payload(String),
}

/// Sends a notification to all listeners of a channel, once the transaction of `connection` is committed.
pub async fn notify(connection: &mut PgConnection, channel: &str, payload: &str) -> Result<(), sqlx::Error> {
    sqlx::query!("SELECT pg_notify($1, $2)", channel, payload).execute(connection).await.map(drop)
}

/// Passes on notifications of `channel` until the receiver of `sender` is dropped. A full `sender` holds back the
/// connection.
pub async fn listen(database: Database, channel: &'static str, sender: mpsc::Sender<Heard>) {
    while !sender.is_closed() {
        // Taking a notification must not be cancelled halfway: the connection is closed with it.
        let heard = Mutex::new(Instant::now());
        let error = tokio::select! {
            error = receive(&database, channel, &sender, &heard) => error,
            error = watch_silence(&database, channel, &sender, &heard) => error,
            () = sender.closed() => return,
        };
        warn!(%error, channel, "fleet: lost LISTEN; notifications may be missing until it is back");
        tokio::time::sleep(PAUSE).await;
    }
}

async fn receive(
    database: &Database,
    channel: &str,
    sender: &mpsc::Sender<Heard>,
    heard: &Mutex<Instant>,
) -> FleetError {
    let mut listener = match connect(database, channel).await {
        Ok(listener) => listener,
        Err(error) => return error.into(),
    };
    info!(channel, "fleet: listening");
    let mut latest = Some(Heard::Connected);
    loop {
        if let Some(latest) = latest.take()
            && sender.send(latest).await.is_err()
        {
            return FleetError::new(DATABASE, "the receiver is gone");
        }
        *heard.lock() = Instant::now();
        match listener.try_recv().await {
            Ok(Some(notification)) if notification.payload() == PING => {}
            Ok(Some(notification)) => latest = Some(Heard::Payload(notification.payload().to_owned())),
            Ok(None) => return FleetError::new(DATABASE, "the connection is broken"),
            Err(error) => return error.into(),
        }
    }
}

async fn connect(database: &Database, channel: &str) -> Result<PgListener, sqlx::Error> {
    let mut listener = PgListener::connect_with(&database.pool).await?;
    // A silent reconnection would hide that notifications are lost.
    listener.eager_reconnect(false);
    listener.listen(channel).await?;
    Ok(listener)
}

/// Sends pings while the channel is quiet. Returns when they do not arrive.
async fn watch_silence(
    database: &Database,
    channel: &str,
    sender: &mpsc::Sender<Heard>,
    heard: &Mutex<Instant>,
) -> FleetError {
    loop {
        tokio::time::sleep(PAUSE).await;
        if sender.capacity() == 0 {
            // The receiver is busy: the connection is held back, not silent.
            continue;
        }
        let silence = heard.lock().elapsed();
        if silence >= SILENCE {
            return FleetError::new(DATABASE, format!("no notification for {} s", SILENCE.as_secs()));
        }
        if silence >= PING_AFTER {
            let ping = async {
                let mut connection = database.pool.acquire().await?;
                notify(&mut connection, channel, PING).await
            };
            // If it fails, the silence goes on.
            let _ = tokio::time::timeout(PATIENCE, ping).await;
        }
    }
}
