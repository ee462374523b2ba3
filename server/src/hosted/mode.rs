//! How a world's time passes.

use serde::{Deserialize, Serialize};

/// How a world's time passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum TimeMode {
    /// 60 ticks a second.
    Realtime,
    /// As fast as answers arrive: the world waits for every answer.
    Lockstep,
}
