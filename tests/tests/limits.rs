//! Every limit of an endpoint, exceeded on purpose; clients within the limits continue.

use e2e::{
    LIMIT, Running, build_to_end, create_world, metrics, planner_client, small_map, start_of, start_planner,
    start_server_at, world_client,
};
use std::io::ErrorKind;
use std::time::Duration;
use surefoot_net::serving::{EndpointConfig, Limits};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::planner::v1 as plan;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_server::ServerConfig;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio_stream::StreamExt;
use tonic::transport::Channel;
use tonic::{Code, Request, Streaming};

/// The HTTP/2 client preface with empty settings.
const GREETING: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\x00\x00\x00\x04\x00\x00\x00\x00\x00";
const SHORT: Duration = Duration::from_millis(200);

fn server_with(change: impl FnOnce(&mut Limits)) -> Running {
    let mut limits = Limits::default();
    change(&mut limits);
    start_server_at(EndpointConfig { limits, ..Default::default() }, ServerConfig::default())
}

/// Resolves when the peer has closed the connection.
async fn closed(socket: &mut TcpStream) {
    let reading = async {
        let mut bytes = [0; 1024];
        loop {
            match socket.read(&mut bytes).await {
                Ok(0) => return,
                Ok(_) => {}
                Err(error) if error.kind() == ErrorKind::ConnectionReset => return,
                Err(error) => panic!("{error}"),
            }
        }
    };
    tokio::time::timeout(Duration::from_secs(20), reading).await.expect("the server closes the connection");
}

async fn connect(server: &Running) -> TcpStream {
    TcpStream::connect(server.address()).await.unwrap()
}

async fn watch(client: &mut WorldServiceClient<Channel>, world_id: u64) -> Streaming<wire::WatchWorldResponse> {
    let request = wire::WatchWorldRequest { world_id, rate_hz: 30.0, ..Default::default() };
    let mut stream = client.watch_world(request).await.unwrap().into_inner();
    stream.next().await.unwrap().unwrap();
    stream
}

