//! The servers of a fleet, from their directory.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::collections::BTreeSet;
use std::hash::{BuildHasher, RandomState};
use std::time::Duration;
use surefoot_net::client::{Credentials, Link, LinkError};
use surefoot_proto::world::v1::ListServersRequest;
use surefoot_proto::world::v1::directory_service_client::DirectoryServiceClient;
use tokio::sync::watch;
use tonic::Status;
use tracing::warn;

/// Longest wait for an answer.
const LOOK_LIMIT: Duration = Duration::from_secs(2);

/// When and where a worker queries the directory.
#[derive(Debug, Clone, Copy)]
pub(super) struct LookUps {
    /// Time between two queries. Each pause is up to a quarter longer or shorter, so that workers do not query all at
    /// once.
    pub every: Duration,
    /// Determines the server that a worker queries, so that workers spread over the servers.
    pub seed: u64,
}

impl Default for LookUps {
    fn default() -> Self {
        Self { every: Duration::from_secs(2), seed: RandomState::new().hash_one("looks") }
    }
}

/// Keeps `listed` up to date while it has receivers. One listed server or seed answers on one connection until it
/// fails; then another one answers. If none answers, the list stays unchanged.
pub(super) async fn follow(
    credentials: Credentials,
    seeds: Vec<String>,
    listed: watch::Sender<BTreeSet<String>>,
    looks: LookUps,
) -> Result<(), LinkError> {
    let mut rng = ChaCha8Rng::seed_from_u64(looks.seed);
    let mut is_failing = false;
    let mut answering: Option<(String, Link)> = None;
    while !listed.is_closed() {
        let known: BTreeSet<String> = listed.borrow().iter().chain(&seeds).cloned().collect();
        let mut known: Vec<String> = known.into_iter().collect();
        // The server that answered last comes first; otherwise a random one.
        let former = answering.as_ref().and_then(|(former, _)| known.iter().position(|address| address == former));
        let count = known.len();
        let first = former.unwrap_or_else(|| rng.random_range(0..count.max(1)));
        known.rotate_left(first.min(count));
        let mut answer = Err(Status::unavailable("no server is known"));
        for address in known {
            let link = match answering.take().filter(|(former, _)| *former == address) {
                Some((_, link)) => link,
                None => credentials.dial(&address)?.connect_lazy(),
            };
            let looked = tokio::time::timeout(LOOK_LIMIT, look(link.clone(), &address)).await;
            answer = looked.unwrap_or_else(|_| Err(Status::deadline_exceeded(format!("{address} does not answer"))));
            if answer.is_ok() {
                answering = Some((address, link));
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
                    warn!(%status, "no server answered ListServers: trying again");
                }
            }
        }
        tokio::time::sleep(looks.every.mul_f64(rng.random_range(0.75..1.25))).await;
    }
    Ok(())
}

