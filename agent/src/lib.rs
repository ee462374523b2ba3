//! What acts: the NPC worker, the trainer and the evaluation protocol.
//!
//! Start at [`train::run`] for learning.

pub mod rollout;
pub mod train;
