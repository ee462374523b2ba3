//! A game client of a fleet: it finds the server of its world in the directory, follows the events of the world to any
//! server, and counts them.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::directory_service_client::DirectoryServiceClient;
use surefoot_proto::world::v1::npc_event::Event;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use tokio::task::JoinHandle;
use tonic::Status;
use tonic::transport::{Channel, Endpoint};

/// Longest wait for an answer, after which another server is asked.
const PATIENCE: Duration = Duration::from_secs(1);
/// Time between two looks into the directory.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// A connection to a server.
pub async fn dial(uri: &str) -> Result<Channel, Status> {
    let endpoint = Endpoint::from_shared(uri.to_owned()).expect("a URI").connect_timeout(PATIENCE);
    endpoint.connect().await.map_err(|error| Status::unavailable(error.to_string()))
}

/// The server of a world, by the first of `servers` that knows it.
pub async fn locate(servers: &[String], world_id: u64) -> Option<String> {
    for server in servers {
        let ask = async {
            let mut directory = DirectoryServiceClient::new(dial(server).await?);
            directory.locate_world(wire::LocateWorldRequest { world_id }).await
        };
        if let Ok(Ok(found)) = tokio::time::timeout(PATIENCE, ask).await {
            return found.into_inner().server.map(|server| server.address);
        }
    }
    None
}

/// A client of the server that has a world, once there is one.
pub async fn client_of(servers: &[String], world_id: u64) -> WorldServiceClient<Channel> {
    let since = std::time::Instant::now();
    loop {
        if let Some(address) = locate(servers, world_id).await
            && let Ok(channel) = dial(&address).await
        {
            let mut client = WorldServiceClient::new(channel);
            // A server that is stopped accepts connections and does not answer.
            let ask = client.get_world(wire::GetWorldRequest { world_id });
            if tokio::time::timeout(PATIENCE, ask).await.is_ok_and(|answer| answer.is_ok()) {
                return client;
            }
        }
        assert!(since.elapsed() < surefoot_processes::LIMIT, "no server has world {world_id}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// An attempt: its NPC, and its number.
pub type Attempt = (u64, u32);

/// Events that the client has received.
#[derive(Debug, Default)]
pub struct Told {
    /// How often each attempt began.
    pub began: BTreeMap<Attempt, u32>,
    /// How each attempt ended, every time that it did.
    pub ended: BTreeMap<Attempt, Vec<wire::Outcome>>,
    /// Sequence numbers of events.
    pub sequences: BTreeSet<u64>,
    /// Events that were received again.
    pub repeated_count: u64,
    /// Times that events were lost.
    pub lost_count: u64,
}

/// A client that follows the events of a world.
#[derive(Debug)]
pub struct Chronicle {
    told: Arc<Mutex<Told>>,
    task: JoinHandle<()>,
}

impl Chronicle {
    /// Follows a world from its first event on.
    pub fn follow(servers: &[String], world_id: u64) -> Self {
        let told = Arc::new(Mutex::new(Told::default()));
        let task = tokio::spawn(follow(servers.to_vec(), world_id, told.clone()));
        Self { told, task }
    }

    /// Reads the received events.
    pub fn read<T>(&self, read: impl FnOnce(&Told) -> T) -> T {
        read(&self.told.lock().expect("no holder panics"))
    }

    /// Number of attempts that have ended.
    pub fn ended_count(&self) -> usize {
        self.read(|told| told.ended.len())
    }

    /// Checks that all attempts that began, and all in `set`, have ended once, and that no event was received twice.
    pub fn check(&self, set: &BTreeSet<Attempt>) {
        self.read(|told| {
            assert_eq!((told.repeated_count, told.lost_count), (0, 0), "events told again, and lost");
            let twice = told.ended.iter().find(|(_, ends)| ends.len() != 1);
            assert_eq!(twice, None, "an attempt ends once");
            assert!(told.began.values().all(|&count| count == 1), "an attempt begins once");
            let open: Vec<_> = told.began.keys().filter(|attempt| !told.ended.contains_key(attempt)).collect();
            assert!(open.is_empty(), "attempts that never ended: {open:?}");
            let unknown: Vec<_> = set.iter().filter(|attempt| !told.began.contains_key(attempt)).collect();
            assert!(unknown.is_empty(), "attempts that were promised and never began: {unknown:?}");
        });
    }
}

impl Drop for Chronicle {
    fn drop(&mut self) {
        self.task.abort();
    }
}

async fn follow(servers: Vec<String>, world_id: u64, told: Arc<Mutex<Told>>) {
    let mut cursor = wire::EventCursor { epoch: world_id, sequence: 0 };
    loop {
        if let Some(address) = locate(&servers, world_id).await {
            let moved = async {
                // A server that is silent does not end its streams.
                while locate(&servers, world_id).await.is_none_or(|now| now == address) {
                    tokio::time::sleep(LOOK_EVERY).await;
                }
            };
            let ended = tokio::select! {
                status = read_from(&address, world_id, &mut cursor, &told) => status,
                () = moved => Status::aborted("it runs elsewhere"),
            };
            if Reason::of(&ended) == Some(Reason::EventsLost) {
                told.lock().expect("no holder panics").lost_count += 1;
            }
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// Reads events after `cursor` until the stream ends.
async fn read_from(address: &str, world_id: u64, cursor: &mut wire::EventCursor, told: &Mutex<Told>) -> Status {
    let reading = async {
        let mut client = WorldServiceClient::new(dial(address).await?);
        let request =
            wire::WatchEventsRequest { world_id, after: Some(*cursor), npc_ids: Vec::new(), ..Default::default() };
        let mut stream = client.watch_events(request).await?.into_inner();
        while let Some(message) = stream.message().await? {
            *cursor = message.cursor.unwrap_or(*cursor);
            let mut told = told.lock().expect("no holder panics");
            for event in message.events {
                told.repeated_count += u64::from(!told.sequences.insert(event.sequence));
                match event.event {
                    Some(Event::AttemptBegan(began)) => {
                        *told.began.entry((event.npc_id, began.attempt)).or_default() += 1;
                    }
                    Some(Event::AttemptEnded(ended)) => {
                        told.ended.entry((event.npc_id, ended.attempt)).or_default().push(ended.outcome());
                    }
                    _ => {}
                }
            }
        }
        Err(Status::aborted("the stream ended"))
    };
    reading.await.map_or_else(|status| status, |(): ()| Status::ok(""))
}
