//! Which servers a worker of a fleet serves: those that their directory lists.

use std::collections::BTreeSet;
use std::time::Duration;
use surefoot_net::client::{Credentials, Dialer, LinkError};
use surefoot_proto::world::v1::ListServersRequest;
use surefoot_proto::world::v1::directory_service_client::DirectoryServiceClient;
use tokio::sync::watch;
use tonic::Status;
use tracing::warn;

/// Time between two looks into the directory.
const LOOK_EVERY: Duration = Duration::from_millis(500);
/// Longest wait for an answer.
const LOOK_LIMIT: Duration = Duration::from_secs(2);

/// Keeps `listed` up to date, as long as somebody needs it. Servers that were listed last and the `seeds` are asked in turn; if none answers,
/// the list stays as it is.
///
/// # Errors
/// If an address or the credentials cannot be used.
pub(super) async fn follow(
    credentials: Credentials,
    seeds: Vec<String>,
    listed: watch::Sender<BTreeSet<String>>,
) -> Result<(), LinkError> {
    let mut is_failing = false;
    while !listed.is_closed() {
        let known: BTreeSet<String> = listed.borrow().iter().chain(&seeds).cloned().collect();
        let mut answer = Err(Status::unavailable("no server is known"));
        for address in known {
            let dialer = credentials.dial(&address)?;
            let looked = tokio::time::timeout(LOOK_LIMIT, look(&dialer, &address)).await;
            answer = looked.unwrap_or_else(|_| Err(Status::deadline_exceeded(format!("{address} does not answer"))));
            if answer.is_ok() {
                break;
            }
        }
        match answer {
            Ok(servers) => {
                is_failing = false;
                listed.send_if_modified(|listed| {
                    let is_new = *listed != servers;
                    *listed = servers;
                    is_new
                });
            }
            Err(status) => {
                if !std::mem::replace(&mut is_failing, true) {
                    warn!(%status, "no server says which others there are: trying again");
                }
            }
        }
        tokio::time::sleep(LOOK_EVERY).await;
    }
    Ok(())
}

/// The servers that the one at `address` lists.
async fn look(dialer: &Dialer, address: &str) -> Result<BTreeSet<String>, Status> {
    let link = dialer.connect().await.map_err(|error| Status::unavailable(error.to_string()))?;
    let listed = DirectoryServiceClient::new(link).list_servers(ListServersRequest {}).await?;
    let servers = listed.into_inner().servers.into_iter();
    // A server that is alone has no address but the one at which it was asked.
    Ok(servers.map(|server| if server.address.is_empty() { address.to_owned() } else { server.address }).collect())
}
