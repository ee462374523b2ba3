//! The maps on which a worker's NPCs rehearse, and the time that they may take for it. Worlds on equal maps share a
//! map.

use super::graph::GraphKey;
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};
use surefoot_net::client::Link;
use surefoot_net::levels::{BaseMap, MapPool, SharedMap};
use surefoot_net::memory::Reservation;
use surefoot_world::map::Piece;
use surefoot_world::{Map, MapSpec};
use tokio::sync::watch;
use tracing::warn;

/// Longest download of a level.
const LEVEL_LIMIT: Duration = Duration::from_secs(60);
/// Share of all cores that rehearsals of realtime worlds may take.
const PACE: f64 = 0.3;
/// Most seconds of rehearsals that can be saved up.
const MAX_SAVED_S: f64 = 0.025;
/// Estimated seconds of a rehearsal.
const REHEARSAL_S: f64 = 0.002;

/// The maps of a worker's worlds.
pub(super) struct Maps {
    pool: MapPool,
    levels: Mutex<BTreeMap<String, Weak<Level>>>,
    /// Bounds the rehearsals of all realtime worlds together.
    pub pace: Pace,
}

/// A level that was downloaded.
pub(super) struct Level {
    map: Arc<Map>,
    _memory: Reservation,
}

/// The source of a map, which keeps its memory reserved.
#[derive(Clone)]
enum HeldMade {
    Generated(Arc<SharedMap>),
    Level(Arc<Level>),
}

/// A map with its pieces.
#[derive(Clone)]
pub(super) struct HeldMap {
    map: Arc<Map>,
    _made: HeldMade,
}

/// Whether the map of a world has arrived.
#[derive(Clone)]
pub(super) enum Arrival {
    Awaited,
    Here(HeldMap),
    /// The map cannot be loaded: NPCs do not rehearse.
    Never,
}

impl HeldMade {
    fn map(&self) -> &Arc<Map> {
        match self {
            Self::Generated(shared) => shared.map(),
            Self::Level(level) => &level.map,
        }
    }

    /// Puts pieces onto the map.
    fn with_pieces(self, pieces: &[Piece]) -> Result<HeldMap, String> {
        let map = self.map().holding(pieces).map_err(|error| error.to_string())?;
        Ok(HeldMap { map, _made: self })
    }
}

impl HeldMap {
    pub fn map(&self) -> &Arc<Map> {
        &self.map
    }
}

impl Maps {
    /// No levels yet; generated maps come from `pool`.
    pub fn new(pool: MapPool) -> Self {
        Self { pool, levels: Mutex::default(), pace: Pace::default() }
    }

    /// The map of a world, which arrives later; a level is downloaded from `server`.
    pub fn of(self: &Arc<Self>, key: &GraphKey, server: Link) -> watch::Receiver<Arrival> {
        let (sender, receiver) = watch::channel(Arrival::Awaited);
        let (maps, key) = (self.clone(), key.clone());
        tokio::spawn(async move {
            let loading = async {
                let made = match key.spec() {
                    Some(spec) => maps.generated(spec?, &key.map_hash).await?,
                    None => maps.level(&key, server).await?,
                };
                let pieces = key.pieces()?;
                let put = tokio::task::spawn_blocking(move || made.with_pieces(&pieces));
                put.await.map_err(|error| error.to_string())?
            };
            let arrival = tokio::select! {
                held = loading => held,
                // The world is gone.
                () = sender.closed() => return,
            };
            let arrival = arrival.map(Arrival::Here).unwrap_or_else(|error| {
                warn!(map = key.map_hash, %error, "cannot load the map; NPCs do not rehearse");
                Arrival::Never
            });
            sender.send_replace(arrival);
        });
        receiver
    }

    async fn generated(&self, spec: MapSpec, map_hash: &str) -> Result<HeldMade, String> {
        let shared = self.pool.get("worlds", &BaseMap::Spec(spec)).await.map_err(|error| error.to_string())?;
        if shared.map().hash().to_hex() != map_hash {
            return Err("this version generates another map than the server".to_owned());
        }
        Ok(HeldMade::Generated(shared))
    }

    async fn level(&self, key: &GraphKey, server: Link) -> Result<HeldMade, String> {
        let known = self.levels.lock().get(&key.map_hash).and_then(Weak::upgrade);
        if let Some(level) = known {
            return Ok(HeldMade::Level(level));
        }
        let bytes = tokio::time::timeout(LEVEL_LIMIT, key.download(server));
        let bytes = bytes.await.map_err(|_| "the server did not send the level in time")??;
        let decoded = tokio::task::spawn_blocking(move || surefoot_levels::decode(&bytes));
        let map = decoded.await.map_err(|error| error.to_string())?.map_err(|error| error.to_string())?;
        let memory = self.pool.memory().reserve("levels", map.memory_bytes() as u64).map_err(|it| it.to_string())?;
        let level = Arc::new(Level { map: Arc::new(map), _memory: memory });
        let mut levels = self.levels.lock();
        levels.retain(|_, level| level.strong_count() > 0);
        levels.insert(key.map_hash.clone(), Arc::downgrade(&level));
        Ok(HeldMade::Level(level))
    }
}

/// A bound on time spent: what is saved up at a steady pace may be spent.
#[derive(Debug)]
pub(super) struct Pace {
    /// Seconds that may be spent for each second that passes.
    rate: f64,
    /// Seconds saved up, and when they were last counted.
    saved: Mutex<(f64, Instant)>,
}

impl Default for Pace {
    fn default() -> Self {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Self { rate: PACE * cores as f64, saved: Mutex::new((MAX_SAVED_S, Instant::now())) }
    }
}

impl Pace {
    /// How many rehearsals can be paid for now.
    pub fn affordable(&self) -> usize {
        let mut saved = self.saved.lock();
        let now = Instant::now();
        saved.0 = (saved.0 + self.rate * now.duration_since(saved.1).as_secs_f64()).min(MAX_SAVED_S);
        saved.1 = now;
        (saved.0 / REHEARSAL_S).max(0.0) as usize
    }

    /// Records what rehearsals took.
    pub fn spend(&self, time: Duration) {
        self.saved.lock().0 -= time.as_secs_f64();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_spent_must_be_saved_up_again() {
        let pace = Pace::default();
        assert!(pace.affordable() > 5);
        pace.spend(Duration::from_secs(3600));
        assert_eq!(pace.affordable(), 0);
    }
}
