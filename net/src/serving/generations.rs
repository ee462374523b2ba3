//! Serves connections with the current certificate.
//!
//! When its files change, new connections go to a new generation of the server. The old generation finishes its calls
//! and streams, and asks its peers to reconnect for their next calls.

use super::files::RELOAD_PERIOD;
use super::incoming::{Connection, Incoming};
use super::security::ServerTls;
use super::shutdown::Shutdown;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval};
use tokio_stream::StreamExt;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::{Error, Server};
use tracing::{info, warn};

const UNCHANGED: &str = "endpoint: cannot use the changed certificate; the previous one stays in use";

/// A server, and the parts that all its generations share.
pub(super) struct Generations {
    /// Without TLS.
    pub server: Server,
    pub router: axum::Router,
    pub handshake_timeout: Duration,
    /// Ends all generations once their calls have ended.
    pub stop: Shutdown,
}

type Running = JoinSet<Result<(), Error>>;

impl Generations {
    /// Serves until all connections have ended after `stop`.
    pub async fn serve(self, mut incoming: Incoming, mut tls: Option<ServerTls>) -> Result<(), Error> {
        let mut running = JoinSet::new();
        let mut current = self.start(tls.as_ref(), &mut running)?;
        let mut looks = interval(RELOAD_PERIOD);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                () = self.stop.wait() => break,
                connection = incoming.next() => {
                    let Some(connection) = connection else { break };
                    // Generations accept connections until `stop`.
                    let _ = current.send(connection).await;
                }
                _ = looks.tick() => match tls.as_mut().and_then(ServerTls::renew) {
                    None => {}
                    Some(Ok(())) => match self.start(tls.as_ref(), &mut running) {
                        Ok(next) => {
                            current = next;
                            info!("endpoint: certificate reloaded");
                        }
                        Err(error) => warn!(%error, "{UNCHANGED}"),
                    },
                    Some(Err(error)) => warn!(%error, "{UNCHANGED}"),
                },
            }
        }
        drop((incoming, current));
        while let Some(ended) = running.join_next().await {
            match ended {
                Ok(result) => result?,
                Err(error) => std::panic::resume_unwind(error.into_panic()),
            }
        }
        Ok(())
    }

    /// Starts a generation, and returns the queue of its connections.
    fn start(
        &self,
        tls: Option<&ServerTls>,
        running: &mut Running,
    ) -> Result<mpsc::Sender<std::io::Result<Connection>>, Error> {
        let mut server = self.server.clone();
        if let Some(tls) = tls {
            server = server.tls_config(tls.config(self.handshake_timeout))?;
        }
        let (sender, receiver) = mpsc::channel(1);
        let stop = self.stop.clone();
        let router = server.add_routes(self.router.clone().into());
        running.spawn(router.serve_with_incoming_shutdown(ReceiverStream::new(receiver), async move {
            stop.wait().await;
        }));
        Ok(sender)
    }
}
