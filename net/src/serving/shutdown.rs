//! How every part of a process learns that it is time to stop.

use crate::status;
use std::future::Future;
use std::time::Duration;
use surefoot_proto::reason::Reason;
use tokio::sync::watch;
use tonic::Status;

/// A service that restarts is back after about this long.
const RESTART: Duration = Duration::from_secs(2);

/// Tells every part of a process that it is time to stop.
#[derive(Debug, Clone)]
pub struct Shutdown {
    sender: watch::Sender<bool>,
}

impl Default for Shutdown {
    fn default() -> Self {
        Self { sender: watch::Sender::new(false) }
    }
}

impl Shutdown {
    /// Starts the shutdown; further calls do nothing.
    pub fn trigger(&self) {
        self.sender.send_replace(true);
    }

    /// Whether the shutdown has begun.
    pub fn is_triggered(&self) -> bool {
        *self.sender.borrow()
    }

    /// Resolves once the shutdown has begun.
    pub fn wait(&self) -> impl Future<Output = ()> + Send + 'static {
        let mut receiver = self.sender.subscribe();
        async move {
            // The sender cannot be gone before the value is set without the process ending anyway.
            let _ = receiver.wait_for(|&stopping| stopping).await;
        }
    }
}

/// The status that ends streams when an endpoint drains.
pub fn going_away() -> Status {
    status::retry(Reason::ShuttingDown, RESTART, "the service is shutting down: connect again later")
}
