//! The signal that stops every part of a process.

use crate::status;
use std::future::Future;
use std::time::Duration;
use surefoot_proto::reason::Reason;
use tokio::sync::watch;
use tonic::Status;

/// Typical time that a service needs to restart.
const RESTART: Duration = Duration::from_secs(2);

/// The signal that stops every part of a process; clones share it.
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
            // If all senders are dropped before the value is set, the process is ending anyway.
            let _ = receiver.wait_for(|&stopping| stopping).await;
        }
    }
}

/// Returns the status that ends streams when an endpoint drains.
pub fn shutting_down() -> Status {
    status::retry(Reason::ShuttingDown, RESTART, "the service is shutting down: reconnect later")
}
