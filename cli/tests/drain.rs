//! A service that receives a stop signal ends in time and cleanly, even if its peers hold connections open.
#![cfg(unix)]

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;
use surefoot_processes::Surefoot;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use tonic::transport::Channel;

/// Time within which the process must end.
const LIMIT: Duration = Duration::from_secs(10);
/// The HTTP/2 client preface with empty settings.
const GREETING: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\x00\x00\x00\x04\x00\x00\x00\x00\x00";

struct Server {
    service: Surefoot,
    _folder: tempfile::TempDir,
}

fn start_server() -> Server {
    let folder = tempfile::tempdir().unwrap();
    let service = Surefoot::start(&["serve", "--log-format", "json"], &[], &folder.path().join("log"));
    service.wait_until_it_listens();
    Server { service, _folder: folder }
}

impl Server {
    /// Sends SIGTERM, checks that the process ends in time with exit code 0, and returns the log.
    fn stop(mut self) -> String {
        self.service.process.stop_within(LIMIT);
        self.service.process.log()
    }
}

#[test]
fn with_a_peer_that_never_spoke() {
    let server = start_server();
    let silent = TcpStream::connect(server.service.address).unwrap();
    assert!(server.stop().contains("stopped serving"));
    drop(silent);
}

#[test]
fn with_a_peer_that_does_not_answer() {
    let server = start_server();
    let mut silent = TcpStream::connect(server.service.address).unwrap();
    silent.write_all(GREETING).unwrap();
    // The server's settings frame: it has accepted the connection.
    silent.read_exact(&mut [0; 9]).unwrap();
    assert!(server.stop().contains("stopped serving"));
    drop(silent);
}

#[test]
fn with_a_stream_that_nobody_reads() {
    let server = start_server();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let stream = runtime.block_on(async {
        // The server may send a few bytes of the stream before the client must read them.
        let endpoint =
            Channel::from_shared(format!("http://{}", server.service.address)).unwrap().initial_stream_window_size(8);
        let mut client = WorldServiceClient::new(endpoint.connect().await.unwrap());
        let size = Some(wire::MapSize { width: 60, height: 40, depth: 60 });
        let map = Some(wire::MapSpec { seed: 1, size, ..Default::default() });
        // Unary answers are longer than the window too, but the client reads them.
        let created = client
            .create_world(wire::CreateWorldRequest { map, mode: 0, ..Default::default() })
            .await
            .unwrap()
            .into_inner();
        let world_id = created.world.unwrap().world_id;
        client
            .watch_world(wire::WatchWorldRequest { world_id, rate_hz: 60.0, ..Default::default() })
            .await
            .unwrap()
            .into_inner()
    });
    assert!(server.stop().contains("stopped serving"));
    drop(stream);
}
