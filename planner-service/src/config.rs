//! Limits and sizes of a planner.

use crate::provers::{Embedded, Provers};
use std::sync::Arc;
use surefoot_net::levels::{DEFAULT_MAX_MAPS, MapPool};
use surefoot_planner::search::DEFAULT_LABEL_LIMIT;

/// Limits and sizes of a planner.
#[derive(Debug, Clone)]
pub struct PlannerConfig {
    /// Maximum number of vertices of a graph (`--max-vertices`).
    pub max_vertices: usize,
    /// Maximum number of queries in one batch (`--max-queries`).
    pub max_queries: usize,
    /// Maximum number of builds that are running or waiting (`--max-builds`).
    pub max_builds: usize,
    /// Maximum number of builds that one client has asked for (`--max-builds-per-client`).
    pub max_builds_per_client: usize,
    /// Maximum number of graphs in memory (`--graphs-in-memory`).
    pub graphs_in_memory: usize,
    /// Number of threads for probing (`--threads`).
    pub threads: usize,
    /// Largest number of vertices at which a graph gets hub labels before it is served (`--label-vertices`). Larger
    /// graphs get them in the background.
    pub label_vertices: usize,
    /// Maximum number of imported maps that are kept (`--max-maps`).
    pub max_maps: usize,
    /// Generated maps in use, and the memory budget of all maps (`--max-memory`). Other services of this process may
    /// share both.
    pub maps: MapPool,
    /// Runs the probes of builds.
    pub provers: Arc<dyn Provers>,
}

impl Default for PlannerConfig {
    fn default() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Self {
            max_vertices: 2000,
            max_queries: 4096,
            max_builds: 16,
            max_builds_per_client: 8,
            graphs_in_memory: 32,
            threads,
            label_vertices: DEFAULT_LABEL_LIMIT,
            max_maps: DEFAULT_MAX_MAPS,
            maps: MapPool::default(),
            provers: Arc::new(Embedded),
        }
    }
}
