//! Compute classes: a job goes only to provers whose results have the same bits as those of its sender.

use std::fmt;
use surefoot_planner::settings::BUILDER_VERSION;
use surefoot_policy::{Batch, Policy, Scratch};

/// Version of the format of jobs and results. Processes of different versions share no work.
const VERSION: u32 = 1;
/// Batch sizes that distinguish processors: their kernels split matrices differently.
const BATCHES: [usize; 5] = [1, 3, 32, 100, 192];

/// Hash of what must agree between processes that share work: the version of the format, the weights, and the bits
/// that this processor computes with them. Processors with other vector units add in another order. `surefoot prove
/// --print-lane` prints it.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct ComputeClass(String);

impl ComputeClass {
    /// Returns the class of a process with this policy. It runs the policy on a few generated observations, which
    /// takes some milliseconds.
    pub fn of(policy: &Policy) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&VERSION.to_le_bytes());
        hasher.update(&BUILDER_VERSION.to_le_bytes());
        hasher.update(env!("CARGO_PKG_VERSION").as_bytes());
        hasher.update(policy.weights_hash().as_bytes());
        let mut state = 1u32;
        let mut value = || {
            // Numerical Recipes' generator: only equal values on every machine matter.
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        };
        let mut actions = Vec::new();
        for row_count in BATCHES {
            let observations: Vec<f32> = (0..row_count * policy.observation_len()).map(|_| value()).collect();
            let mut memory = vec![0.0; row_count * policy.memory_len()];
            let batch = Batch { observations: &observations, memory: &mut memory, noise: &[] };
            policy.act(batch, &mut Scratch::default(), &mut actions);
            let computed = actions.iter().flat_map(|action| action.to_array()).chain(memory);
            computed.for_each(|value| {
                hasher.update(&value.to_le_bytes());
            });
        }
        Self(hasher.finalize().to_hex()[..16].to_owned())
    }

    /// Returns 16 hexadecimal digits.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for ComputeClass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}
