//! A client of several planners, over real sockets.

use e2e::{Running, build_to_end, planner_client, small_map, start_of, start_planner};
use surefoot_net::client::Credentials;
use surefoot_net::replicas::{ReplicaLink, ReplicaLinks, Replicas, ranking};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::planner::v1 as plan;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::reason::Reason;
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
    let request = plan::GetGraphRequest { graph_id: graph.graph_id, ..Default::default() };
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

/// Reads requests up to the word `marker` and the field after it, and hangs up; that field of each request.
async fn hangs_up() -> (String, tokio::sync::watch::Receiver<Vec<Vec<u8>>>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let uri = format!("http://{}", listener.local_addr().unwrap());
    let (fields, read) = tokio::sync::watch::channel(Vec::new());
    tokio::spawn(async move {
        loop {
            let (mut socket, _) = listener.accept().await.unwrap();
            // An empty SETTINGS frame: a client sends its requests then.
            socket.write_all(&[0, 0, 0, 4, 0, 0, 0, 0, 0]).await.unwrap();
            let mut seen = Vec::new();
            while !seen.windows(6).any(|window| window == b"marker") {
                seen.push(socket.read_u8().await.unwrap());
            }
            // The key of the field, its length and 32 digits.
            let mut field = vec![0; 34];
            socket.read_exact(&mut field).await.unwrap();
            fields.send_modify(|fields| fields.push(field));
        }
    });
    (uri, read)
}

#[tokio::test(flavor = "multi_thread")]
async fn what_may_have_been_carried_out_is_sent_again_with_the_id_that_it_had() {
    let folder = tempfile::tempdir().unwrap();
    let planner = start_planner(folder.path(), PlannerConfig::default());
    // As above: two that rank before the planner.
    let mut uris = vec![planner.uri.clone()];
    let mut read = Vec::new();
    while uris.len() < 3 {
        let (uri, fields) = hangs_up().await;
        uris.insert(0, uri);
        if order(&uris).last() != Some(&(uris.len() - 1)) {
            uris.remove(0);
            continue;
        }
        read.push(fields);
    }
    let report = plan::ReportTraversalsRequest { graph_id: "marker".to_owned(), ..Default::default() };
    let status = client_of(&uris).1.report_traversals(report.clone()).await.unwrap_err();
    assert_eq!(status.code(), Code::InvalidArgument, "the planner was not asked: {status}");
    let [first, second] = [&read[0], &read[1]].map(|fields| fields.borrow().clone());
    assert_eq!((first.len(), &first), (1, &second), "one id for all tries");
    assert_eq!(first[0][..2], [3 << 3 | 2, 32], "the request_id");
    // Another call has another id.
    client_of(&uris).1.report_traversals(report).await.unwrap_err();
    assert_ne!(read[0].borrow()[1], first[0]);
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_call_that_is_repeated_after_a_restart_returns_the_first_answer_and_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let planner = start_planner(folder.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let graph_id = build_to_end(&mut client, start_of(3)).await.graph_id;
    let graph = client
        .get_graph(plan::GetGraphRequest { graph_id: graph_id.clone(), ..Default::default() })
        .await
        .unwrap()
        .into_inner();
    let edge = &graph.edges[0];
    let [from, to] = [edge.from, edge.to].map(|vertex| Some(graph.vertices[vertex as usize]));
    let append = |factor, id: &str| plan::AppendEditsRequest {
        graph_id: graph_id.clone(),
        layer: "night".to_owned(),
        edits: vec![plan::Edit { edit: Some(plan::edit::Edit::PriceEdge(plan::PriceEdge { from, to, factor })) }],
        request_id: id.to_owned(),
        ..Default::default()
    };
    let undo = plan::UndoEditsRequest {
        graph_id: graph_id.clone(),
        layer: "night".to_owned(),
        count: 1,
        request_id: "undo".to_owned(),
        ..Default::default()
    };
    let failed = plan::Traversal { from: edge.from, to: edge.to, ..Default::default() };
    let report = plan::ReportTraversalsRequest {
        graph_id: graph_id.clone(),
        traversals: vec![failed; 3],
        request_id: "report".to_owned(),
    };
    // The last of them is the one that a layer still shows.
    let appended = client.append_edits(append(2.0, "first")).await.unwrap().into_inner();
    client.append_edits(append(3.0, "second")).await.unwrap();
    client.append_edits(append(4.0, "third")).await.unwrap();
    let undone = client.undo_edits(undo.clone()).await.unwrap().into_inner();
    assert_eq!(client.report_traversals(report.clone()).await.unwrap().into_inner().accepted, 3);
    planner.stop().await;
    for _ in 0..2 {
        let planner = start_planner(folder.path(), PlannerConfig::default());
        let mut client = planner_client(&planner).await;
        assert_eq!(build_to_end(&mut client, start_of(3)).await.graph_id, graph_id);
        assert_eq!(client.report_traversals(report.clone()).await.unwrap().into_inner().accepted, 3);
        assert_eq!(client.append_edits(append(2.0, "first")).await.unwrap().into_inner(), appended);
        assert_eq!(client.undo_edits(undo.clone()).await.unwrap().into_inner(), undone);
        let layers = plan::GetLayersRequest { graph_id: graph_id.clone(), ..Default::default() };
        let layers = client.get_layers(layers).await.unwrap().into_inner();
        assert_eq!(layers.layers[0].edits, [append(2.0, "").edits, append(3.0, "").edits].concat());
        assert_eq!(layers.revision, undone.revision);
        let reports = plan::ListReportsRequest { graph_id: graph_id.clone() };
        let reports = client.list_reports(reports).await.unwrap().into_inner().reports;
        assert!(reports.iter().map(|report| (report.traversals, report.failures)).eq([(3, 3)]), "{reports:?}");
        let other = client.append_edits(append(9.0, "first")).await.unwrap_err();
        assert_eq!(Reason::of(&other), Some(Reason::RequestIdReused));
        planner.stop().await;
    }
}
