//! What acts: the NPC worker, the trainer and the evaluation protocol.
//!
//! Start at [`train::run`] for learning, at [`eval::evaluate`] for the numbers, at [`follow`] for how a plan
//! is followed, and at [`work`] for the worker that carries NPCs of a running server.

pub mod crowd;
pub mod eval;
pub mod follow;
pub mod rollout;
pub mod train;
pub mod work;
