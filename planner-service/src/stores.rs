//! What a planner stores its data in, alone or together with other planners.

use crate::error::PlannerError;
use crate::replicas::Replicas;
use std::sync::Arc;
use surefoot_net::levels::LevelArchive;
use surefoot_planner::store::{Call, GraphStore};

/// The stores of a planner. Clones share them.
#[derive(Clone)]
pub struct PlannerStores {
    /// Graphs, layers and evidence.
    pub store: Arc<dyn GraphStore>,
    /// What planners that share `store` agree on; `None` if this planner has it for itself.
    pub replicas: Option<Arc<dyn Replicas>>,
    /// Imported levels; `None` if they are kept in memory only.
    pub levels: Option<Arc<dyn LevelArchive>>,
}

impl<S: GraphStore + 'static> From<Box<S>> for PlannerStores {
    fn from(store: Box<S>) -> Self {
        Self { store: Arc::from(store as Box<dyn GraphStore>), replicas: None, levels: None }
    }
}

impl PlannerStores {
    /// Returns the answer that a call got when it was carried out; `None` if it has not been, or has no request id.
    /// Call this from a thread that may block.
    pub(crate) fn first_answer(&self, call: Option<&Call>) -> Result<Option<Vec<u8>>, PlannerError> {
        let Some(call) = call else { return Ok(None) };
        let found = self.store.receipt(&call.client, &call.id);
        match found.map_err(PlannerError::store("the call cannot be looked up"))? {
            Some(receipt) if receipt.call.request != call.request => {
                Err(PlannerError::RequestIdReused(call.id.clone()))
            }
            found => Ok(found.map(|receipt| receipt.answer)),
        }
    }
}
