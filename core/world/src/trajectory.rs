//! Where a body will be in the next second.

use crate::character::Body;
use crate::{Ability, Vec3};

/// Ticks from a prediction to each of its poses: 0.33, 0.67 and 1 s.
pub const POSE_TICKS: [u32; 3] = [20, 40, 60];

/// Ticks before it leaves the ground from which a body winds up (0.33 s).
const WIND_UP_TICKS: u64 = 20;

/// Where a body is and which way it faces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Position of the feet, m.
    pub feet: Vec3,
    /// Heading, rad.
    pub yaw: f32,
}

impl From<&Body> for Pose {
    fn from(body: &Body) -> Self {
        Self { feet: body.feet, yaw: body.yaw }
    }
}

/// What a body will do in the next second unless something interferes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Trajectory {
    /// Poses after [`POSE_TICKS`]; those after the end of the prediction are `None`.
    pub poses: [Option<Pose>; 3],
    /// When the body will leave the ground next by an ability.
    pub take_off: Option<TakeOff>,
}

/// A take-off that a prediction has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TakeOff {
    /// Ticks from the prediction to the decision in which the body leaves the ground, at most 60.
    pub ticks: u8,
    /// The ability of the leg.
    pub ability: Ability,
}

impl Trajectory {
    /// The trajectory of a body that stays where it is.
    pub fn at_rest(body: &Body) -> Self {
        Self { poses: [Some(body.into()); 3], take_off: None }
    }

    /// The ability for which the body winds up, `age` ticks after the prediction.
    pub fn winds_up_for(&self, age: u64) -> Option<Ability> {
        let TakeOff { ticks, ability } = self.take_off?;
        (u64::from(ticks) <= age + WIND_UP_TICKS).then_some(ability)
    }

    /// Whether nothing is predicted.
    pub fn is_empty(&self) -> bool {
        self.poses[0].is_none() && self.take_off.is_none()
    }
}
