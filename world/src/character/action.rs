//! What the policy controls.

use serde::{Deserialize, Serialize};

/// What the policy controls, each in [-1, 1].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Action {
    /// Forward (positive) or backwards.
    pub forward: f32,
    /// To the right (positive) or left.
    pub strafe: f32,
    /// Turn left (positive) or right.
    pub turn: f32,
    /// Jump, or jump again in the air, when positive.
    pub jump: f32,
}

/// Number of values in an [`Action`].
pub const ACTION_LEN: usize = 4;

/// An action with a value that is not a finite number.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("action[{index}] is {value}, allowed are finite numbers (values beyond -1 to 1 are clamped)")]
pub struct ActionError {
    /// Position in the order forward, strafe, turn, jump.
    pub index: usize,
    /// The offending value.
    pub value: f32,
}

impl Action {
    /// Takes forward, strafe, turn, jump and clamps each to [-1, 1].
    ///
    /// # Errors
    /// Names the first value that is NaN or infinite.
    pub fn from_array(values: [f32; ACTION_LEN]) -> Result<Self, ActionError> {
        if let Some(index) = values.iter().position(|value| !value.is_finite()) {
            return Err(ActionError { index, value: values[index] });
        }
        let [forward, strafe, turn, jump] = values.map(|value| value.clamp(-1.0, 1.0));
        Ok(Self { forward, strafe, turn, jump })
    }

    /// Forward, strafe, turn, jump.
    pub fn to_array(self) -> [f32; ACTION_LEN] {
        [self.forward, self.strafe, self.turn, self.jump]
    }
}
