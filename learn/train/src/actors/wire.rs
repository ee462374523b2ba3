//! Steps and weights as messages.

use crate::collector::CollectorStats;
use crate::replay::{self, RowError, RowKind, Step};
use surefoot_policy::{ActorConfig, CheckpointError, Manifest, Policy};
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::learn::v1 as wire;

/// Why a step is not usable.
#[derive(Debug, thiserror::Error)]
pub(super) enum StepError {
    /// A field has a wrong length or value.
    #[error("{0}")]
    Field(#[from] FieldError),
    /// The rows are malformed.
    #[error("rows: {0}")]
    Rows(#[from] RowError),
    /// Numbers of steps begin with 1.
    #[error("number is 0: the first step of an actor has number 1")]
    Number,
}

/// A step as a message.
pub(super) fn step_to_wire(number: u64, is_new: bool, step: &Step, stats: CollectorStats) -> wire::FeedStep {
    wire::FeedStep {
        number,
        version: step.version,
        rows: replay::rows_to_bytes(step),
        memory: convert::pack(step.memory.iter().copied()),
        is_new,
        episodes: stats.episodes as u32,
        reached: stats.reached as u32,
    }
}

/// Decodes a step of `npc_count` NPCs with a policy of these sizes.
pub(super) fn step(
    message: &wire::FeedStep,
    npc_count: usize,
    network: &ActorConfig,
) -> Result<(Step, CollectorStats), StepError> {
    if message.number == 0 {
        return Err(StepError::Number);
    }
    let mut step = replay::rows_from_bytes(&message.rows, npc_count)?;
    step.memory = convert::unpack(&message.memory, npc_count * network.hidden_len(), "step.memory")?;
    if !step.memory.iter().all(|value| value.is_finite()) {
        return Err(FieldError::NotFinite("step.memory").into());
    }
    step.version = message.version;
    let acted = || step.kinds.iter().zip(&step.rewards).filter(|(kind, _)| **kind != RowKind::Boundary);
    let stats = CollectorStats {
        decisions: acted().count() as u64,
        episodes: message.episodes.into(),
        reached: message.reached.into(),
        reward: acted().map(|(_, reward)| f64::from(*reward)).sum(),
    };
    Ok((step, stats))
}

/// A policy as a message.
pub(super) fn weights_to_wire((policy, version): &(Policy, u64)) -> wire::Weights {
    wire::Weights { version: *version, weights: policy.weights().to_vec() }
}

/// Decodes a policy of these sizes.
pub(super) fn policy(
    message: &wire::Weights,
    name: &str,
    network: ActorConfig,
) -> Result<(Policy, u64), CheckpointError> {
    let manifest = Manifest::new(name, network, &message.weights, serde_json::Value::Null);
    Ok((Policy::from_bytes(manifest, &message.weights)?, message.version))
}
