//! Where environments run, and how they are reached.

use crate::game::{Game, GameError};
use std::sync::Arc;

/// Connects to the world at an address.
pub type Connect = Arc<dyn Fn(&str) -> Result<Game, GameError> + Send + Sync>;

/// Where an environment runs.
#[derive(Debug, Clone)]
pub(in crate::train) struct Place {
    /// Address of the world.
    pub uri: String,
    /// Index of the saved level that the world runs; `None` if it runs maps that are generated.
    pub level: Option<u64>,
}
