//! How a worker works.

use std::time::Duration;
use surefoot_net::client::Credentials;
use surefoot_planner::BuildSettings;

/// How a worker works.
#[derive(Debug, Clone)]
pub struct WorkConfig {
    /// URI of the world server, such as `http://127.0.0.1:7600`.
    pub server: String,
    /// URI of the planner; without one NPCs head straight for their goals.
    pub planner: Option<String>,
    /// What both let this worker in for.
    pub credentials: Credentials,
    /// NPCs to carry at most.
    pub capacity: u32,
    /// Name shown by the server.
    pub name: String,
    /// How graphs are to be built.
    pub graph: BuildSettings,
    /// Share of the policy's exploration noise to act with.
    pub noise_share: f32,
}

/// First pause before connecting again; doubled up to [`MAX_PAUSE`].
pub(super) const MIN_PAUSE: Duration = Duration::from_millis(100);
/// Longest pause before connecting again.
pub(super) const MAX_PAUSE: Duration = Duration::from_secs(5);
