//! Builds that several clients have asked for, cancelled by way of planners that do not run them.

use crate::planners::{Fleet, large, turn};
use surefoot_net::client::{ClientTlsFiles, Credentials, Link};
use surefoot_net::secret::Secret;
use surefoot_processes::{Surefoot, wait_until};
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::reason::Reason;

const TOKENS: &str = "[[token]]\nname = \"one\"\nrole = \"client\"\nsecret = \"the-secret-of-one\"\n\
                      [[token]]\nname = \"two\"\nrole = \"client\"\nsecret = \"the-secret-of-two\"\n";

async fn client_of(planner: &Surefoot, name: &str) -> PlannerServiceClient<Link> {
    planner.connect().await;
    let token = Secret::new(format!("the-secret-of-{name}"));
    let credentials = Credentials::load(Some(&token), &ClientTlsFiles::default()).unwrap();
    PlannerServiceClient::new(credentials.dial(&planner.uri()).unwrap().connect().await.unwrap())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_build_ends_when_all_who_asked_for_it_have_cancelled_it_on_any_planner() {
    let _turn = turn().await;
    let fleet = Fleet::new();
    let file = fleet.ground.path("tokens.toml");
    std::fs::write(&file, TOKENS).unwrap();
    let args = ["plan", "--store", &fleet.store, "--blobs", &fleet.blobs, "--tokens", file.to_str().unwrap()];
    let planners = ["first", "second"].map(|name| Surefoot::start(&args, &[], &fleet.ground.path(name)));
    let mut here = [client_of(&planners[0], "one").await, client_of(&planners[0], "two").await];
    let mut there = [client_of(&planners[1], "one").await, client_of(&planners[1], "two").await];
    // Far larger than any test waits for.
    let settings = wire::BuildSettings { vertices: 2000, neighbours: 64, repeats: 32, ..Default::default() };
    let request = wire::StartBuildRequest { settings: Some(settings), ..large(400) };
    let started = here[0].start_build(request.clone()).await.unwrap().into_inner().build.unwrap();
    let cancel = wire::CancelBuildRequest { build_id: started.build_id.clone() };
    let refused = there[1].cancel_build(cancel.clone()).await.unwrap_err();
    assert_eq!(Reason::of(&refused), Some(Reason::NotOwner), "{refused}");
    let joined = here[1].start_build(request).await.unwrap().into_inner().build.unwrap();
    assert_eq!(joined.build_id, started.build_id);
    wait_until("the database knows both", || async {
        fleet.count("operations WHERE cardinality(requesters) = 2") == 1
    })
    .await;
    there[0].cancel_build(cancel.clone()).await.unwrap();
    wait_until("its planner knows that one has withdrawn", || async {
        fleet.count("operations WHERE requesters = ARRAY['two']") == 1
    })
    .await;
    assert_eq!(fleet.count("operations WHERE stage < 5"), 1, "it goes on");
    there[1].cancel_build(cancel).await.unwrap();
    wait_until("it is cancelled", || async { fleet.count("operations WHERE stage = 7") == 1 }).await;
}
