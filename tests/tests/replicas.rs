//! A client of several planners, over real sockets.

use e2e::{Running, build_to_end, planner_client, small_map, start_of, start_planner};
use surefoot_net::client::Credentials;
use surefoot_net::replicas::{ReplicaLink, ReplicaLinks, Replicas, ranking};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::planner::v1 as plan;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::world::v1 as world;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;
use tonic::Code;

const KEY: &str = "the hash of a map";

/// Connections to planners at these addresses, and a client for [`KEY`].
fn client_of(uris: &[String]) -> (ReplicaLinks, PlannerServiceClient<ReplicaLink>) {
    let links = Replicas::dial(&Credentials::default(), uris).unwrap().connect_lazy();
    let client = PlannerServiceClient::new(links.for_key(KEY));
    (links, client)
}

/// Indices of replicas, the one that [`KEY`] asks first first.
fn order(uris: &[String]) -> Vec<usize> {
    ranking(KEY, uris.iter().map(String::as_str))
}

async fn start_build(client: &mut PlannerServiceClient<ReplicaLink>) -> Result<plan::Build, tonic::Status> {
    Ok(client.start_build(start_of(3)).await?.into_inner().build.expect("a build"))
}

async fn builds(planner: &Running) -> usize {
    let mut client = planner_client(planner).await;
    client.list_builds(plan::ListBuildsRequest::default()).await.unwrap().into_inner().builds.len()
}

#[tokio::test(flavor = "multi_thread")]
async fn calls_of_one_key_go_to_one_replica_and_to_the_next_when_it_is_gone() {
    let folders: Vec<_> = (0..3).map(|_| tempfile::tempdir().unwrap()).collect();
    let planners: Vec<Running> =
        folders.iter().map(|folder| start_planner(folder.path(), PlannerConfig::default())).collect();
    let uris: Vec<String> = planners.iter().map(|planner| planner.uri.clone()).collect();
    let [first, second, third] = order(&uris)[..] else { panic!("three replicas") };
    let (_, mut client) = client_of(&uris);
    for _ in 0..5 {
        start_build(&mut client).await.unwrap();
    }
    assert_eq!((builds(&planners[second]).await, builds(&planners[third]).await), (0, 0));
    assert_ne!(builds(&planners[first]).await, 0);
    let mut planners: Vec<Option<Running>> = planners.into_iter().map(Some).collect();
    planners[first].take().unwrap().stop().await;
    start_build(&mut client).await.expect("the next replica answers, and nobody notices");
    assert_eq!(builds(planners[second].as_ref().unwrap()).await, 1);
    assert_eq!(builds(planners[third].as_ref().unwrap()).await, 0);
    planners[second].take().unwrap().stop().await;
    start_build(&mut client).await.expect("the last replica answers");
    planners[third].take().unwrap().stop().await;
    let status = start_build(&mut client).await.unwrap_err();
    assert_eq!(status.code(), Code::Unavailable, "{status}");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_replica_refuses_for_good_is_not_asked_of_others() {
    let folders: Vec<_> = (0..2).map(|_| tempfile::tempdir().unwrap()).collect();
    let planners: Vec<Running> =
        folders.iter().map(|folder| start_planner(folder.path(), PlannerConfig::default())).collect();
    let uris: Vec<String> = planners.iter().map(|planner| planner.uri.clone()).collect();
    let (_, mut client) = client_of(&uris);
    let map = world::MapSpec { size: Some(world::MapSize { width: 7, height: 1, depth: 0 }), ..small_map(1) };
    let request = plan::StartBuildRequest { map: Some(map), ..start_of(1) };
    assert_eq!(client.start_build(request).await.unwrap_err().code(), Code::InvalidArgument);
    let graph = build_to_end(&mut planner_client(&planners[order(&uris)[1]]).await, start_of(3)).await;
    let request = plan::GetGraphRequest { graph_id: graph.graph_id };
    assert_eq!(client.get_graph(request).await.unwrap_err().code(), Code::NotFound, "the other one has the graph");
}

/// An address that accepts connections and says nothing, and whether it has read anything.
async fn silent() -> (String, tokio::sync::watch::Receiver<bool>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let uri = format!("http://{}", listener.local_addr().unwrap());
    let (heard, hears) = tokio::sync::watch::channel(false);
    tokio::spawn(async move {
        let mut open = Vec::new();
        loop {
            let (mut socket, _) = listener.accept().await.unwrap();
            socket.read_u8().await.unwrap();
            heard.send_replace(true);
            open.push(socket);
        }
    });
    (uri, hears)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_silent_replica_is_asked_last_after_a_caller_gave_up() {
    let folder = tempfile::tempdir().unwrap();
    let planner = start_planner(folder.path(), PlannerConfig::default());
    // The planner's address is what it is: silent ones are drawn until one ranks before it.
    let (uri, mut hears) = loop {
        let (uri, hears) = silent().await;
        if order(&[uri.clone(), planner.uri.clone()])[0] == 0 {
            break (uri, hears);
        }
    };
    let (links, mut client) = client_of(&[uri, planner.uri.clone()]);
    let mut patient = client.clone();
    let waiting = tokio::spawn(async move { start_build(&mut patient).await });
    hears.wait_for(|hears| *hears).await.unwrap();
    waiting.abort();
    assert!(waiting.await.unwrap_err().is_cancelled());
    start_build(&mut client).await.expect("the planner answers");
    let other = links.for_key("the hash of another map");
    start_build(&mut PlannerServiceClient::new(other)).await.expect("whatever the key");
    planner.stop().await;
}

/// Reads requests up to the word `marker` and hangs up; the number of times that it did.
async fn hangs_up() -> (String, tokio::sync::watch::Receiver<u32>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let uri = format!("http://{}", listener.local_addr().unwrap());
    let (count, counted) = tokio::sync::watch::channel(0);
    tokio::spawn(async move {
        loop {
            let (mut socket, _) = listener.accept().await.unwrap();
            // An empty SETTINGS frame: a client sends its requests then.
            socket.write_all(&[0, 0, 0, 4, 0, 0, 0, 0, 0]).await.unwrap();
            let mut seen = Vec::new();
            while !seen.windows(6).any(|window| window == b"marker") {
                seen.push(socket.read_u8().await.unwrap());
            }
            count.send_modify(|count| *count += 1);
        }
    });
    (uri, counted)
}

#[tokio::test(flavor = "multi_thread")]
async fn what_may_have_been_counted_is_not_sent_again() {
    let folder = tempfile::tempdir().unwrap();
    let planner = start_planner(folder.path(), PlannerConfig::default());
    // As above: one that ranks before the planner.
    let (uri, counted) = loop {
        let (uri, counted) = hangs_up().await;
        if order(&[uri.clone(), planner.uri.clone()])[0] == 0 {
            break (uri, counted);
        }
    };
    let uris = [uri, planner.uri.clone()];
    let graph_id = "marker".to_owned();
    let report = plan::ReportTraversalsRequest { graph_id: graph_id.clone(), traversals: Vec::new() };
    let status = client_of(&uris).1.report_traversals(report).await.unwrap_err();
    assert_ne!(status.code(), Code::InvalidArgument, "the planner was asked: {status}");
    assert_eq!(*counted.borrow(), 1);
    let status = client_of(&uris).1.get_graph(plan::GetGraphRequest { graph_id }).await.unwrap_err();
    assert_eq!(status.code(), Code::InvalidArgument, "the planner was not asked: {status}");
    assert_eq!(*counted.borrow(), 2);
    planner.stop().await;
}
