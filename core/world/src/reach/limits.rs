//! Limits on the jumps that a survey tries.

use super::ground::{Obstacles, SPACING_M};
use crate::character::CharacterProfile;

/// Time for which a dash carries a body with its speed, s, with what it keeps afterwards.
const DASH_S: f32 = 0.35;
/// Longest jump of any body that a survey tries, m.
const MAX_JUMP_M: f32 = 30.0;

/// Limits on the jumps that a survey tries.
#[derive(Debug, Clone, Copy)]
pub(super) struct JumpLimits {
    /// Failed leaps after which the search gives up on a pair of islands.
    pub max_failures: u32,
    /// Longest jump, in columns of the grid.
    pub jump_reach: i32,
    /// Highest rise of a jump, m.
    pub max_rise_m: f32,
    /// Highest rise and greatest length of a single jump, m.
    pub single_m: (f32, f32),
    /// Obstacles that keep places apart.
    pub obstacles: Obstacles,
}

impl JumpLimits {
    pub fn usual() -> Self {
        let obstacles = Obstacles::OfBody;
        Self { max_failures: 10, jump_reach: 8, max_rise_m: 4.7, single_m: (2.4, 9.0), obstacles }
    }

    /// The limits on which the devices of generated maps depend. They must not change.
    pub fn of_repairs() -> Self {
        Self { obstacles: Obstacles::OnLine, ..Self::usual() }
    }

    /// The jumps of a body from level ground, each jump in the air made at the top of the jump before it.
    pub fn far(profile: &CharacterProfile) -> Self {
        let (rise_m, seconds) = (profile.jump_height(), 2.0 * profile.jump_speed / profile.gravity);
        let jumps = 1.0 + f32::from(profile.extra_jumps.min(1));
        let dash_m = profile.dash_speed * DASH_S;
        let length_m = (profile.forward_speed * seconds * 0.5 * (1.0 + jumps) + dash_m).min(MAX_JUMP_M);
        Self {
            max_failures: 40,
            jump_reach: (length_m / SPACING_M).ceil().max(2.0) as i32,
            max_rise_m: jumps * rise_m + profile.step_height.max(profile.mantle_height),
            single_m: (rise_m + profile.mantle_height, profile.forward_speed * seconds),
            obstacles: Obstacles::OfBody,
        }
    }
}
