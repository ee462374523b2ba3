//! Players: bodies that the game moves. NPCs meet them, and nothing in a world moves them.

use crate::Vec3;
pub use crate::slot::PlayerSlot;
use serde::{Deserialize, Serialize};

/// Most players of a world.
pub const MAX_PLAYERS: usize = 1024;
/// Sizes that a player may have, m.
pub const PLAYER_RADIUS_M: std::ops::RangeInclusive<f32> = 0.1..=1.0;
/// Heights that a player may have, m; at least twice the radius.
pub const PLAYER_HEIGHT_M: std::ops::RangeInclusive<f32> = 0.2..=5.0;

/// What happens between a player and the NPCs that it meets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum PlayerContact {
    /// NPCs do not walk into the player and go around it, and stand their ground where the player walks into them.
    Block,
    /// The player pushes NPCs aside, but never off a ledge or into lava.
    Push,
    /// They pass through each other.
    Ghost,
}

/// An upright capsule that the game moves.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Player {
    /// Lowest point of the capsule, m.
    pub feet: Vec3,
    /// Velocity, m/s.
    pub velocity: Vec3,
    /// Radius, m.
    pub radius: f32,
    /// Height, m.
    pub height: f32,
    /// What happens between it and NPCs.
    pub contact: PlayerContact,
}

impl Player {
    /// Whether NPCs meet it.
    pub(crate) fn is_solid(&self) -> bool {
        self.contact != PlayerContact::Ghost
    }

    /// Whether its size is allowed and its numbers are finite.
    pub fn is_sound(&self) -> bool {
        // These comparisons are false for NaN.
        PLAYER_RADIUS_M.contains(&self.radius)
            && PLAYER_HEIGHT_M.contains(&self.height)
            && self.height >= 2.0 * self.radius
            && self.feet.is_finite()
            && self.velocity.is_finite()
    }
}
