//! The world server while unauthenticated clients flood it: tick times, and how long another client waits for an
//! answer.
//!
//! The flood runs on the same machine and takes its share of the cores, so ratios are upper bounds.

use super::serve::{Scene, TARGET_P99_MS};
use super::{Args, Figure};
use crate::processes::{Setup, connect};
use anyhow::Context;
use std::net::SocketAddr;
use std::time::{Duration, Instant};
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::task::JoinSet;
use tonic::transport::Channel;

const DEFAULT_NPCS: usize = 256;
/// Duration of each flood, and of the calm period before it.
const SPAN: Duration = Duration::from_secs(15);
const IDLE_SOCKETS: usize = 5_000;
/// Connections that never finish their handshake, twice as many as the server accepts.
const STALLED_HANDSHAKES: usize = 512;
const RESETTING_CONNECTIONS: usize = 4;
/// 10,000 streams: the server allows 128 per connection.
const STREAMING_CONNECTIONS: usize = 80;
const STREAMS_EACH: u32 = 125;
/// Pause before a flooding client reconnects after the server closed its connection.
const PAUSE: Duration = Duration::from_secs(1);
/// Longest time that a client may wait for an answer, ms.
const TARGET_ANSWER_MS: f64 = 1000.0;

/// Preface and empty settings of HTTP/2.
const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0";
/// `:method POST`, `:scheme http`, `:path /`, all from HPACK's static table.
const HEADERS: [u8; 3] = [0x83, 0x86, 0x84];

#[derive(Debug, Clone, Copy)]
enum Flood {
    /// Connections that send nothing.
    IdleSockets,
    /// Connections that send the preface of HTTP/2 byte by byte, one a second, and never finish it.
    StalledHandshakes,
    /// Streams that are opened and reset at once.
    RapidReset,
    /// Requests that begin and never end.
    OpenStreams,
}

impl Flood {
    /// All floods, with their names in figures and their numbers of connections.
    const ALL: [(Self, &str, usize); 4] = [
        (Self::IdleSockets, "idle_sockets", IDLE_SOCKETS),
        (Self::StalledHandshakes, "stalled_handshakes", STALLED_HANDSHAKES),
        (Self::RapidReset, "rapid_reset", RESETTING_CONNECTIONS),
        (Self::OpenStreams, "open_streams", STREAMING_CONNECTIONS),
    ];

    /// Floods over one connection until the server closes it.
    async fn run(self, address: SocketAddr) -> std::io::Result<()> {
        let mut socket = TcpStream::connect(address).await?;
        match self {
            Self::IdleSockets => {}
            Self::StalledHandshakes => {
                for byte in &PREFACE[..PREFACE.len() / 2] {
                    socket.write_all(&[*byte]).await?;
                    tokio::time::sleep(Duration::from_secs(1)).await;
                }
            }
            Self::RapidReset => return reset_streams(socket).await,
            Self::OpenStreams => {
                socket.write_all(PREFACE).await?;
                for idx in 0..STREAMS_EACH {
                    // END_HEADERS without END_STREAM announces a body.
                    socket.write_all(&frame(1, 0x4, 2 * idx + 1, &HEADERS)).await?;
                }
            }
        }
        // Reads until the server closes the connection.
        let mut answers = [0; 4096];
        while socket.read(&mut answers).await? > 0 {}
        Ok(())
    }
}

async fn reset_streams(socket: TcpStream) -> std::io::Result<()> {
    let (mut reader, mut writer) = socket.into_split();
    let writing = async {
        writer.write_all(PREFACE).await?;
        for idx in 0.. {
            let stream = 2 * (idx % (1 << 30)) + 1;
            let cancel = frame(3, 0, stream, &8_u32.to_be_bytes());
            writer.write_all(&[frame(1, 0x4, stream, &HEADERS), cancel].concat()).await?;
        }
        Ok(())
    };
    let reading = async {
        let mut answers = [0; 4096];
        while reader.read(&mut answers).await? > 0 {}
        Ok(())
    };
    tokio::select! { ended = writing => ended, ended = reading => ended }
}

/// A frame of HTTP/2.
fn frame(kind: u8, flags: u8, stream: u32, payload: &[u8]) -> Vec<u8> {
    let len = (payload.len() as u32).to_be_bytes();
    [&len[1..], &[kind, flags], &stream.to_be_bytes(), payload].concat()
}

pub fn figures(args: &Args) -> anyhow::Result<Vec<Figure>> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let cache = surefoot_cli::commands::services::CacheArgs::default_folder()?.join("bench-floods");
    runtime.block_on(async {
        let scene = Scene::start(Setup::new(args.npcs.unwrap_or(DEFAULT_NPCS), &cache)).await?;
        let server = scene.services.server_uri.trim_start_matches("http://");
        let address = server.parse().context("the server's address")?;
        let client = connect(&scene.services.server_uri).await?;
        scene.measure(SPAN).await?;
        let mut figures = Vec::new();
        for (flood, name, connection_count) in Flood::ALL {
            let calm = scene.measure(SPAN).await?;
            let mut connections = JoinSet::new();
            for _ in 0..connection_count {
                connections.spawn(async move {
                    loop {
                        // The server closed or refused the connection: connect again.
                        let _ = flood.run(address).await;
                        tokio::time::sleep(PAUSE).await;
                    }
                });
            }
            let (measured, answer_ms) = tokio::join!(scene.measure(SPAN), longest_answer_ms(&client));
            let (measured, answer_ms) = (measured?, answer_ms?);
            connections.shutdown().await;
            let ratio = measured.p99_ms() / calm.p99_ms();
            eprintln!("{flood:?}: tick p99 {:.2} ms, x {ratio:.2}; answers in {answer_ms:.0} ms", measured.p99_ms());
            figures.extend([
                Figure::new(format!("{name}_tick_p99_ms"), measured.p99_ms(), "ms").at_most(TARGET_P99_MS),
                Figure::new(format!("{name}_p99_ratio"), ratio, ""),
                Figure::new(format!("{name}_answer_ms"), answer_ms, "ms").at_most(TARGET_ANSWER_MS),
            ]);
        }
        Ok(figures)
    })
}

/// The longest that a client with a connection waits for an answer while the flood goes on, ms.
async fn longest_answer_ms(channel: &Channel) -> anyhow::Result<f64> {
    let mut client = WorldServiceClient::new(channel.clone());
    let (since, mut longest) = (Instant::now(), Duration::ZERO);
    while since.elapsed() < SPAN {
        let asked = Instant::now();
        client.list_worlds(wire::ListWorldsRequest::default()).await.context("the flood disconnected a client")?;
        longest = longest.max(asked.elapsed());
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    Ok(longest.as_secs_f64() * 1000.0)
}
