//! Actions: the controls of a character.

use serde::{Deserialize, Serialize};

/// The controls of a character for one decision, each in [-1, 1].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Action {
    /// Moves forward (positive) or backward (negative).
    pub forward: f32,
    /// Moves to the right (positive) or to the left (negative).
    pub strafe: f32,
    /// Turns to the left (positive) or to the right (negative).
    pub turn: f32,
    /// Jumps, or jumps again in the air, when positive.
    pub jump: f32,
}

/// Number of values in an [`Action`].
pub const ACTION_LEN: usize = 4;

/// An action has a value that is not a finite number.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("action[{index}] is {value}, but must be a finite number (values outside -1 to 1 are clamped)")]
pub struct ActionError {
    /// Index of the value in the order forward, strafe, turn, jump.
    pub index: usize,
    /// The rejected value.
    pub value: f32,
}

impl Action {
    /// Creates an action from forward, strafe, turn and jump, each clamped to [-1, 1].
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

    /// Returns forward, strafe, turn and jump.
    pub fn to_array(self) -> [f32; ACTION_LEN] {
        [self.forward, self.strafe, self.turn, self.jump]
    }
}
