//! Health, metrics and the drain.

use e2e::{create_world, metrics, planner_client, start_planner, start_server, world_client};
use std::time::Duration;
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::world::v1 as wire;
use surefoot_server::ServerConfig;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio_stream::StreamExt;
use tonic::Code;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

#[tokio::test(flavor = "multi_thread")]
async fn both_services_report_their_health_by_name() {
    let cache = tempfile::tempdir().unwrap();
    let server = start_server(ServerConfig::default());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    for (service, name) in
        [(&server, "surefoot.world.v1.WorldService"), (&planner, "surefoot.planner.v1.PlannerService")]
    {
        let channel = tonic::transport::Endpoint::from_shared(service.uri.clone()).unwrap().connect().await.unwrap();
        let mut health = HealthClient::new(channel);
        for service in ["", name] {
            let request = tonic_health::pb::HealthCheckRequest { service: service.to_owned() };
            assert_eq!(health.check(request).await.unwrap().into_inner().status(), ServingStatus::Serving);
        }
    }
    drop(planner_client(&planner).await);
    planner.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn metrics_name_every_world() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let world = create_world(&mut client, 3, wire::TimeMode::Realtime).await;
    let text = metrics(&server, "").await;
    for line in [
        "surefoot_workers 0".to_owned(),
        format!("surefoot_npcs{{world=\"{}\",state=\"idle\"}} 0", world.world_id),
        "# TYPE surefoot_ticks_total counter".to_owned(),
    ] {
        assert!(text.contains(&line), "no `{line}` in {text}");
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_drain_ends_streams_and_does_not_wait_for_silent_peers() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let world = create_world(&mut client, 4, wire::TimeMode::Realtime).await;
    let mut snapshots = client
        .watch_world(wire::WatchWorldRequest { world_id: world.world_id, rate_hz: 30.0, ..Default::default() })
        .await
        .unwrap()
        .into_inner();
    snapshots.next().await.unwrap().unwrap();
    let silent = tokio::net::TcpStream::connect(server.uri.trim_start_matches("http://")).await.unwrap();
    let stopping = tokio::spawn(server.stop());
    let end = loop {
        match snapshots.next().await {
            Some(Ok(_)) => {}
            Some(Err(status)) => break status,
            None => panic!("the stream ended without a status"),
        }
    };
    assert_eq!(end.code(), Code::Unavailable);
    tokio::time::timeout(Duration::from_secs(10), stopping).await.expect("the drain has a deadline").unwrap();
    drop(silent);
}

#[tokio::test(flavor = "multi_thread")]
async fn health_says_at_once_that_a_service_goes_away() {
    let mut fastest = Duration::MAX;
    for name in ["", "surefoot.world.v1.WorldService", ""] {
        let server = start_server(ServerConfig::default());
        let channel = tonic::transport::Endpoint::from_shared(server.uri.clone()).unwrap().connect().await.unwrap();
        let mut health = HealthClient::new(channel);
        let request = tonic_health::pb::HealthCheckRequest { service: name.to_owned() };
        let mut watch = health.watch(request.clone()).await.unwrap().into_inner();
        assert_eq!(watch.next().await.unwrap().unwrap().status(), ServingStatus::Serving);
        let begun = std::time::Instant::now();
        server.begin_stop();
        assert_eq!(watch.next().await.unwrap().unwrap().status(), ServingStatus::NotServing, "`{name}`");
        fastest = fastest.min(begun.elapsed());
        // Watching health does not delay the shutdown, and the stream ends without an error.
        assert!(watch.next().await.is_none());
        tokio::time::timeout(Duration::from_secs(10), server.stop()).await.expect("the drain has a deadline");
    }
    // The fastest of three, because other tests may keep the machine busy.
    assert!(fastest < Duration::from_millis(100), "{fastest:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn health_checks_are_answered_while_a_service_goes_away() {
    let server = start_server(ServerConfig::default());
    let endpoint = tonic::transport::Endpoint::from_shared(server.uri.clone()).unwrap();
    let mut health = HealthClient::new(endpoint.connect().await.unwrap());
    let request = tonic_health::pb::HealthCheckRequest::default();
    let mut watch = health.watch(request.clone()).await.unwrap().into_inner();
    watch.next().await.unwrap().unwrap();
    server.begin_stop();
    watch.next().await.unwrap().unwrap();
    assert_eq!(health.check(request).await.unwrap().into_inner().status(), ServingStatus::NotServing);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn connections_that_outlast_a_drain_are_broken() {
    let server = start_server(ServerConfig::default());
    let mut silent = tokio::net::TcpStream::connect(server.address()).await.unwrap();
    silent.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0").await.unwrap();
    silent.read_exact(&mut [0; 9]).await.unwrap();
    server.stop().await;
    let mut rest = Vec::new();
    let closing = tokio::time::timeout(Duration::from_secs(10), silent.read_to_end(&mut rest)).await;
    // The connection may be closed or reset.
    let _ = closing.expect("the connection is broken");
}
