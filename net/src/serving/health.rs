//! The health that an endpoint reports: of the whole process, whose name is empty, and of each service.

use super::shutdown::Shutdown;
use tokio::sync::watch;
use tonic_health::ServingStatus;
use tonic_health::pb::health_server::{self, HealthServer};
use tonic_health::server::{HealthReporter, health_reporter};

/// The states that an endpoint's health depends on, and where they are reported.
pub(super) struct Health {
    reporter: HealthReporter,
    /// Names of the services, and the empty name of the process.
    names: Vec<String>,
    ready: watch::Receiver<bool>,
    lease: watch::Receiver<bool>,
}

impl Health {
    /// Creates the health service, and reports the present state of `services`. All are NOT_SERVING until `ready` is
    /// true. While `lease` is false, the services are NOT_SERVING and the process is not affected.
    pub async fn start(
        services: &[&str],
        ready: watch::Receiver<bool>,
        lease: watch::Receiver<bool>,
    ) -> (Self, HealthServer<impl health_server::Health>) {
        let (reporter, server) = health_reporter();
        let names = services.iter().copied().chain([""]).map(str::to_owned).collect();
        let health = Self { reporter, names, ready, lease };
        health.report().await;
        (health, server)
    }

    async fn report(&self) {
        let (is_ready, holds_lease) = (*self.ready.borrow(), *self.lease.borrow());
        self.set(|name| is_ready && (holds_lease || name.is_empty())).await;
    }

    async fn set(&self, serves: impl Fn(&str) -> bool) {
        for name in &self.names {
            let status = if serves(name) { ServingStatus::Serving } else { ServingStatus::NotServing };
            self.reporter.set_service_status(name, status).await;
        }
    }

    /// Reports changes until `shutdown`, and then NOT_SERVING for all names.
    pub async fn follow(&self, shutdown: &Shutdown) {
        // A state whose sender was dropped does not change any more.
        async fn changed(state: &mut watch::Receiver<bool>) {
            if state.changed().await.is_err() {
                std::future::pending::<()>().await;
            }
        }
        let (mut ready, mut lease, stopping) = (self.ready.clone(), self.lease.clone(), shutdown.wait());
        tokio::pin!(stopping);
        loop {
            tokio::select! {
                () = changed(&mut ready) => self.report().await,
                () = changed(&mut lease) => self.report().await,
                () = &mut stopping => break,
            }
        }
        self.set(|_| false).await;
    }

    /// Ends the streams of clients that watch the health.
    pub async fn end_watches(&mut self) {
        for name in &self.names {
            self.reporter.clear_service_status(name).await;
        }
    }
}
