//! TLS, client certificates, tokens and roles, over real sockets.

use e2e::{LIMIT, Running, metrics, start_planner_at, start_server_at, start_worker_as};
use prost::Message;
use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair};
use std::convert::Infallible;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::task::{Context, Poll};
use std::time::Duration;
use surefoot_agent::WorkError;
use surefoot_net::client::{ClientTlsFiles, Credentials, Link};
use surefoot_net::secret::Secret;
use surefoot_net::serving::access::{Role, roles};
use surefoot_net::serving::security::ServerTls;
use surefoot_net::serving::tokens::{TokenError, Tokens};
use surefoot_net::serving::{Caller, Endpoint, EndpointConfig, Security, ServeError, Shutdown};
use surefoot_planner_service::PlannerConfig;
use surefoot_policy::Policy;
use surefoot_proto::convert::map_spec_to_wire;
use surefoot_proto::planner::v1 as plan;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1::work_request::Message as Work;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_proto::world::v1::{
    BatchSpawnNpcsRequest, CreateWorldRequest, GetNpcRequest, Hello, ListWorldsRequest, SampleGroundRequest, Spawn,
    WatchWorldRequest, WorkRequest,
};
use surefoot_server::ServerConfig;
use surefoot_world::sense::OBSERVATION_VERSION;
use surefoot_world::{MapSpec, OBSERVATION_LEN};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tonic::body::Body;
use tonic::codegen::tokio_stream::StreamExt;
use tonic::{Code, Request, Status};
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

fn secret_of(role: Role) -> String {
    format!("the-secret-of-a-{}", role)
}

/// One token for every role, with the name of the role.
fn tokens() -> Tokens {
    let entry =
        |role: Role| format!("[[token]]\nname = \"{0}\"\nrole = \"{0}\"\nsecret = \"{1}\"\n", role, secret_of(role));
    Tokens::parse(&Role::ALL.map(entry).concat()).unwrap()
}

fn guarded() -> EndpointConfig {
    EndpointConfig { security: Security { tokens: Some(tokens()), ..Default::default() }, ..Default::default() }
}

fn with_token(token: &str) -> Credentials {
    Credentials::load(Some(&Secret::new(token)), &ClientTlsFiles::default()).unwrap()
}

fn holder(role: Role) -> Credentials {
    with_token(&secret_of(role))
}

async fn link(server: &Running, credentials: &Credentials) -> Link {
    credentials.dial(&server.uri).unwrap().connect().await.unwrap()
}

/// Calls a method by its full name with an empty message.
async fn call(link: &Link, method: &str) -> Result<(), Status> {
    let mut grpc = tonic::client::Grpc::new(link.clone());
    grpc.ready().await.map_err(|error| Status::unavailable(error.to_string()))?;
    let path = http::uri::PathAndQuery::try_from(format!("/{method}")).unwrap();
    let codec = tonic_prost::ProstCodec::<(), ()>::default();
    let mut answers = grpc.server_streaming(Request::new(()), path, codec).await?.into_inner();
    match answers.next().await {
        None | Some(Ok(())) => Ok(()),
        Some(Err(status)) => Err(status),
    }
}

/// Full names of all methods of our contracts.
fn methods() -> Vec<String> {
    let files = prost_types::FileDescriptorSet::decode(surefoot_proto::FILE_DESCRIPTOR_SET).unwrap().file;
    let services = files.iter().flat_map(|file| file.service.iter().map(move |service| (file.package(), service)));
    services
        .flat_map(|(package, service)| {
            service.method.iter().map(move |method| format!("{package}.{}/{}", service.name(), method.name()))
        })
        .collect()
}

#[test]
fn every_method_has_its_row_in_the_table_of_roles() {
    let methods = methods();
    assert!(methods.len() >= 20);
    for method in &methods {
        let roles = roles(method).unwrap_or_else(|| panic!("{method} is missing in METHODS of serving/access.rs"));
        assert!(roles.contains(&Role::Admin), "{method} is closed to admins");
    }
    for (method, allowed, refused) in [
        ("surefoot.world.v1.WorldService/Work", Role::Worker, Role::Client),
        ("surefoot.world.v1.WorldService/CreateWorld", Role::Client, Role::Worker),
        ("surefoot.planner.v1.PlannerService/PutLayer", Role::Designer, Role::Client),
        ("surefoot.planner.v1.PlannerService/ListReports", Role::Client, Role::Worker),
        ("surefoot.planner.v1.PlannerService/DropReports", Role::Admin, Role::Designer),
    ] {
        let roles = roles(method).unwrap();
        assert!(roles.contains(&allowed) && !roles.contains(&refused), "{method}: {roles:?}");
    }
    assert_eq!(roles("surefoot.world.v1.WorldService/Unheard"), None);
}

#[tokio::test(flavor = "multi_thread")]
async fn every_method_needs_a_token_of_a_role_that_may_call_it() {
    let cache = tempfile::tempdir().unwrap();
    let server = start_server_at(guarded(), ServerConfig::default());
    let planner = start_planner_at(guarded(), cache.path(), PlannerConfig::default());
    let service_of = |method: &str| if method.starts_with("surefoot.planner") { &planner } else { &server };
    for method in methods().iter().map(String::as_str).chain(["surefoot.world.v1.WorldService/Unheard"]) {
        let service = service_of(method);
        for credentials in [Credentials::default(), with_token("the-secret-of-nobody"), with_token("")] {
            let status = call(&link(service, &credentials).await, method).await.unwrap_err();
            assert_eq!(status.code(), Code::Unauthenticated, "{method}: {status}");
        }
        for role in Role::ALL {
            let result = call(&link(service, &holder(role)).await, method).await;
            let code = result.map_or_else(|status| status.code(), |()| Code::Ok);
            let may = roles(method).is_some_and(|roles| roles.contains(&role));
            assert_eq!(code == Code::PermissionDenied, !may, "{method} by {role:?} is {code:?}");
            assert_ne!(code, Code::Unauthenticated, "{method} by {role:?}");
        }
    }
    planner.stop().await;
    server.stop().await;
}