/// The servers that the one at `address` lists.
async fn look(link: Link, address: &str) -> Result<BTreeSet<String>, Status> {
    let listed = DirectoryServiceClient::new(link).list_servers(ListServersRequest {}).await?;
    let servers = listed.into_inner().servers.into_iter();
    // A server without a fleet lists itself without an address.
    Ok(servers.map(|server| if server.address.is_empty() { address.to_owned() } else { server.address }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::SocketAddr;
    use std::sync::{Arc, Mutex};
    use surefoot_net::serving::Shutdown;
    use surefoot_proto::world::v1::directory_service_server::{DirectoryService, DirectoryServiceServer};
    use surefoot_proto::world::v1::{ListServersResponse, LocateWorldRequest, LocateWorldResponse, ServerInfo};
    use tonic::transport::server::TcpIncoming;
    use tonic::{Request, Response};

    /// The directory and the peer of each query, in order, for all directories that share this value.
    type Peers = watch::Sender<Vec<(SocketAddr, SocketAddr)>>;

    /// A directory of `servers` that records its peers.
    struct Fake {
        own: SocketAddr,
        servers: Arc<Mutex<Vec<String>>>,
        peers: Peers,
    }

    #[tonic::async_trait]
    impl DirectoryService for Fake {
        async fn locate_world(&self, _: Request<LocateWorldRequest>) -> Result<Response<LocateWorldResponse>, Status> {
            Err(Status::unimplemented("not used"))
        }

        async fn list_servers(
            &self,
            request: Request<ListServersRequest>,
        ) -> Result<Response<ListServersResponse>, Status> {
            let peer = request.remote_addr().unwrap();
            self.peers.send_modify(|peers| peers.push((self.own, peer)));
            let info = |address: &String| ServerInfo { address: address.clone(), ..ServerInfo::default() };
            let servers = self.servers.lock().unwrap().iter().map(info).collect();
            Ok(Response::new(ListServersResponse { servers }))
        }
    }

    /// Directories that list one another, each with the signal that ends it.
    fn directories(count: usize) -> (Vec<(String, Shutdown)>, Peers) {
        let (servers, peers): (Arc<Mutex<Vec<String>>>, Peers) = Default::default();
        let start = |_| {
            let incoming = TcpIncoming::bind(SocketAddr::from(([127, 0, 0, 1], 0))).unwrap();
            let own = incoming.local_addr().unwrap();
            let address = format!("http://{own}");
            servers.lock().unwrap().push(address.clone());
            let service = DirectoryServiceServer::new(Fake { own, servers: servers.clone(), peers: peers.clone() });
            let stop = Shutdown::default();
            let end = stop.wait();
            tokio::spawn(async move {
                let server = tonic::transport::Server::builder().add_service(service);
                server.serve_with_incoming_shutdown(incoming, end).await.unwrap();
            });
            (address, stop)
        };
        ((0..count).map(start).collect(), peers)
    }

    fn start_worker(seeds: Vec<String>, seed: u64) -> watch::Receiver<BTreeSet<String>> {
        let (listing, listed) = watch::channel(BTreeSet::new());
        let looks = LookUps { every: Duration::from_millis(5), seed };
        tokio::spawn(follow(Credentials::default(), seeds, listing, looks));
        listed
    }

    async fn until(peers: &Peers, enough: impl FnMut(&Vec<(SocketAddr, SocketAddr)>) -> bool) {
        let waiting = tokio::time::timeout(Duration::from_secs(60), async {
            _ = peers.subscribe().wait_for(enough).await.unwrap();
        });
        waiting.await.unwrap();
    }

    #[tokio::test]
    async fn a_worker_looks_over_one_connection_and_changes_the_server_only_when_it_fails() {
        let (servers, peers) = directories(2);
        let mut listed = start_worker(vec![servers[0].0.clone()], 1);
        listed.wait_for(|listed| listed.len() == 2).await.unwrap();
        until(&peers, |peers| peers.len() >= 20).await;
        let first = peers.borrow()[0];
        assert!(peers.borrow().iter().all(|peer| *peer == first), "{:?}", peers.borrow());
        servers[0].1.trigger();
        until(&peers, |peers| peers.iter().filter(|peer| peer.0 != first.0).count() >= 20).await;
        let all = peers.borrow().clone();
        let then: BTreeSet<_> = all.iter().filter(|peer| peer.0 != first.0).collect();
        assert_eq!(then.len(), 1, "one connection to the other server");
    }

    #[tokio::test]
    async fn workers_spread_over_the_servers() {
        let (servers, peers) = directories(2);
        let seeds: Vec<String> = servers.iter().map(|(address, _)| address.clone()).collect();
        let _listed: Vec<_> = (0..16).map(|seed| start_worker(seeds.clone(), seed)).collect();
        until(&peers, |peers| peers.iter().collect::<BTreeSet<_>>().len() == 16).await;
        let looked_at: BTreeSet<SocketAddr> = peers.borrow().iter().map(|(server, _)| *server).collect();
        assert_eq!(looked_at.len(), 2);
    }
}
