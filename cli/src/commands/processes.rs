//! Services of this program in processes of their own, for what measures them as they are deployed.

use anyhow::{Context, bail};
use std::net::{SocketAddr, TcpListener};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tonic::transport::{Channel, Endpoint};

/// A service in its own process, killed on drop.
pub struct Process(Child);

impl Process {
    /// Id of the process.
    pub fn id(&self) -> u32 {
        self.0.id()
    }

    /// Resident memory, MiB.
    pub fn memory_mib(&self) -> anyhow::Result<f64> {
        let kib = super::bench::process_status(&self.id().to_string(), "VmRSS");
        Ok(kib.context("the system does not report VmRSS")? / 1024.0)
    }

    /// CPU time so far, of all threads, s.
    pub fn cpu_s(&self) -> anyhow::Result<f64> {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.id())).context("no CPU times of a process")?;
        cpu_s_in(&stat).context("the system reports no CPU times of a process")
    }

    /// Whether the process still runs.
    pub fn is_running(&mut self) -> bool {
        matches!(self.0.try_wait(), Ok(None))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// CPU time of a process, of all its threads, as its file `stat` says, s.
pub fn cpu_s_in(stat: &str) -> Option<f64> {
    // The name of the program, in parentheses, may hold anything. User and system time follow, in hundredths of a second.
    let (_, after_name) = stat.rsplit_once(')')?;
    let times: Vec<f64> =
        after_name.split_whitespace().skip(11).take(2).filter_map(|field| field.parse().ok()).collect();
    (times.len() == 2).then(|| times.iter().sum::<f64>() / 100.0)
}

/// Starts a service of this program in a process of its own.
pub fn start(args: &[&str]) -> anyhow::Result<Process> {
    let program = std::env::current_exe()?;
    let child = Command::new(program)
        .args(args)
        // Workers warn when the server of a scene stops, which is expected here.
        .env("RUST_LOG", "error")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::inherit())
        .spawn()
        .with_context(|| format!("cannot start surefoot {}", args[0]))?;
    Ok(Process(child))
}

/// An address with a port that was free a moment ago.
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
