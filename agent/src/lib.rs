//! Programs that act with a policy: the NPC worker, the trainer, the evaluation protocol and the challenge.
//!
//! Start at [`train::run()`] for training, at [`eval::evaluate`] for evaluation, at [`work`] for the worker that decides for
//! NPCs of a running server, and at [`game`] for what is done in the physics of a game. All of them share the decision loop of the crate `surefoot-rollout`.

pub mod challenge;
pub mod crowd;
pub mod eval;
pub mod game;
mod parallel;
pub mod train;
pub mod work;
