//! Calls whose answers are lost, repeated on another planner: each is carried out once.

use crate::planners::{Client, Fleet, append, build, client, edit, edits, ends, graph, layers, request, turn};
use crate::relay::Relay;
use crate::services::Postgres;
use surefoot_net::client::Credentials;
use surefoot_net::replicas::{ReplicaLink, Replicas, ranking};
use surefoot_processes::{Surefoot, wait_until};
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::reason::Reason;

/// What a client of PostgreSQL sends to commit a transaction.
const COMMIT: &[u8] = b"COMMIT";

/// Two planners, of which the first reaches the database through a relay.
struct Pair {
    fleet: Fleet,
    relay: Relay,
    planners: [Surefoot; 2],
}

impl Pair {
    fn new() -> Self {
        let mut fleet = Fleet::new();
        let relay = Relay::to(fleet.postgres.address);
        let direct = std::mem::replace(&mut fleet.store, Postgres::url_at(relay.address));
        let first = fleet.planner("first", &[]);
        fleet.store = direct;
        let second = fleet.planner("second", &[]);
        Self { fleet, relay, planners: [first, second] }
    }

    /// A client that asks the planner at the first of these addresses first.
    fn linked(uris: [String; 2]) -> PlannerServiceClient<ReplicaLink> {
        let is_first = |key: &String| ranking(key, uris.iter().map(String::as_str))[0] == 0;
        let key = (0..).map(|number| number.to_string()).find(is_first).expect("half of all keys");
        PlannerServiceClient::new(Replicas::dial(&Credentials::default(), &uris).unwrap().connect_lazy().for_key(&key))
    }

    /// A client that asks the first planner first.
    fn client(&self) -> PlannerServiceClient<ReplicaLink> {
        Self::linked(self.planners.each_ref().map(Surefoot::uri))
    }

    /// Numbers of tries of all edges that the database has.
    fn tries(&self) -> Vec<String> {
        self.fleet.postgres.query("SELECT sum(tries) FROM evidence")
    }
}

async fn reported(client: &Client, id: &str) -> u64 {
    let request = wire::ListReportsRequest { graph_id: id.to_owned() };
    let reports = client.clone().list_reports(request).await.unwrap().into_inner().reports;
    reports.iter().map(|report| report.traversals).sum()
}

#[tokio::test(flavor = "multi_thread")]
async fn edits_whose_commit_is_not_answered_are_made_once() {
    let _turn = turn().await;
    let pair = Pair::new();
    let mut clients = [client(&pair.planners[0]).await, client(&pair.planners[1]).await];
    let id = build(&mut clients[0], &request(200)).await.unwrap();
    let edge = ends(&mut clients[1], &id).await;
    pair.relay.lose_answer_to(COMMIT);
    let answer = pair.client().append_edits(append(&id, edit(1, edge))).await.unwrap().into_inner();
    assert!(pair.relay.is_sprung(), "the first planner was asked");
    assert_eq!(answer.summary.unwrap().edits, 1);
    for client in &clients {
        // The first planner did not see its own commit.
        wait_until("both plan with the edit", || {
            let (mut client, id) = (client.clone(), id.clone());
            async move { edits(&mut client, &id).await == [1] }
        })
        .await;
        assert_eq!(layers(&mut client.clone(), &id).await.revision, answer.revision);
    }
    pair.client().append_edits(append(&id, edit(2, edge))).await.unwrap();
    pair.client().append_edits(append(&id, edit(3, edge))).await.unwrap();
    pair.relay.lose_answer_to(COMMIT);
    let undo =
        wire::UndoEditsRequest { graph_id: id.clone(), layer: "ways".to_owned(), count: 1, ..Default::default() };
    let answer = pair.client().undo_edits(undo).await.unwrap().into_inner();
    assert!(pair.relay.is_sprung());
    assert_eq!(answer.summary.unwrap().edits, 2);
    for client in &clients {
        wait_until("both plan without the last edit", || {
            let (mut client, id) = (client.clone(), id.clone());
            async move { edits(&mut client, &id).await == [1, 2] }
        })
        .await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_repeat_gets_the_first_answer_on_any_planner() {
    let _turn = turn().await;
    let pair = Pair::new();
    let mut clients = [client(&pair.planners[0]).await, client(&pair.planners[1]).await];
    let id = build(&mut clients[0], &request(201)).await.unwrap();
    let edge = ends(&mut clients[1], &id).await;
    let call = wire::AppendEditsRequest { request_id: "mine".to_owned(), ..append(&id, edit(1, edge)) };
    let first = clients[0].append_edits(call.clone()).await.unwrap().into_inner();
    clients[0].append_edits(append(&id, edit(2, edge))).await.unwrap();
    let tasks = (0..8).map(|idx| {
        let (mut client, call) = (clients[idx % 2].clone(), call.clone());
        tokio::spawn(async move { client.append_edits(call).await.unwrap().into_inner() })
    });
    for task in tasks.collect::<Vec<_>>() {
        assert_eq!(task.await.unwrap(), first);
    }
    let other = wire::AppendEditsRequest { request_id: "mine".to_owned(), ..append(&id, edit(3, edge)) };
    let refused = clients[1].append_edits(other).await.unwrap_err();
    assert_eq!(Reason::of(&refused), Some(Reason::RequestIdReused), "{refused}");
    assert_eq!(edits(&mut clients[0], &id).await, [1, 2]);
    assert_eq!(pair.fleet.count("receipts"), 1);
    // Old receipts go.
    pair.fleet.postgres.query("UPDATE receipts SET noted_at = now() - interval '11 minutes'");
    wait_until("they are forgotten", || async { pair.fleet.count("receipts") == 0 }).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn reports_whose_answers_or_commits_are_lost_count_once() {
    let _turn = turn().await;
    let pair = Pair::new();
    let clients = [client(&pair.planners[0]).await, client(&pair.planners[1]).await];
    let id = build(&mut clients[0].clone(), &request(202)).await.unwrap();
    let key = graph(&mut clients[1].clone(), &id).await.edges[0].clone();
    let failed = wire::Traversal { from: key.from, to: key.to, ..Default::default() };
    let report = |count| wire::ReportTraversalsRequest {
        graph_id: id.clone(),
        traversals: vec![failed; count],
        ..Default::default()
    };
    let all_know = async |count: u64| {
        for client in &clients {
            wait_until("all know the traversals", || async { reported(client, &id).await == count }).await;
        }
        assert_eq!(pair.tries(), [count.to_string()]);
    };
    // The answer is lost on its way to the client, which asks the other planner.
    let relay = Relay::to(pair.planners[0].address);
    relay.lose_answer_to(id.as_bytes());
    let mut linked = Pair::linked([format!("http://{}", relay.address), pair.planners[1].uri()]);
    assert_eq!(linked.report_traversals(report(3)).await.unwrap().into_inner().accepted, 3);
    assert!(relay.is_sprung());
    // Reports are stored in order: when this one is, the repeat has been as well.
    clients[1].clone().report_traversals(report(5)).await.unwrap();
    all_know(8).await;
    // The planner does not hear that its transaction was committed, and tries again.
    pair.relay.lose_answer_to(COMMIT);
    clients[0].clone().report_traversals(report(2)).await.unwrap();
    wait_until("it is committed", || async { pair.relay.is_sprung() }).await;
    clients[0].clone().report_traversals(report(7)).await.unwrap();
    all_know(17).await;
}
