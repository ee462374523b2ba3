//! Players: bodies that the game moves. NPCs collide with them, and the world never moves them.

use crate::Vec3;
pub use crate::slot::PlayerSlot;
use serde::{Deserialize, Serialize};

/// Greatest number of players of a world.
pub const MAX_PLAYERS: usize = 1024;
/// Allowed radii of a player, m.
pub const PLAYER_RADIUS_M: std::ops::RangeInclusive<f32> = 0.1..=1.0;
/// Allowed heights of a player, m; at least twice the radius.
pub const PLAYER_HEIGHT_M: std::ops::RangeInclusive<f32> = 0.2..=5.0;

/// Effect of a player on the NPCs that it touches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum PlayerContact {
    /// NPCs stop at the player and go around it. They do not yield if the player walks into them.
    Block,
    /// The player pushes NPCs aside, but never off a ledge or into lava.
    Push,
    /// Player and NPCs pass through each other.
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
    /// Effect on NPCs that it touches.
    pub contact: PlayerContact,
}

impl Player {
    /// Whether it obstructs NPCs.
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
