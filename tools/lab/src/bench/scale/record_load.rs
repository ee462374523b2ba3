//! The load on what the servers of a fleet share.

use serde::{Deserialize, Serialize};

/// The load on the database (PostgreSQL) and the object store of a fleet.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct RecordLoad {
    /// Interval at which a world is saved, s.
    pub save_every_s: f64,
    /// Interval at which a process renews its lease, s.
    pub renew_every_s: f64,
    /// How often a server writes the events of its worlds, per second.
    #[serde(default)]
    pub notes_per_s: f64,
    /// CPU time of PostgreSQL for one write, us.
    pub cpu_us_per_write: f64,
    /// Bytes of a saved world without NPCs, and of each NPC in it.
    pub save_bytes: [f64; 2],
}

impl Default for RecordLoad {
    /// Conservative guesses for a load that was not measured. Servers write events every 25 ms at most.
    fn default() -> Self {
        Self {
            save_every_s: 2.0,
            renew_every_s: 5.0 / 3.0,
            notes_per_s: 40.0,
            cpu_us_per_write: 500.0,
            save_bytes: [2_000.0, 300.0],
        }
    }
}
