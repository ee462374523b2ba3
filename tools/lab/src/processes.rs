//! Services of `surefoot` in processes of their own, as they are deployed.

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
    let child = Command::new(surefoot_cli::programs::beside("surefoot")?)
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
