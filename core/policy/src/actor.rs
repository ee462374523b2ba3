//! What evaluates a policy: the interface, its batches and its buffers.

use crate::config::ActorConfig;
use crate::matrix::Aligned;
use std::fmt;
use surefoot_world::Action;

/// Evaluates a policy's network.
pub trait Actor: fmt::Debug + Send + Sync {
    /// Allocates what [`act`](Self::act) needs of `scratch` for batches of up to `row_count` rows.
    fn fit(&self, _scratch: &mut Scratch, _row_count: usize) {}

    /// Computes the action of each row of `batch`, as [`Policy::act`](crate::Policy::act) describes.
    fn act(&self, batch: Batch<'_>, scratch: &mut Scratch, actions: &mut [Action]);
}

/// Rows of NPCs that decide together.
#[derive(Debug)]
pub struct Batch<'a> {
    /// Rows of [`Policy::observation_len`](crate::Policy::observation_len) values.
    pub observations: &'a [f32],
    /// Rows of [`Policy::memory_len`](crate::Policy::memory_len) values: zeros at the start of an attempt, overwritten
    /// for the next decision.
    pub memory: &'a mut [f32],
    /// Noise in units of the policy's standard deviation: rows of
    /// [`ACTION_LEN`](surefoot_world::character::ACTION_LEN) values, or empty for none.
    pub noise: &'a [f32],
}

/// Buffers of a [`CpuActor`](crate::CpuActor) for one block of rows. Allocated at first use, and again for a larger
/// batch or an actor of other sizes.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    pub(crate) sizes: Option<ActorConfig>,
    /// Rows of a block, at most `cpu_actor::BLOCK`.
    pub(crate) block: usize,
    /// Encoded rays.
    pub(crate) rays: Aligned,
    /// Encoded rays, the rest of the observation, and the hidden state.
    pub(crate) sensed: Aligned,
    pub(crate) gates: Aligned,
    pub(crate) first: Aligned,
    pub(crate) second: Aligned,
    pub(crate) head: Aligned,
}