/// The value of a metric without labels.
async fn figure(server: &Running, name: &str) -> u64 {
    let page = metrics(server, "").await;
    let line = page.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    line.unwrap_or_else(|| panic!("no {name} in {page}")).parse().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_control_message_may_have_one_mebibyte() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let of_len = |len: usize| plan::GetGraphRequest { graph_id: "x".repeat(len), ..Default::default() };
    let refused = client.get_graph(of_len((1 << 20) + 1)).await.unwrap_err();
    assert_eq!(refused.code(), Code::OutOfRange, "{refused}");
    // The same connection continues, and accepts a message just below the limit.
    let read = client.get_graph(of_len((1 << 20) - 16)).await.unwrap_err();
    assert_eq!(read.code(), Code::InvalidArgument, "{read}");
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stream_too_many_waits_and_other_connections_go_on() {
    let server = server_with(|limits| limits.max_streams = 2);
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 1, wire::TimeMode::Realtime).await.world_id;
    let first = watch(&mut client, world_id).await;
    let mut second = watch(&mut client, world_id).await;
    let mut third_client = client.clone();
    let third = tokio::spawn(async move { third_client.list_worlds(wire::ListWorldsRequest::default()).await });
    let mut other = world_client(&server).await;
    for _ in 0..20 {
        other.list_worlds(wire::ListWorldsRequest::default()).await.unwrap();
        second.next().await.unwrap().unwrap();
    }
    assert!(!third.is_finished(), "a third stream was let in");
    drop(first);
    third.await.unwrap().unwrap();
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_connection_too_many_takes_an_unknown_ones_place_or_is_closed_at_once_and_counted() {
    let server = server_with(|limits| limits.max_connections = 2);
    let mut client = world_client(&server).await;
    client.list_worlds(wire::ListWorldsRequest::default()).await.unwrap();
    // A stranger takes the second slot, and loses it to a client.
    let mut stranger = connect(&server).await;
    let mut second = world_client(&server).await;
    second.list_worlds(wire::ListWorldsRequest::default()).await.unwrap();
    closed(&mut stranger).await;
    // Two known clients keep their slots.
    let mut third = connect(&server).await;
    closed(&mut third).await;
    client.list_worlds(wire::ListWorldsRequest::default()).await.unwrap();
    drop(second);
    // The second's slot is free once the server has noticed its disconnect.
    let mut newcomer = loop {
        let Ok(mut newcomer) = WorldServiceClient::connect(server.uri.clone()).await else { continue };
        if newcomer.list_worlds(wire::ListWorldsRequest::default()).await.is_ok() {
            break newcomer;
        }
    };
    drop(client);
    newcomer.list_worlds(wire::ListWorldsRequest::default()).await.unwrap();
    let refused = loop {
        // The metrics page needs a connection too, whose slot the first client frees.
        let page = metrics_or_nothing(&server).await;
        if let Some(refused) = page.lines().find_map(|line| line.strip_prefix("surefoot_connections_refused_total ")) {
            break refused.parse::<u64>().unwrap();
        }
    };
    assert!(refused >= 1);
    server.stop().await;
}

/// The metrics page, or the part received before the connection was closed.
async fn metrics_or_nothing(server: &Running) -> String {
    let mut text = String::new();
    if let Ok(mut socket) = TcpStream::connect(server.address()).await {
        // If the connection is closed at once, either of these may fail.
        let _ = socket.write_all(b"GET /metrics HTTP/1.1\r\nHost: here\r\nConnection: close\r\n\r\n").await;
        let _ = socket.read_to_string(&mut text).await;
    }
    text
}

#[tokio::test(flavor = "multi_thread")]
async fn who_does_not_begin_to_talk_is_cut_off() {
    let server = server_with(|limits| limits.handshake_timeout = Duration::from_secs(1));
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 1, wire::TimeMode::Realtime).await.world_id;
    let mut stream = watch(&mut client, world_id).await;
    let mut silent = connect(&server).await;
    let mut hesitant = connect(&server).await;
    hesitant.write_all(&GREETING[..10]).await.unwrap();
    closed(&mut silent).await;
    closed(&mut hesitant).await;
    stream.next().await.unwrap().unwrap();
    assert_eq!(figure(&server, "surefoot_connections_cut_total").await, 2);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn who_falls_silent_is_cut_off_and_who_answers_pings_is_not() {
    let server = server_with(|limits| {
        limits.idle_timeout = Duration::from_secs(2);
        limits.keepalive_interval = SHORT;
    });
    let mut client = world_client(&server).await;
    // The watch of a lockstep world without a worker sends nothing.
    let world_id = create_world(&mut client, 1, wire::TimeMode::Lockstep).await.world_id;
    let mut quiet = watch(&mut client, world_id).await;
    let mut silent = connect(&server).await;
    silent.write_all(b"GET /metrics HTTP/1.1\r\nHost: here\r\n\r\n").await.unwrap();
    closed(&mut silent).await;
    assert_eq!(figure(&server, "surefoot_connections_cut_total").await, 1);
    // The silent stream outlasts the limit, and its end still arrives.
    world_client(&server).await.drop_world(wire::DropWorldRequest { world_id }).await.unwrap();
    assert_eq!(quiet.next().await.unwrap().unwrap_err().code(), Code::NotFound);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn who_does_not_answer_pings_is_cut_off() {
    let server =
        server_with(|limits| (limits.keepalive_interval, limits.keepalive_timeout) = (SHORT, Duration::from_secs(1)));
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 1, wire::TimeMode::Realtime).await.world_id;
    let mut stream = watch(&mut client, world_id).await;
    let mut deaf = connect(&server).await;
    deaf.write_all(GREETING).await.unwrap();
    closed(&mut deaf).await;
    stream.next().await.unwrap().unwrap();
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_call_without_a_deadline_gets_one_and_streams_last() {
    let server = server_with(|limits| limits.default_deadline = Duration::from_millis(500));
    let mut client = world_client(&server).await;
    let mut create = Request::new(wire::CreateWorldRequest { map: Some(small_map(1)), mode: 0, ..Default::default() });
    create.set_timeout(Duration::from_secs(60));
    let world_id = client.create_world(create).await.unwrap().into_inner().world.unwrap().world_id;
    let stream = watch(&mut client, world_id).await;
    // A worker that never sends hello gets no answer.
    let overdue = client.work(tokio_stream::pending()).await.unwrap_err();
    assert_eq!(overdue.code(), Code::DeadlineExceeded);
    assert!(overdue.message().contains("--default-deadline"), "{overdue}");
    // The call's own deadline overrides the default.
    let mut patient = Request::new(tokio_stream::pending());
    patient.set_timeout(Duration::from_secs(1));
    let overdue = client.work(patient).await.unwrap_err();
    assert!(!overdue.message().contains("--default-deadline"), "{overdue}");
    // The stream lasts 30 snapshots, far beyond the deadline.
    assert_eq!(stream.take(30).filter(Result::is_ok).collect::<Vec<_>>().await.len(), 30);
    server.stop().await;
}

#[test]
fn searches_and_whole_graphs_take_no_thread_of_the_runtime_and_hold_up_nobody() {
    const BLOCKING: usize = 8;
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .max_blocking_threads(BLOCKING)
        .enable_all()
        .build()
        .unwrap();
    runtime.block_on(async {
        let cache = tempfile::tempdir().unwrap();
        let planner = start_planner(cache.path(), PlannerConfig::default());
        let mut client = planner_client(&planner).await;
        let graph_id = build_to_end(&mut client, start_of(1)).await.graph_id;
        let whole = plan::GetGraphRequest { graph_id: graph_id.clone(), ..Default::default() };
        let graph = client.get_graph(whole.clone()).await.unwrap().into_inner();
        let edge = &graph.edges[0];
        // From here on, no thread that may block is free.
        let (started, mut starts) = tokio::sync::mpsc::channel(BLOCKING);
        let (release, _) = tokio::sync::broadcast::channel::<()>(1);
        for _ in 0..BLOCKING {
            let (started, mut released) = (started.clone(), release.subscribe());
            tokio::task::spawn_blocking(move || {
                started.blocking_send(()).unwrap();
                released.blocking_recv().unwrap();
            });
        }
        for _ in 0..BLOCKING {
            starts.recv().await.unwrap();
        }
        let (mut plans, mut graphs) = (client.clone(), client.clone());
        let [start, goal] = [edge.from, edge.to].map(|vertex| Some(graph.vertices[vertex as usize]));
        let query = Some(plan::PathQuery { start, goal, ..Default::default() });
        let query = plan::FindPathRequest { graph_id: graph_id.clone(), query, ..Default::default() };
        let planned = tokio::spawn(async move { plans.find_path(query).await.unwrap().into_inner() });
        let whole = tokio::spawn(async move { graphs.get_graph(whole).await.unwrap().into_inner() });
        let failed = plan::Traversal { from: edge.from, to: edge.to, ..Default::default() };
        for _ in 0..100 {
            let report = plan::ReportTraversalsRequest {
                graph_id: graph_id.clone(),
                traversals: vec![failed],
                ..Default::default()
            };
            assert_eq!(client.report_traversals(report).await.unwrap().into_inner().accepted, 1);
        }
        assert!(!planned.is_finished() && !whole.is_finished(), "they wait for a thread that may block");
        release.send(()).unwrap();
        assert!(planned.await.unwrap().plan.unwrap().found);
        assert_eq!(whole.await.unwrap().edges.len(), graph.edges.len());
        planner.stop().await;
    });
}

#[tokio::test(flavor = "multi_thread")]
async fn a_deadline_has_a_longest_and_counts_in_its_own_protocol_only() {
    let server = server_with(|limits| {
        limits.default_deadline = Duration::from_millis(300);
        limits.max_deadline = Duration::from_millis(600);
    });
    let mut client = world_client(&server).await;
    // A worker that never sends hello gets no answer.
    let mut overdue = async |name: &'static str, value: &str| {
        let mut request = Request::new(tokio_stream::pending());
        request.metadata_mut().insert(name, value.parse().unwrap());
        let answer = tokio::time::timeout(LIMIT, client.work(request)).await.expect("every call has a deadline");
        let status = answer.unwrap_err();
        assert_eq!(status.code(), Code::DeadlineExceeded, "{status}");
        status.message().to_owned()
    };
    assert!(overdue("grpc-timeout", "99999999H").await.contains("--max-deadline"));
    for (name, value) in [("grpc-timeout", "soon"), ("connect-timeout-ms", "99999999"), ("connect-timeout-ms", "soon")]
    {
        assert!(overdue(name, value).await.contains("--default-deadline"), "{name}: {value}");
    }
    server.stop().await;
}
