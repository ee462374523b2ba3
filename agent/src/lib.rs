//! What acts: the NPC worker, the trainer and the evaluation protocol.
//!
//! Start at [`train::run`] for learning, at [`eval::evaluate`] for the numbers, and at [`follow`] for how a
//! plan is followed.

pub mod eval;
pub mod follow;
pub mod rollout;
pub mod train;
