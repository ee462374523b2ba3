//! Look-ups by clients: where worlds run, and which servers there are.
//!
//! The number of look-ups is not limited. One statement at a time asks for all worlds that callers wait for. Its
//! answers serve all callers for a moment, also those about worlds that do not exist.

use super::rows;
use crate::database::Database;
use parking_lot::Mutex;
use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};
use surefoot_server::WorldId;
use surefoot_server::store::{ServerInfo, StoreError};
use tokio::sync::Semaphore;

/// Longest time for which an answer is reused.
const FRESH: Duration = Duration::from_millis(200);
/// Maximum number of callers that wait. Further ones are refused.
const MAX_CALLERS: usize = 4096;
/// Maximum number of answers from one half of [`FRESH`]. Beyond it, older ones are dropped earlier.
const MAX_ANSWERS: usize = 8192;
/// Longest wait for an answer.
const PATIENCE: Duration = Duration::from_secs(2);

/// Look-ups of one server.
#[derive(Debug)]
pub struct Lookups {
    callers: Semaphore,
    /// Worlds that callers wait for.
    waiting: Mutex<BTreeSet<WorldId>>,
    known: Mutex<Known>,
    /// Held during a query for worlds.
    turn: tokio::sync::Mutex<()>,
    servers: tokio::sync::Mutex<Option<(Instant, Vec<ServerInfo>)>>,
}

/// Answers from two halves of [`FRESH`]. The older half is dropped as a whole.
#[derive(Debug)]
struct Known {
    since: Instant,
    latest: BTreeMap<WorldId, Option<ServerInfo>>,
    former: BTreeMap<WorldId, Option<ServerInfo>>,
}

impl Known {
    fn forget(&mut self) {
        let age = self.since.elapsed();
        if age < FRESH / 2 && self.latest.len() < MAX_ANSWERS {
            return;
        }
        let latest = std::mem::take(&mut self.latest);
        self.former = if age < FRESH { latest } else { BTreeMap::new() };
        self.since = Instant::now();
    }

    fn get(&mut self, id: WorldId) -> Option<Option<ServerInfo>> {
        self.forget();
        self.latest.get(&id).or_else(|| self.former.get(&id)).cloned()
    }
}

impl Default for Lookups {
    fn default() -> Self {
        let known = Known { since: Instant::now(), latest: BTreeMap::new(), former: BTreeMap::new() };
        Self {
            callers: Semaphore::new(MAX_CALLERS),
            waiting: Mutex::default(),
            known: Mutex::new(known),
            turn: tokio::sync::Mutex::default(),
            servers: tokio::sync::Mutex::default(),
        }
    }
}

impl Lookups {
    /// Returns where a world runs, as the member `own` sees it.
    pub async fn locate(&self, database: &Database, id: WorldId, own: i64) -> Result<Option<ServerInfo>, StoreError> {
        if let Some(known) = self.known.lock().get(id) {
            return Ok(known);
        }
        let look = async {
            {
                let mut waiting = self.waiting.lock();
                // Worlds of callers that have disconnected stay in the set.
                if waiting.len() < MAX_CALLERS {
                    waiting.insert(id);
                }
            }
            let _turn = self.turn.lock().await;
            // The previous caller may have asked for this world as well.
            if let Some(known) = self.known.lock().get(id) {
                return Ok(known);
            }
            let mut ids = std::mem::take(&mut *self.waiting.lock());
            ids.insert(id);
            let mut found = rows::locate(database, &ids, own).await?;
            let answer = found.get(&id).cloned();
            self.known.lock().latest.extend(ids.into_iter().map(|id| (id, found.remove(&id))));
            Ok::<_, StoreError>(answer)
        };
        self.bounded(look).await
    }

    /// Returns all servers that hold their lease, as the member `own` sees them.
    pub async fn servers(&self, database: &Database, own: i64) -> Result<Vec<ServerInfo>, StoreError> {
        let look = async {
            let mut known = self.servers.lock().await;
            if let Some((_, servers)) = known.as_ref().filter(|(asked, _)| asked.elapsed() < FRESH) {
                return Ok(servers.clone());
            }
            let asked = Instant::now();
            let servers = rows::servers(database, own).await?;
            *known = Some((asked, servers.clone()));
            Ok::<_, StoreError>(servers)
        };
        self.bounded(look).await
    }

    async fn bounded<T>(&self, look: impl Future<Output = Result<T, StoreError>>) -> Result<T, StoreError> {
        let _caller = self.callers.try_acquire().map_err(|_| StoreError::Busy)?;
        let silent = |_| StoreError::Unavailable(format!("no answer within {} s", PATIENCE.as_secs()));
        tokio::time::timeout(PATIENCE, look).await.map_err(silent)?
    }
}