/// A build that takes minutes.
fn long_build(seed: u64) -> plan::StartBuildRequest {
    let settings = plan::BuildSettings { vertices: 2000, neighbours: 64, repeats: 32, ..Default::default() };
    plan::StartBuildRequest { settings: Some(settings), ..e2e::start_of(seed) }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_build_ends_when_all_who_asked_for_it_have_cancelled_it_or_an_admin_has() {
    let cache = tempfile::tempdir().unwrap();
    let config = PlannerConfig { max_builds_per_client: 2, ..PlannerConfig::default() };
    let planner = start_planner_at(guarded(), cache.path(), config);
    let mut game = planner_of(&planner, Role::Client).await;
    let mut designer = planner_of(&planner, Role::Designer).await;
    let mut worker = planner_of(&planner, Role::Worker).await;
    let mut admin = planner_of(&planner, Role::Admin).await;
    let started = async |client: &mut PlannerServiceClient<Link>, seed| {
        client.start_build(long_build(seed)).await.map(|started| started.into_inner().build.unwrap().build_id)
    };
    let build_id = started(&mut game, 1).await.unwrap();
    let cancel = |build_id: &String| plan::CancelBuildRequest { build_id: build_id.clone() };
    let refused = designer.cancel_build(cancel(&build_id)).await.unwrap_err();
    assert_eq!(Reason::of(&refused), Some(Reason::NotOwner), "{refused}");
    assert_eq!(started(&mut designer, 1).await.unwrap(), build_id, "equal requests share a build");
    game.cancel_build(cancel(&build_id)).await.unwrap();
    let refused = game.cancel_build(cancel(&build_id)).await.unwrap_err();
    assert_eq!(Reason::of(&refused), Some(Reason::NotOwner), "it has withdrawn: {refused}");
    // The build goes on: a request for it joins it.
    assert_eq!(started(&mut game, 1).await.unwrap(), build_id);
    game.cancel_build(cancel(&build_id)).await.unwrap();
    designer.cancel_build(cancel(&build_id)).await.unwrap();
    let mut ended = admin.watch_build(plan::WatchBuildRequest { build_id }).await.unwrap().into_inner();
    let mut last = plan::Build::default();
    while let Some(message) = ended.message().await.unwrap() {
        last = message.build.unwrap();
    }
    assert_eq!(last.stage(), plan::BuildStage::Cancelled);
    // What NPCs wait for, no game cancels; and no client takes all places.
    let builds = [started(&mut worker, 2).await.unwrap(), started(&mut worker, 3).await.unwrap()];
    let refused = started(&mut worker, 4).await.unwrap_err();
    assert_eq!(Reason::of(&refused), Some(Reason::TooManyBuilds));
    assert!(refused.message().contains("--max-builds-per-client"), "{refused}");
    started(&mut game, 4).await.expect("places of other clients are free");
    started(&mut worker, 4).await.expect("to join a build takes no place");
    game.cancel_build(cancel(&builds[0])).await.unwrap_err();
    for build_id in &builds {
        admin.cancel_build(cancel(build_id)).await.unwrap();
    }
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn reports_of_a_client_do_not_outweigh_probes_and_an_admin_takes_them_back() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner_at(guarded(), cache.path(), PlannerConfig::default());
    let mut admin = planner_of(&planner, Role::Admin).await;
    let graph_id = built(&mut admin).await;
    let key = |edge: &plan::Edge| (edge.from, edge.to);
    let probed = graph_of(&mut admin, &graph_id).await.edges[0].clone();
    let failed = plan::Traversal { from: probed.from, to: probed.to, reached: false, decisions: 50, died: false };
    for (role, dropped_by_cap) in [(Role::Client, true), (Role::Designer, true), (Role::Worker, false)] {
        let traversals = vec![failed; 60];
        let request = plan::ReportTraversalsRequest { graph_id: graph_id.clone(), traversals, ..Default::default() };
        let answer = planner_of(&planner, role).await.report_traversals(request).await.unwrap().into_inner();
        assert_eq!(answer.accepted, 60);
        // The new router, and with it the graph as it is queried, follows within seconds.
        let now = loop {
            tokio::time::sleep(Duration::from_millis(200)).await;
            let graph = graph_of(&mut admin, &graph_id).await;
            let now = graph.edges.iter().find(|edge| key(edge) == key(&probed)).unwrap().clone();
            let listed = reports(&mut admin, &graph_id).await;
            let is_listed = listed.iter().any(|(name, count)| *name == role.to_string() && *count > 0);
            assert!(is_listed, "{role:?} is missing in {listed:?}");
            if dropped_by_cap || now.tries > probed.tries + probed.tries / 2 {
                break now;
            }
        };
        assert_eq!(now.tries <= probed.tries + probed.tries / 2, dropped_by_cap, "{role:?}: {now:?}");
    }
    let drop_of = |role: Role| plan::DropReportsRequest { graph_id: graph_id.clone(), reporter: role.to_string() };
    let refused = planner_of(&planner, Role::Designer).await.drop_reports(drop_of(Role::Worker)).await.unwrap_err();
    assert_eq!(refused.code(), Code::PermissionDenied);
    let unnamed = plan::DropReportsRequest { graph_id: graph_id.clone(), reporter: String::new() };
    assert_eq!(admin.drop_reports(unnamed).await.unwrap_err().code(), Code::InvalidArgument);
    for role in [Role::Client, Role::Designer, Role::Worker] {
        assert!(admin.drop_reports(drop_of(role)).await.unwrap().into_inner().dropped > 0);
        assert_eq!(admin.drop_reports(drop_of(role)).await.unwrap().into_inner().dropped, 0);
    }
    let after = graph_of(&mut admin, &graph_id).await.edges[0].clone();
    assert_eq!(after, probed, "plans do not use the reports any more");
    planner.stop().await;

    let planner = start_planner_at(guarded(), cache.path(), PlannerConfig::default());
    let mut admin = planner_of(&planner, Role::Admin).await;
    assert_eq!(built(&mut admin).await, graph_id);
    assert_eq!(reports(&mut admin, &graph_id).await, [], "the reports are gone from the cache as well");
    planner.stop().await;
}

async fn planner_of(planner: &Running, role: Role) -> PlannerServiceClient<Link> {
    PlannerServiceClient::new(link(planner, &holder(role)).await)
}

/// Builds a small graph and returns its id.
async fn built(client: &mut PlannerServiceClient<Link>) -> String {
    let build_id = client.start_build(e2e::start_of(7)).await.unwrap().into_inner().build.unwrap().build_id;
    let mut stages = client.watch_build(plan::WatchBuildRequest { build_id }).await.unwrap().into_inner();
    let mut last = plan::Build::default();
    while let Some(stage) = stages.next().await {
        last = stage.unwrap().build.unwrap();
    }
    last.graph_id
}

async fn graph_of(client: &mut PlannerServiceClient<Link>, graph_id: &str) -> plan::GetGraphResponse {
    client
        .get_graph(plan::GetGraphRequest { graph_id: graph_id.to_owned(), ..Default::default() })
        .await
        .unwrap()
        .into_inner()
}

/// Names of reporters and numbers of their traversals.
async fn reports(client: &mut PlannerServiceClient<Link>, graph_id: &str) -> Vec<(String, u64)> {
    let request = plan::ListReportsRequest { graph_id: graph_id.to_owned() };
    let reports = client.list_reports(request).await.unwrap().into_inner().reports;
    reports.into_iter().map(|report| (report.reporter, report.traversals)).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn health_is_open_but_reflection_and_metrics_are_not() {
    let server = start_server_at(guarded(), ServerConfig::default());
    let stranger = link(&server, &Credentials::default()).await;
    HealthClient::new(stranger.clone()).check(HealthCheckRequest::default()).await.unwrap();
    let reflection = "grpc.reflection.v1.ServerReflection/ServerReflectionInfo";
    assert_eq!(call(&stranger, reflection).await.unwrap_err().code(), Code::Unauthenticated);
    let known = call(&link(&server, &holder(Role::Worker)).await, reflection).await;
    assert!(!known.is_err_and(|status| matches!(status.code(), Code::Unauthenticated | Code::PermissionDenied)));
    let page = metrics(&server, "").await;
    assert!(page.starts_with("HTTP/1.1 401") && page.to_lowercase().contains("www-authenticate: bearer"), "{page}");
    let header = format!("Authorization: Bearer {}\r\n", secret_of(Role::Client));
    let page = metrics(&server, &header).await;
    assert!(page.starts_with("HTTP/1.1 200") && page.contains("surefoot_workers 0"), "{page}");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_shows_its_token() {
    let server = start_server_at(guarded(), ServerConfig::default());
    let policy = Policy::shipped().unwrap();
    let wrong = start_worker_as(holder(Role::Client), policy.clone(), &server, None, 8);
    let end = tokio::time::timeout(Duration::from_secs(20), wrong.task).await.unwrap().unwrap();
    assert!(matches!(end, Err(WorkError::Refused(status)) if status.code() == Code::PermissionDenied));
    let right = start_worker_as(holder(Role::Worker), policy, &server, None, 8);
    let header = format!("Authorization: Bearer {}\r\n", secret_of(Role::Admin));
    while !metrics(&server, &header).await.contains("surefoot_workers 1") {
        assert!(!right.task.is_finished(), "the worker gave up");
    }
    right.stop().await;
    server.stop().await;
}

/// An authority and certificates issued by it, as files.
struct Certificates {
    folder: tempfile::TempDir,
    issuer: Issuer<'static, KeyPair>,
}

impl Certificates {
    fn new() -> Self {
        let mut params = CertificateParams::new(Vec::new()).unwrap();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let key = KeyPair::generate().unwrap();
        let authority = params.self_signed(&key).unwrap();
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("ca.pem"), authority.pem()).unwrap();
        Self { folder, issuer: Issuer::new(params, key) }
    }

    fn authority(&self) -> PathBuf {
        self.folder.path().join("ca.pem")
    }

    /// Issues a certificate for a name or address; returns the files of the certificate and its key.
    fn issue(&self, name: &str) -> (PathBuf, PathBuf) {
        let key = KeyPair::generate().unwrap();
        let params = CertificateParams::new(vec![name.to_owned()]).unwrap();
        let certificate = params.signed_by(&key, &self.issuer).unwrap();
        let path = |kind: &str| self.folder.path().join(format!("{name}.{kind}"));
        std::fs::write(path("pem"), certificate.pem()).unwrap();
        std::fs::write(path("key"), key.serialize_pem()).unwrap();
        (path("pem"), path("key"))
    }
}

fn start_tls_server(certificates: &Certificates, name: &str, client_authority: Option<&Path>) -> Running {
    let (certificate, key) = certificates.issue(name);
    let tls = Some(ServerTls::load(&certificate, &key, client_authority).unwrap());
    let security = Security { tls, tokens: Some(tokens()), ..Security::default() };
    start_server_at(EndpointConfig { security, ..Default::default() }, ServerConfig::default())
}

/// Lists worlds as an admin with the given TLS files.
async fn list_worlds(uri: &str, files: ClientTlsFiles) -> Result<(), String> {
    let credentials = Credentials::load(Some(&Secret::new(secret_of(Role::Admin))), &files).unwrap();
    let link = credentials.dial(uri).unwrap().connect().await.map_err(|error| format!("{error:?}"))?;
    let listed = WorldServiceClient::new(link).list_worlds(ListWorldsRequest::default()).await;
    listed.map(drop).map_err(|status| format!("{status:?}"))
}

#[tokio::test(flavor = "multi_thread")]
async fn clients_trust_the_authority_they_are_given_and_no_other() {
    let (certificates, others) = (Certificates::new(), Certificates::new());
    let server = start_tls_server(&certificates, "127.0.0.1", None);
    assert!(server.uri.starts_with("https://"));
    let trusting = |authority: PathBuf| ClientTlsFiles { authority: Some(authority), ..Default::default() };
    list_worlds(&server.uri, trusting(certificates.authority())).await.unwrap();
    list_worlds(&server.uri, trusting(others.authority())).await.unwrap_err();
    list_worlds(&server.uri.replace("https", "http"), ClientTlsFiles::default()).await.unwrap_err();
    list_worlds(&server.uri, trusting(certificates.authority())).await.unwrap();
    server.stop().await;

    // A certificate for another name is rejected, unless the client expects that name.
    let server = start_tls_server(&certificates, "worlds.example", None);
    list_worlds(&server.uri, trusting(certificates.authority())).await.unwrap_err();
    let named = ClientTlsFiles {
        authority: Some(certificates.authority()),
        server_name: Some("worlds.example".to_owned()),
        ..Default::default()
    };
    list_worlds(&server.uri, named).await.unwrap();
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn with_a_client_authority_only_its_clients_are_let_in() {
    let (certificates, others) = (Certificates::new(), Certificates::new());
    let server = start_tls_server(&certificates, "127.0.0.1", Some(&certificates.authority()));
    let showing = |identity| ClientTlsFiles { authority: Some(certificates.authority()), identity, server_name: None };
    list_worlds(&server.uri, showing(None)).await.unwrap_err();
    list_worlds(&server.uri, showing(Some(others.issue("stranger")))).await.unwrap_err();
    list_worlds(&server.uri, showing(Some(certificates.issue("friend")))).await.unwrap();
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_certificate_is_reloaded_when_its_files_change_and_kept_while_they_are_broken() {
    let (former, next) = (Certificates::new(), Certificates::new());
    let (certificate, key) = former.issue("127.0.0.1");
    let tls = Some(ServerTls::load(&certificate, &key, None).unwrap());
    let security = Security { tls, tokens: Some(tokens()), ..Security::default() };
    let server = start_server_at(EndpointConfig { security, ..Default::default() }, ServerConfig::default());
    let trusting = |of: &Certificates| ClientTlsFiles { authority: Some(of.authority()), ..Default::default() };
    let credentials = Credentials::load(Some(&Secret::new(secret_of(Role::Admin))), &trusting(&former)).unwrap();
    let link = credentials.dial(&server.uri).unwrap().connect().await.unwrap();
    let mut client = WorldServiceClient::new(link);
    let map = Some(map_spec_to_wire(&MapSpec::with_side(1, 50).unwrap()));
    let world = client.create_world(CreateWorldRequest { map, ..Default::default() }).await.unwrap().into_inner().world;
    let watch = WatchWorldRequest { world_id: world.unwrap().world_id, rate_hz: 10.0, ..Default::default() };
    let mut snapshots = client.watch_world(watch).await.unwrap().into_inner();
    // The server logs a certificate without its key and keeps connections open. (Timing decides whether it reads this
    // one.)
    let (next_certificate, next_key) = next.issue("127.0.0.1");
    std::fs::copy(&next_certificate, &certificate).unwrap();
    list_worlds(&server.uri, trusting(&former)).await.unwrap();
    std::fs::copy(&next_key, &key).unwrap();
    let replaced = async { while list_worlds(&server.uri, trusting(&next)).await.is_err() {} };
    tokio::time::timeout(LIMIT, replaced).await.expect("the new certificate is shown");
    list_worlds(&server.uri, trusting(&former)).await.unwrap_err();
    for _ in 0..20 {
        snapshots.message().await.unwrap().expect("streams that had begun go on");
    }
    server.stop().await;
}

/// What a server is doing when it is stopped.
#[derive(Debug, Clone, Copy)]
enum Load {
    /// It sends to a client over TLS that does not read.
    UnreadOverTls,
    /// The same without TLS, and several streams.
    Unread,
    /// Its world is late, and more work waits.
    Busy,
    /// It generates the maps of saved worlds.
    StartUp,
}

async fn drain(load: Load) {
    let certificates = Certificates::new();
    let state = tempfile::tempdir().unwrap();
    let config = || ServerConfig { state: Some(state.path().to_owned()), ..ServerConfig::default() };
    let server = match load {
        Load::UnreadOverTls => start_tls_server(&certificates, "127.0.0.1", None),
        _ => start_server_at(EndpointConfig::default(), config()),
    };
    let files = ClientTlsFiles { authority: Some(certificates.authority()), ..Default::default() };
    let credentials = match load {
        Load::UnreadOverTls => Credentials::load(Some(&Secret::new(secret_of(Role::Admin))), &files).unwrap(),
        _ => Credentials::default(),
    };
    let link = credentials.dial(&server.uri).unwrap().connect().await.unwrap();
    // The folder of saved worlds is read first, on a busy machine for a while.
    let mut health = HealthClient::new(link.clone()).watch(HealthCheckRequest::default()).await.unwrap().into_inner();
    while health.message().await.unwrap().unwrap().status() != ServingStatus::Serving {}
    drop(health);
    let mut client = WorldServiceClient::new(link);
    let map = Some(map_spec_to_wire(&MapSpec::with_side(1, 60).unwrap()));
    let world = client.create_world(CreateWorldRequest { map, ..Default::default() }).await.unwrap().into_inner().world;
    let world_id = world.unwrap().world_id;
    let points = SampleGroundRequest { world_id, count: 64, seed: 1, body: None, ..Default::default() };
    let points = client.sample_ground(points).await.unwrap().into_inner().points;
    let spawn = |position| Spawn { position: Some(position), ..Default::default() };
    let spawns = points.into_iter().map(spawn).collect();
    client.batch_spawn_npcs(BatchSpawnNpcsRequest { world_id, spawns, ..Default::default() }).await.unwrap();
    let watch = WatchWorldRequest { world_id, rate_hz: 60.0, ..Default::default() };
    let mut unread = Vec::new();
    let server = match load {
        Load::UnreadOverTls | Load::Unread => {
            for _ in 0..4 {
                unread.push(client.watch_world(watch).await.unwrap());
            }
            server
        }
        Load::Busy => {
            for _ in 0..12 {
                tokio::spawn(server.stall(world_id, Duration::from_secs(1)));
            }
            unread.push(client.watch_world(watch).await.unwrap());
            server
        }
        Load::StartUp => {
            server.stop().await;
            start_server_at(EndpointConfig::default(), config())
        }
    };
    let ended = tokio::time::timeout(Duration::from_secs(10), server.stop()).await;
    assert!(ended.is_ok(), "a drain takes more than ten seconds: {load:?}");
    drop(unread);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_hundred_of_a_hundred_drains_end_within_ten_seconds() {
    const ROUNDS: usize = 4;
    for _ in 0..ROUNDS {
        let mut drains = tokio::task::JoinSet::new();
        for idx in 0..100 / ROUNDS {
            let load = [Load::UnreadOverTls, Load::Unread, Load::Busy, Load::StartUp][idx % 4];
            drains.spawn(drain(load));
        }
        while let Some(drained) = drains.join_next().await {
            drained.unwrap();
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_peer_that_does_not_finish_tls_is_cut_off() {
    use tokio::io::AsyncReadExt;
    let certificates = Certificates::new();
    let (certificate, key) = certificates.issue("127.0.0.1");
    let mut config = EndpointConfig::default();
    config.security.tls = Some(ServerTls::load(&certificate, &key, None).unwrap());
    config.limits.handshake_timeout = Duration::from_secs(1);
    let server = start_server_at(config, ServerConfig::default());
    let mut hesitant = tokio::net::TcpStream::connect(server.address()).await.unwrap();
    // The beginning of a TLS record that is never completed, longer than any preface.
    let begun = [&[0x16, 0x03, 0x01, 0x3f, 0xff, 0x01][..], &[0; 100]].concat();
    tokio::io::AsyncWriteExt::write_all(&mut hesitant, &begun).await.unwrap();
    let mut rest = Vec::new();
    let closing = tokio::time::timeout(Duration::from_secs(20), hesitant.read_to_end(&mut rest)).await;
    // The connection may be closed or reset.
    let _ = closing.expect("the server closes the connection");
    let files = ClientTlsFiles { authority: Some(certificates.authority()), ..Default::default() };
    list_worlds(&server.uri, files).await.unwrap();
    server.stop().await;
}

#[tokio::test]
async fn other_machines_are_served_with_tls_or_openly_without() {
    let everywhere = SocketAddr::from(([0, 0, 0, 0], 0));
    let refused = Endpoint::open(everywhere, EndpointConfig::default()).unwrap_err();
    assert!(matches!(refused, ServeError::Exposed(address) if address == everywhere));
    for words in ["0.0.0.0", "--tls-cert", "--tls-key", "--insecure"] {
        assert!(refused.to_string().contains(words), "{refused}");
    }
    // Tokens sent in clear text protect nothing.
    assert!(Endpoint::open(everywhere, guarded()).is_err());
    assert!(Endpoint::open("[::ffff:127.0.0.1]:0".parse().unwrap(), EndpointConfig::default()).is_ok());
    let mut config = EndpointConfig::default();
    config.security.insecure = true;
    Endpoint::open(everywhere, config).unwrap();
    let certificates = Certificates::new();
    let (certificate, key) = certificates.issue("127.0.0.1");
    let mut config = EndpointConfig::default();
    config.security.tls = Some(ServerTls::load(&certificate, &key, None).unwrap());
    Endpoint::open(everywhere, config).unwrap();
    assert!(ServerTls::load(&key, &certificate, None).is_err());
    let missing = ServerTls::load(&certificate, Path::new("/no/key.pem"), None).unwrap_err();
    assert!(missing.to_string().contains("/no/key.pem"), "{missing}");
}

/// A service that answers every call with the name of its caller.
#[derive(Clone)]
struct Echo;

impl tonic::server::NamedService for Echo {
    const NAME: &'static str = "surefoot.world.v1.WorldService";
}

impl tower_service::Service<http::Request<Body>> for Echo {
    type Response = http::Response<Body>;
    type Error = Infallible;
    type Future = std::future::Ready<Result<Self::Response, Infallible>>;

    fn poll_ready(&mut self, _: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: http::Request<Body>) -> Self::Future {
        let caller = request.extensions().get::<Caller>().map_or("nobody".to_owned(), |caller| caller.name.to_string());
        std::future::ready(Ok(Status::aborted(caller).into_http()))
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn services_know_who_calls() {
    for (config, credentials, name) in [
        (guarded(), holder(Role::Designer), "designer"),
        (EndpointConfig::default(), Credentials::default(), "127.0.0.1"),
        // Without tokens, the caller is identified by address only.
        (EndpointConfig::default(), holder(Role::Designer), "127.0.0.1"),
    ] {
        let endpoint = Endpoint::open(SocketAddr::from(([127, 0, 0, 1], 0)), config).unwrap();
        let (uri, shutdown) = (endpoint.uri(), Shutdown::default());
        let mut routes = tonic::service::Routes::builder();
        routes.add_service(Echo);
        let stop = shutdown.clone();
        let serving =
            tokio::spawn(async move { endpoint.serve(routes, &[], || async { String::new() }, stop).await.unwrap() });
        let link = credentials.dial(&uri).unwrap().connect().await.unwrap();
        let answer =
            WorldServiceClient::new(link).get_npc(GetNpcRequest { npc_id: 1, ..Default::default() }).await.unwrap_err();
        assert_eq!((answer.code(), answer.message()), (Code::Aborted, name));
        shutdown.trigger();
        serving.await.unwrap();
    }
}

#[test]
fn a_faulty_file_of_tokens_is_refused_without_showing_a_secret() {
    let secret = "hunter2-hunter2-hunter2";
    let entry = |name: &str, role: &str, secret: &str| {
        format!("[[token]]\nname = \"{name}\"\nrole = \"{role}\"\nsecret = \"{secret}\"\n")
    };
    let good = entry("a", "client", secret);
    Tokens::parse(&good).unwrap();
    for (text, expected) in [
        (String::new(), TokenError::Empty),
        ("token = []".to_owned(), TokenError::Empty),
        (format!("{good}secret \"{secret}\""), TokenError::Syntax { line: 5 }),
        (format!("{good}sekret = \"{secret}\""), TokenError::UnknownKey("sekret".to_owned())),
        (format!("tokens = \"{secret}\""), TokenError::UnknownKey("tokens".to_owned())),
        (entry("a", "king", secret), TokenError::Role("a".to_owned())),
        (entry("a", "client", &secret[..15]), TokenError::Short("a".to_owned())),
        (entry("a", "client", &format!("{secret} ")), TokenError::InvalidCharacter("a".to_owned())),
        (entry("", "client", secret), TokenError::Missing { position: 1, key: "name" }),
        (
            good.replace(&format!("\"{secret}\""), "1234567890123456"),
            TokenError::Missing { position: 1, key: "secret" },
        ),
        (good.clone() + &entry("b", "client", secret), TokenError::Duplicate("a".to_owned(), "b".to_owned())),
        (
            good.clone() + &entry("a", "worker", "another-secret-of-mine"),
            TokenError::Duplicate("a".to_owned(), "a".to_owned()),
        ),
    ] {
        let error = Tokens::parse(&text).unwrap_err();
        assert_eq!(error, expected, "{text}");
        assert!(!error.to_string().contains("hunter2") && !error.to_string().contains("1234567890"), "{error}");
    }
}

#[tokio::test]
async fn debug_output_shows_no_secret() {
    let certificates = Certificates::new();
    let (certificate, key) = certificates.issue("127.0.0.1");
    let server = Security {
        tls: Some(ServerTls::load(&certificate, &key, None).unwrap()),
        tokens: Some(tokens()),
        ..Security::default()
    };
    let credentials = holder(Role::Admin);
    let dialer = credentials.dial("http://127.0.0.1:1").unwrap();
    let shown =
        format!("{server:?} {credentials:?} {dialer:?} {:?} {:?}", dialer.connect_lazy(), Secret::new("the-secret-of"));
    assert!(shown.contains("\"admin\""), "{shown}");
    assert!(!shown.contains("the-secret-of"), "{shown}");
    let key = std::fs::read_to_string(&key).unwrap();
    let bytes = format!("{:?}", key.as_bytes()[40..60].to_vec());
    assert!(!shown.contains(&key[40..60]) && !shown.contains(bytes.trim_matches(['[', ']'])), "{shown}");
}

/// Sends a plain HTTP/1.1 request and returns the answer.
async fn http(server: &Running, request: &str) -> String {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    let mut socket = tokio::net::TcpStream::connect(server.address()).await.unwrap();
    let request = request.replace("\n", "\r\n");
    socket.write_all(request.as_bytes()).await.unwrap();
    let mut answer = Vec::new();
    socket.read_to_end(&mut answer).await.unwrap();
    String::from_utf8_lossy(&answer).into_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn pages_from_elsewhere_may_not_call() {
    let named = Security { origins: vec!["https://studio.example".to_owned()], ..Security::default() };
    let guarded = Security { tokens: Some(tokens()), ..Security::default() };
    let plain = start_server_at(EndpointConfig::default(), ServerConfig::default());
    let naming = start_server_at(EndpointConfig { security: named, ..Default::default() }, ServerConfig::default());
    let asking = start_server_at(EndpointConfig { security: guarded, ..Default::default() }, ServerConfig::default());
    let call = "/surefoot.world.v1.WorldService/ListWorlds";
    let body = "{}";
    for (server, host, origin, admitted) in [
        (&plain, "127.0.0.1:7600", "http://127.0.0.1:7601", true),
        (&plain, "localhost:7600", "http://127.0.0.1:5173", true),
        (&plain, "192.168.1.7:7600", "http://192.168.1.7:7601", true),
        (&plain, "192.168.1.7:7600", "http://192.168.1.8:7601", false),
        (&plain, "127.0.0.1:7600", "https://evil.example", false),
        // A foreign name that resolves to this host, as in DNS rebinding.
        (&plain, "evil.example:7600", "http://evil.example:7600", false),
        (&plain, "127.0.0.1:7600", "null", false),
        (&naming, "127.0.0.1:7600", "https://studio.example", true),
        (&naming, "127.0.0.1:7600", "https://studio.example.evil", false),
        (&asking, "worlds.example:7600", "http://worlds.example:7600", true),
        (&asking, "worlds.example:7600", "http://evil.example:7600", false),
    ] {
        let preflight = http(
            server,
            &format!(
                "OPTIONS {call} HTTP/1.1\nHost: {host}\nOrigin: {origin}\nConnection: close\n\
                 Access-Control-Request-Method: POST\n\
                 Access-Control-Request-Headers: content-type,connect-protocol-version\n\n"
            ),
        )
        .await;
        let allowed = preflight.contains(&format!("access-control-allow-origin: {origin}\r\n"));
        assert_eq!(allowed, admitted, "{origin} at {host}: {preflight}");
        let secret = secret_of(Role::Admin);
        let answer = http(
            server,
            &format!(
                "POST {call} HTTP/1.1\nHost: {host}\nOrigin: {origin}\nConnection: close\n\
                 Authorization: Bearer {secret}\nContent-Type: application/json\nContent-Length: {}\n\n{body}",
                body.len()
            ),
        )
        .await;
        assert_eq!(answer.contains("permission_denied"), !admitted, "{origin} at {host}: {answer}");
        assert_eq!(answer.starts_with("HTTP/1.1 200"), admitted, "{answer}");
    }
    for server in [plain, naming, asking] {
        server.stop().await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn without_a_token_pages_are_read_and_methods_are_not() {
    let endpoint = EndpointConfig {
        security: Security { tokens: Some(tokens()), ..Security::default() },
        ..EndpointConfig::default()
    };
    let server = start_server_at(endpoint, ServerConfig::default());
    let get = |path: &str, kind: &str| {
        let host = server.address();
        format!("GET {path} HTTP/1.1\nHost: {host}\nConnection: close\nContent-Type: {kind}\n\n")
    };
    let page = http(&server, &get("/studio.json", "text/plain")).await;
    assert!(page.contains("{\"planner\":\":7601\"}"), "{page}");
    if surefoot_studio::missing().is_none() {
        let page = http(&server, &get("/", "text/plain")).await;
        let named = "connect-src 'self' 127.0.0.1:7601 http://127.0.0.1:* http://localhost:*; ";
        assert!(page.contains(named), "{page}");
    }
    assert!(http(&server, &get("/nothing.js", "text/plain")).await.starts_with("HTTP/1.1 404"));
    for path in ["/surefoot.world.v1.WorldService/ListWorlds", "/surefoot.world.v1.MapService/ListMaps"] {
        let answer = http(&server, &get(path, "application/grpc")).await;
        assert!(answer.contains("grpc-status: 16"), "{answer}");
    }
    assert!(http(&server, &get("/metrics", "text/plain")).await.starts_with("HTTP/1.1 401"));
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn tokens_are_reloaded_when_their_file_changes_and_kept_when_it_is_broken() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tokens.toml");
    let entry =
        |name: &str| format!("[[token]]\nname = \"{name}\"\nrole = \"client\"\nsecret = \"the-secret-of-{name}\"\n");
    std::fs::write(&path, entry("first-client")).unwrap();
    let security = Security { tokens: Some(Tokens::load(&path).unwrap()), ..Default::default() };
    let server = start_server_at(EndpointConfig { security, ..Default::default() }, ServerConfig::default());
    let is_accepted = async |name: &str| {
        let link = link(&server, &with_token(&format!("the-secret-of-{name}"))).await;
        let result = WorldServiceClient::new(link).list_worlds(ListWorldsRequest::default()).await;
        result.map(drop).map_err(|status| status.code())
    };
    assert_eq!(is_accepted("first-client").await, Ok(()));
    assert_eq!(is_accepted("second-client").await, Err(Code::Unauthenticated));
    // A broken file is named in the log; nobody loses access. (Whether it is ever read depends on when.)
    std::fs::write(&path, "[[token]]\nname = \"first-client\"\n").unwrap();
    assert_eq!(is_accepted("first-client").await, Ok(()));
    std::fs::write(&path, entry("second-client")).unwrap();
    let replaced = async {
        while is_accepted("second-client").await.is_err() {
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(LIMIT, replaced).await.expect("the new token is accepted");
    assert_eq!(is_accepted("first-client").await, Err(Code::Unauthenticated), "the old one is withdrawn");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_token_that_is_removed_ends_its_open_streams_and_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tokens.toml");
    let entry = |name: &str, role: &str| {
        format!("[[token]]\nname = \"{name}\"\nrole = \"{role}\"\nsecret = \"the-secret-of-{name}\"\n")
    };
    let staying = entry("stays-here", "client");
    std::fs::write(
        &path,
        [&staying, &entry("leaves-soon", "client"), &entry("works-on", "worker")].map(|it| &**it).concat(),
    )
    .unwrap();
    let security = Security { tokens: Some(Tokens::load(&path).unwrap()), ..Default::default() };
    let server = start_server_at(EndpointConfig { security, ..Default::default() }, ServerConfig::default());
    let client =
        async |name: &str| WorldServiceClient::new(link(&server, &with_token(&format!("the-secret-of-{name}"))).await);
    let map = Some(map_spec_to_wire(&MapSpec::with_side(1, 50).unwrap()));
    let mut stays = client("stays-here").await;
    let world = stays.create_world(CreateWorldRequest { map, ..Default::default() }).await.unwrap().into_inner().world;
    let world_id = world.unwrap().world_id;
    let watch = WatchWorldRequest { world_id, rate_hz: 10.0, ..Default::default() };
    let mut kept = stays.watch_world(watch).await.unwrap().into_inner();
    let mut removed = client("leaves-soon").await.watch_world(watch).await.unwrap().into_inner();
    // A worker's stream, whose requests go on.
    let (requests, stream) = tokio::sync::mpsc::channel(1);
    let hello = Hello {
        name: "worker".to_owned(),
        capacity: 1,
        observation_len: OBSERVATION_LEN as u32,
        observation_version: OBSERVATION_VERSION,
        policy: "none".to_owned(),
    };
    requests.send(WorkRequest { message: Some(Work::Hello(hello)) }).await.unwrap();
    let stream = tokio_stream::wrappers::ReceiverStream::new(stream);
    let mut works = client("works-on").await.work(stream).await.unwrap().into_inner();
    // The same stream over Connect, in JSON and in protobuf.
    let raw = async |kind: &str, body: &[u8]| {
        let head = format!(
            "POST /surefoot.world.v1.WorldService/WatchWorld HTTP/1.1\r\nHost: {}\r\nContent-Type: {kind}\r\n\
             Authorization: Bearer the-secret-of-leaves-soon\r\nConnection: close\r\nContent-Length: {}\r\n\r\n",
            server.address(),
            body.len()
        );
        let mut socket = tokio::net::TcpStream::connect(server.address()).await.unwrap();
        socket.write_all(&[head.as_bytes(), body].concat()).await.unwrap();
        socket
    };
    let whole = |mut socket: tokio::net::TcpStream| {
        tokio::spawn(async move {
            let mut answer = Vec::new();
            socket.read_to_end(&mut answer).await.unwrap();
            String::from_utf8_lossy(&answer).into_owned()
        })
    };
    let json = whole(raw("application/json", format!("{{\"worldId\": \"{world_id}\"}}").as_bytes()).await);
    let message = WatchWorldRequest { world_id, ..Default::default() }.encode_to_vec();
    let framed = [&[0][..], &(message.len() as u32).to_be_bytes(), &message].concat();
    let proto = whole(raw("application/connect+proto", &framed).await);

    std::fs::write(&path, staying).unwrap();
    let ends = async {
        let end = loop {
            match removed.message().await {
                Ok(message) => assert!(message.is_some(), "the reader's stream ends without a status"),
                Err(status) => break status,
            }
        };
        let cut = loop {
            match works.message().await {
                Ok(message) => assert!(message.is_some(), "the worker's stream ends without a status"),
                Err(status) => break status,
            }
        };
        [end, cut]
    };
    for end in tokio::time::timeout(LIMIT, ends).await.expect("the streams end") {
        assert_eq!((end.code(), Reason::of(&end)), (Code::Unauthenticated, Some(Reason::TokenUnknown)), "{end}");
    }
    let texts = async { [json.await.unwrap(), proto.await.unwrap()] };
    let [json, proto] = tokio::time::timeout(LIMIT, texts).await.expect("the streams end");
    for text in [json, proto] {
        assert!(text.starts_with("HTTP/1.1 200") && text.contains("\"unauthenticated\""), "{text}");
    }
    for _ in 0..20 {
        kept.message().await.unwrap().expect("the stream of another token goes on");
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn certificates_of_clients_and_their_authority_are_reloaded_at_both_ends() {
    let (server_side, former, next) = (Certificates::new(), Certificates::new(), Certificates::new());
    let clients = server_side.folder.path().join("clients.pem");
    std::fs::copy(former.authority(), &clients).unwrap();
    let server = start_tls_server(&server_side, "127.0.0.1", Some(&clients));
    let showing = |identity| ClientTlsFiles {
        authority: Some(server_side.authority()),
        identity: Some(identity),
        server_name: None,
    };
    let (certificate, key) = former.issue("friend");
    let (next_certificate, next_key) = next.issue("friend");
    let files = showing((certificate.clone(), key.clone()));
    let token = folder_file(&former, "token", &secret_of(Role::Admin));
    let credentials = Credentials::load_with_token_file(&token, &files).unwrap();
    let link = credentials.dial(&server.uri).unwrap().connect_lazy();
    let list = async || WorldServiceClient::new(link.clone()).list_worlds(ListWorldsRequest::default()).await;
    list().await.unwrap();
    list_worlds(&server.uri, showing((next_certificate.clone(), next_key.clone()))).await.unwrap_err();
    // The server trusts another authority from now on. Its certificate stays as it was.
    std::fs::copy(next.authority(), &clients).unwrap();
    let replaced = async {
        while list_worlds(&server.uri, showing((next_certificate.clone(), next_key.clone()))).await.is_err() {}
    };
    tokio::time::timeout(LIMIT, replaced).await.expect("the server trusts the new authority");
    list_worlds(&server.uri, files).await.unwrap_err();
    let outdated = async { while list().await.is_ok() {} };
    tokio::time::timeout(LIMIT, outdated).await.expect("the client has to connect again");
    // The same link goes on once its files are replaced.
    std::fs::copy(&next_certificate, &certificate).unwrap();
    std::fs::copy(&next_key, &key).unwrap();
    let reloaded = async { while list().await.is_err() {} };
    tokio::time::timeout(LIMIT, reloaded).await.expect("the client shows its new certificate");
    // So does a token in a file.
    std::fs::write(&token, secret_of(Role::Worker)).unwrap();
    let refused = async {
        loop {
            if let Err(status) = list().await {
                return Reason::of(&status);
            }
        }
    };
    let reason = tokio::time::timeout(LIMIT, refused).await.expect("the client shows its new token");
    assert_eq!(reason, Some(Reason::RoleForbidden));
    server.stop().await;
}

/// Writes a file beside the certificates.
fn folder_file(certificates: &Certificates, name: &str, text: &str) -> PathBuf {
    let path = certificates.folder.path().join(name);
    std::fs::write(&path, text).unwrap();
    path
}
