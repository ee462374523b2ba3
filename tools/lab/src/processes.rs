//! Services of `surefoot` in processes of their own, as they are deployed.

use crate::bench::link::Link;
use anyhow::{Context, bail};
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::planner::v1::{Build, WatchBuildRequest};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tonic::Status;
use tonic::transport::{Channel, Endpoint};

/// A process, killed on drop.
pub struct Process(Child);

impl Process {
    /// Starts `command` without input and output; its errors go where `errors` says.
    pub fn spawn(command: &mut Command, errors: Stdio) -> anyhow::Result<Self> {
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(errors).spawn();
        child.map(Self).with_context(|| format!("cannot start {}", command.get_program().display()))
    }

    /// Id of the process.
    pub fn id(&self) -> u32 {
        self.0.id()
    }

    /// Resident memory, MiB.
    pub fn memory_mib(&self) -> anyhow::Result<f64> {
        let kib = crate::bench::process_status(&self.id().to_string(), "VmRSS");
        Ok(kib.context("the system does not report VmRSS")? / 1024.0)
    }

    /// CPU time so far, of all threads, s.
    pub fn cpu_s(&self) -> anyhow::Result<f64> {
        cpu_s(&self.id().to_string())
    }

    /// Whether the process still runs.
    pub fn is_running(&mut self) -> bool {
        matches!(self.0.try_wait(), Ok(None))
    }
}

/// CPU time of a process so far, of all threads, s; `pid` may be `self`.
pub fn cpu_s(pid: &str) -> anyhow::Result<f64> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).context("no CPU times of a process")?;
    // The name of the program, in parentheses, may hold anything. User and system time follow, in hundredths of a
    // second.
    let after_name = stat.rsplit_once(')').map_or("", |(_, rest)| rest).split_whitespace();
    let times: Vec<f64> = after_name.skip(11).take(2).filter_map(|field| field.parse().ok()).collect();
    anyhow::ensure!(times.len() == 2, "the system reports no CPU times of a process");
    Ok(times.iter().sum::<f64>() / 100.0)
}

impl Drop for Process {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Starts a service of `surefoot` in a process of its own.
pub fn start(args: &[&str]) -> anyhow::Result<Process> {
    let mut command = Command::new(surefoot_cli::programs::beside("surefoot")?);
    // Workers warn when the server of a scene stops, which is expected here.
    Process::spawn(command.args(args).env("RUST_LOG", "error"), Stdio::inherit())
}

/// How services are started.
#[derive(Clone, Copy)]
pub struct Setup<'a> {
    /// Most NPCs.
    pub npcs: usize,
    /// Number of workers.
    pub workers: usize,
    /// Folder for graphs.
    pub cache: &'a Path,
    /// Links over which the workers reach the server and the planner.
    pub links: Option<[&'a Link; 2]>,
    /// Further arguments of the server.
    pub of_server: &'a [&'a str],
}

/// A server, a planner and workers, each in its own process. They end when this value is dropped.
pub struct Services {
    /// First the server, then the planner, then the workers.
    pub processes: Vec<Process>,
    pub server_uri: String,
    pub planner_uri: String,
    /// A connection to the server.
    pub server: Channel,
}

impl<'a> Setup<'a> {
    /// Two workers beside the server and the planner.
    pub fn new(npcs: usize, cache: &'a Path) -> Self {
        Self { npcs, workers: 2, cache, links: None, of_server: &[] }
    }
}

impl Services {
    pub async fn start(Setup { npcs, workers, cache, links, of_server }: Setup<'_>) -> anyhow::Result<Self> {
        let [server_at, planner_at] = [free_address()?, free_address()?];
        let (listen, planner_listen) = (server_at.to_string(), planner_at.to_string());
        let (server_uri, planner_uri) = (format!("http://{listen}"), format!("http://{planner_listen}"));
        let [for_workers, plans_for_workers] = match links {
            None => [server_uri.clone(), planner_uri.clone()],
            Some([to_server, to_planner]) => {
                [to_server.relay(server_at)?, to_planner.relay(planner_at)?].map(|at| format!("http://{at}"))
            }
        };
        let cache = cache.to_str().context("the path of the cache folder is not UTF-8")?;
        let limit = npcs.to_string();
        let mut processes = vec![
            start(&[&["serve", "--listen", &listen, "--max-npcs-per-client", &limit], of_server].concat())?,
            start(&["plan", "--listen", &planner_listen, "--cache", cache])?,
        ];
        let server = connect(&server_uri).await?;
        connect(&planner_uri).await?;
        let work = ["work", "--server", &for_workers, "--planner", &plans_for_workers, "--npcs", &limit];
        for _ in 0..workers {
            processes.push(start(&work)?);
        }
        Ok(Self { processes, server_uri, planner_uri, server })
    }
}

impl Drop for Services {
    fn drop(&mut self) {
        // Workers end before the services that they connect to.
        while self.processes.pop().is_some() {}
    }
}

/// An address with a free port.
pub fn free_address() -> anyhow::Result<SocketAddr> {
    Ok(TcpListener::bind("127.0.0.1:0")?.local_addr()?)
}

/// Connects to a service that is starting.
pub async fn connect(uri: &str) -> anyhow::Result<Channel> {
    let endpoint = Endpoint::from_shared(uri.to_owned())?.tcp_nodelay(true);
    let since = Instant::now();
    loop {
        match endpoint.connect().await {
            Ok(channel) => return Ok(channel),
            Err(error) if since.elapsed() > Duration::from_secs(20) => {
                bail!("no answer from {uri}: {error}");
            }
            Err(_) => tokio::time::sleep(Duration::from_millis(50)).await,
        }
    }
}

/// Waits until a build has ended, and returns its last state.
pub async fn await_build(client: &mut PlannerServiceClient<Channel>, build: Build) -> Result<Build, Status> {
    let mut stages = client.watch_build(WatchBuildRequest { build_id: build.build_id }).await?.into_inner();
    let mut last = Build::default();
    while let Some(stage) = stages.message().await? {
        last = stage.build.unwrap_or_default();
    }
    Ok(last)
}

/// A number among the metrics of a service.
pub async fn metric(uri: &str, name: &str) -> anyhow::Result<f64> {
    let address = uri.trim_start_matches("http://");
    let mut socket = TcpStream::connect(address).await?;
    let request = format!("GET /metrics HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
    socket.write_all(request.as_bytes()).await?;
    let mut page = String::new();
    socket.read_to_string(&mut page).await?;
    let value = page.lines().find_map(|line| line.strip_prefix(name)?.trim().parse().ok());
    value.with_context(|| format!("the metrics of {uri} lack {name}"))
}
