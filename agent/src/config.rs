//! Configuration of a worker.

use std::time::Duration;
use surefoot_net::client::Credentials;
use surefoot_net::levels::MapPool;
use surefoot_planner::BuildSettings;

/// Configuration of a worker.
#[derive(Debug, Clone)]
pub struct WorkConfig {
    /// URIs of world servers, such as `http://127.0.0.1:7600`.
    pub servers: Vec<String>,
    /// Whether these servers list the servers of their fleet, all of which the worker serves.
    pub is_of_fleet: bool,
    /// URIs of the planner's replicas; without a planner NPCs head straight for their goals.
    pub planners: Vec<String>,
    /// Credentials for the world server and the planner.
    pub credentials: Credentials,
    /// Most NPCs to decide for.
    pub capacity: u32,
    /// Name of the worker, at most 64 bytes.
    pub name: String,
    /// Settings of graphs.
    pub graph: BuildSettings,
    /// Share of the policy's exploration noise in actions, 0 to 1.
    pub noise_share: f32,
    /// Whether NPCs rehearse the next legs of their plans; the worker then holds the maps of its worlds.
    pub rehearses: bool,
    /// Whether NPCs move composed on legs on which a rehearsal has arrived.
    pub composes: bool,
    /// The maps and their memory budget; NPCs on maps beyond the budget do not rehearse.
    pub maps: MapPool,
}

/// First pause before a retry; doubled up to [`MAX_PAUSE`].
pub(super) const MIN_PAUSE: Duration = Duration::from_millis(100);
/// Longest pause before a retry.
pub(super) const MAX_PAUSE: Duration = Duration::from_secs(5);
