//! Where environments run, and how they are reached.

use std::sync::Arc;
use surefoot_game_client::{Game, GameError};

/// Connects to the world at an address.
pub type Connect = Arc<dyn Fn(&str) -> Result<Game, GameError> + Send + Sync>;

/// Where an environment runs.
#[derive(Debug, Clone)]
pub(crate) struct Place {
    /// Address of the world.
    pub uri: String,
    /// Index of the saved level that the world runs; `None` if it runs maps that are generated.
    pub level: Option<u64>,
}
