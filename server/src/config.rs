//! Configuration of a world server: limits, and how worlds are saved.

use crate::envs::IDLE_LIMIT;
use crate::store::WorldStore;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use surefoot_net::levels::{DEFAULT_MAX_MAPS, MapPool};
use surefoot_net::reader::DEFAULT_PATIENCE;

/// Configuration of a world server.
#[derive(Debug, Clone)]
pub struct ServerConfig {
    /// Most worlds at a time (`--max-worlds`); each has a thread.
    pub max_worlds: usize,
    /// Most worlds of one client (`--max-worlds-per-client`).
    pub max_worlds_per_client: usize,
    /// Most NPCs in one world (`--max-npcs`).
    pub max_npcs_per_world: usize,
    /// Most NPCs of one client (`--max-npcs-per-client`).
    pub max_npcs_per_client: usize,
    /// Most environments of remote trainers (`--max-envs`).
    pub max_envs: usize,
    /// Most environments of one client (`--max-envs-per-client`).
    pub max_envs_per_client: usize,
    /// Time after which an unused environment is removed; there is no flag for it.
    pub idle_envs_after: Duration,
    /// Most imported maps that are kept (`--max-maps`).
    pub max_maps: usize,
    /// Generated maps, and the memory budget (`--max-memory`). Workers in the same process may share them.
    pub maps: MapPool,
    /// Time without a read after which the reader of a stream is cut off (`--reader-patience`).
    pub reader_patience: Duration,
    /// Folder for saved worlds, which are restored when the server starts (`--state`); `None`: worlds end with the
    /// server.
    pub state: Option<PathBuf>,
    /// The store of a fleet, instead of a folder.
    pub store: Option<Arc<dyn WorldStore>>,
    /// Time between two saves while the server runs (`--save-every`). A killed server loses the changes since the last
    /// one.
    pub save_every: Duration,
}

impl Default for ServerConfig {
    fn default() -> Self {
        Self {
            max_worlds: 64,
            max_worlds_per_client: 32,
            max_npcs_per_world: 4096,
            max_npcs_per_client: 8192,
            max_envs: 16,
            max_envs_per_client: 8,
            idle_envs_after: IDLE_LIMIT,
            max_maps: DEFAULT_MAX_MAPS,
            maps: MapPool::default(),
            reader_patience: DEFAULT_PATIENCE,
            state: None,
            store: None,
            save_every: Duration::from_secs(30),
        }
    }
}
