//! Programs that act with a policy: the NPC worker, the trainer, the evaluation protocol and the challenge.
//!
//! Start at [`train::run()`] for training, at [`eval::evaluate`] for evaluation, and at [`work`] for the worker that decides for
//! NPCs of a running server. All of them share the decision loop of the crate `surefoot-rollout`.

pub mod challenge;
pub mod crowd;
pub mod eval;
pub mod train;
pub mod work;
