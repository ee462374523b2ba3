//! Builds as those see them who wait for one or list them.

use crate::error::PlannerError;
use crate::hosted::Hosted;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Weak};
use surefoot_planner::Progress;
use tokio::sync::watch;

/// A build that is going on, or its end.
pub(crate) type JobState = Option<Result<Arc<Hosted>, PlannerError>>;

/// A build that several requests may share.
#[derive(Debug, Clone)]
pub struct Job {
    pub(crate) interest: Arc<Interest>,
    pub(crate) state: watch::Receiver<JobState>,
}

impl Job {
    /// Where it stands.
    pub fn progress(&self) -> Arc<Progress> {
        self.interest.progress.clone()
    }

    /// Waits until it has ended.
    ///
    /// # Errors
    /// If the graph cannot be built.
    pub async fn finished(&mut self) -> Result<Arc<Hosted>, PlannerError> {
        match self.state.wait_for(Option::is_some).await {
            Ok(state) => state.clone().expect("waited for it"),
            Err(_) => Err(PlannerError::Lost { what: "the build", reason: "it was lost: ask again".to_owned() }),
        }
    }
}

/// Held by all who wait for a build; when the last of them leaves, it is cancelled.
#[derive(Debug)]
pub(crate) struct Interest {
    pub progress: Arc<Progress>,
}

impl Drop for Interest {
    fn drop(&mut self) {
        self.progress.cancel.store(true, Ordering::Relaxed);
    }
}

/// A build that runs or waits for its turn.
#[derive(Debug)]
pub(crate) struct Listed {
    pub interest: Weak<Interest>,
    pub progress: Arc<Progress>,
    pub state: watch::Receiver<JobState>,
}
