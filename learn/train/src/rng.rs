//! Random actions, and the state of random generators as plain data.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use surefoot_world::Action;

/// Draws an action uniformly.
pub fn random_action(rng: &mut ChaCha8Rng) -> Action {
    Action::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0))).expect("drawn actions are finite")
}

/// Seed, stream and position of a ChaCha generator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct RngState {
    seed: [u8; 32],
    stream: u64,
    word_pos: u128,
}

impl RngState {
    /// The state of `rng`.
    pub fn of(rng: &ChaCha8Rng) -> Self {
        Self { seed: rng.get_seed(), stream: rng.get_stream(), word_pos: rng.get_word_pos() }
    }

    /// A generator that continues from this state.
    pub fn generator(&self) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::from_seed(self.seed);
        rng.set_stream(self.stream);
        rng.set_word_pos(self.word_pos);
        rng
    }
}
