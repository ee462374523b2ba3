//! What acts: the NPC worker, the trainer and the evaluation protocol.
//!
//! Start at [`train::run()`] for learning, at [`eval::evaluate`] for the numbers, and at [`work`] for the worker that carries NPCs of
//! a running server. The decision loop that all of them share is the crate `surefoot-rollout`.

pub mod crowd;
pub mod eval;
pub mod train;
pub mod work;
