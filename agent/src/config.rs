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
    /// Whether these only say which servers there are in their fleet, all of which the worker serves.
    pub is_of_fleet: bool,
    /// URIs of the planner's replicas; without any NPCs head straight for their goals.
    pub planners: Vec<String>,
    /// Credentials for the world server and the planner.
    pub credentials: Credentials,
    /// Most NPCs to decide for.
    pub capacity: u32,
    /// Name that the server shows, at most 64 bytes.
    pub name: String,
    /// Settings of graphs.
    pub graph: BuildSettings,
    /// Share of the policy's exploration noise to add to actions, 0 to 1.
    pub noise_share: f32,
    /// Whether NPCs rehearse the next legs of their plans, for which the worker holds the maps of its worlds.
    pub rehearses: bool,
    /// Whether NPCs compose themselves on legs on which rehearsals show that they arrive so.
    pub composes: bool,
    /// These maps, and their memory budget; NPCs on further maps go without rehearsals.
    pub maps: MapPool,
}

/// First pause before a retry; doubled up to [`MAX_PAUSE`].
pub(super) const MIN_PAUSE: Duration = Duration::from_millis(100);
/// Longest pause before a retry.
pub(super) const MAX_PAUSE: Duration = Duration::from_secs(5);
