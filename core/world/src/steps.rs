//! The height of a drawn body over steps, which its feet take within a tick.

use crate::TICK_SECONDS;
use crate::character::{Body, CharacterProfile};
use crate::float::horizontal;

/// Share of an offset by which it decays in a tick, for a time constant of 0.1 s: 1 - exp(-1/6).
const DECAY: f32 = 0.153_518_28;
/// Offset that is dropped, m, so that the state of a body at rest stays the same.
const LEAST_M: f32 = 0.001;
/// Steepest slope on which a body rises or sinks smoothly, as a tangent.
const STEEPEST: f32 = 2.0;

/// Lets what is drawn of a body rise and sink smoothly where its feet take a step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Steps {
    /// Height to add to the drawn body, m: at most the body's step height, negative after a step up.
    pub offset_m: f32,
    /// Height of the feet at the last tick, m.
    pub feet_m: f32,
    /// How much the feet rose in the last tick, m; 0 in the air.
    pub rise_m: f32,
    /// Whether the body stood on ground at the last tick.
    pub was_grounded: bool,
}

impl Steps {
    /// Follows a body by one tick. `is_carried` says whether a device has moved it elsewhere.
    ///
    /// Slopes and lifts raise a body by about as much in each tick. Only the rest, by which the rise differs from that
    /// of the tick before, is a step. What is drawn makes up for it with a time constant of 0.1 s, or as fast as on a
    /// slope of 45 degrees, so that it keeps up on stairs at any speed.
    pub fn advance(&mut self, body: &Body, profile: &CharacterProfile, is_carried: bool) {
        let (most, is_grounded) = (profile.step_height, body.is_grounded());
        let rise = if self.was_grounded && is_grounded { body.feet.y - self.feet_m } else { 0.0 };
        let way = horizontal(body.velocity) * TICK_SECONDS;
        let farthest = most + STEEPEST * way;
        if is_carried || body.is_carried() || rise.abs() > farthest {
            *self = Self { offset_m: 0.0, feet_m: body.feet.y, rise_m: 0.0, was_grounded: is_grounded };
            return;
        }
        let steady = if rise * self.rise_m > 0.0 { rise.abs().min(self.rise_m.abs()).copysign(rise) } else { 0.0 };
        let offset = (self.offset_m - (rise - steady)).clamp(-most, most);
        let left = offset.abs() - way.max(DECAY * offset.abs());
        let offset_m = if left < LEAST_M { 0.0 } else { left.copysign(offset) };
        *self = Self { offset_m, feet_m: body.feet.y, rise_m: rise, was_grounded: is_grounded };
    }
}
