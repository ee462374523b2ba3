//! Processes that end with the test.

use std::fs::File;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};
use tonic::transport::{Channel, Endpoint};

/// Far longer than any step takes, so that a hang fails the test instead of blocking it.
pub const LIMIT: Duration = Duration::from_secs(180);

/// A port of this machine that was free a moment ago.
pub fn free_address() -> SocketAddr {
    TcpListener::bind("127.0.0.1:0").expect("a free port").local_addr().expect("an address")
}

/// Asks `is_so` until it is; `what` names what is waited for.
///
/// # Panics
/// After [`LIMIT`].
pub async fn wait_until<F: Future<Output = bool>>(what: &str, mut is_so: impl FnMut() -> F) {
    let since = Instant::now();
    while !is_so().await {
        assert!(since.elapsed() < LIMIT, "waited in vain: {what}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// A process, killed on drop.
#[derive(Debug)]
pub struct Process {
    child: Child,
    log: PathBuf,
}

impl Process {
    /// Starts `command`, whose output goes to the file `log`.
    pub fn spawn(mut command: Command, log: &Path) -> Self {
        let file = File::options().create(true).append(true).open(log).expect("a log file");
        let output = || Stdio::from(file.try_clone().expect("a file"));
        command.stdin(Stdio::null()).stdout(output()).stderr(output());
        let child = command.spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
        Self { child, log: log.to_owned() }
    }

    /// Ends it at once, as a power failure would.
    pub fn kill(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// Sends a signal: `STOP`, `CONT`, `TERM`.
    pub fn signal(&self, name: &str) {
        let sent = Command::new("kill").args([&format!("-{name}"), &self.child.id().to_string()]).status();
        assert!(sent.is_ok_and(|status| status.success()), "signal {name}");
    }

    /// Waits until it ends.
    pub fn wait(&mut self) -> ExitStatus {
        let since = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().expect("a child") {
                return status;
            }
            assert!(since.elapsed() < LIMIT, "it does not end: {}", self.log());
            std::thread::yield_now();
        }
    }

    /// Whether it runs.
    pub fn is_running(&mut self) -> bool {
        self.child.try_wait().expect("a child").is_none()
    }

    /// Whether a signal has stopped it.
    pub fn is_stopped(&self) -> bool {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.child.id())).unwrap_or_default();
        stat.rsplit_once(") ").is_some_and(|(_, state)| state.starts_with('T'))
    }

    /// Most memory that it has had at a time, bytes.
    pub fn peak_memory_bytes(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).expect("a process");
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("its peak");
        1024 * line.trim().trim_end_matches(" kB").parse::<u64>().expect("a number")
    }

    /// All that it has printed.
    pub fn log(&self) -> String {
        std::fs::read_to_string(&self.log).unwrap_or_default()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.kill();
        if std::thread::panicking() {
            eprintln!("--- {}\n{}", self.log.display(), self.log());
        }
    }
}

/// One of our own services.
#[derive(Debug)]
pub struct Surefoot {
    /// Its process.
    pub process: Process,
    /// Where it serves.
    pub address: SocketAddr,
    program: PathBuf,
    args: Vec<String>,
    env: Vec<(String, String)>,
    log: PathBuf,
}

/// The program that the tests were built with.
pub fn this_version() -> &'static Path {
    Path::new(env!("CARGO_BIN_EXE_surefoot"))
}

impl Surefoot {
    /// Starts `surefoot` with these arguments, to which `--listen` is added, and its log at `log`.
    pub fn start(args: &[&str], env: &[(String, String)], log: &Path) -> Self {
        Self::start_version(this_version(), args, env, log)
    }

    /// As [`start`](Self::start), with another version of the program.
    pub fn start_version(program: &Path, args: &[&str], env: &[(String, String)], log: &Path) -> Self {
        let args: Vec<String> = args.iter().map(|&arg| arg.to_owned()).collect();
        let address = free_address();
        let process = launch(program, &args, env, address, log);
        Self { process, address, program: program.to_owned(), args, env: env.to_vec(), log: log.to_owned() }
    }

    /// Kills it and starts it again, at the same address.
    pub fn restart(&mut self) {
        self.process.kill();
        self.process = launch(&self.program, &self.args, &self.env, self.address, &self.log);
    }

    /// Asks it to stop, waits until it has, and starts this version at the same address.
    pub fn upgrade(&mut self) {
        self.process.signal("TERM");
        assert!(self.process.wait().success(), "it stops when it is asked to: {}", self.process.log());
        self.program = this_version().to_owned();
        self.restart();
    }

    /// Its URI.
    pub fn uri(&self) -> String {
        format!("http://{}", self.address)
    }

    /// A connection to it, once it serves.
    pub async fn connect(&self) -> Channel {
        let endpoint = Endpoint::from_shared(self.uri()).expect("a URI");
        let since = Instant::now();
        loop {
            match endpoint.connect().await {
                Ok(channel) => return channel,
                Err(error) => assert!(since.elapsed() < LIMIT, "no service: {error}\n{}", self.process.log()),
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    /// The value of one of its metrics, such as `surefoot_plans_total`; `None` if it has none of that name or does not answer.
    pub fn metric(&self, name: &str) -> Option<f64> {
        let page = get(self.address, "/metrics")?;
        let line =
            page.lines().find(|line| line.strip_prefix(name).is_some_and(|rest| rest.starts_with([' ', '{'])))?;
        line.rsplit_once(' ')?.1.parse().ok()
    }
}

/// `PROGRAM ARGS --listen ADDRESS`.
fn launch(program: &Path, args: &[String], env: &[(String, String)], address: SocketAddr, log: &Path) -> Process {
    let mut command = Command::new(program);
    command.args(args).args(["--listen", &address.to_string()]).envs(env.iter().cloned());
    Process::spawn(command, log)
}

/// The body of a page.
fn get(address: SocketAddr, path: &str) -> Option<String> {
    let mut stream = TcpStream::connect_timeout(&address, Duration::from_secs(2)).ok()?;
    stream.set_read_timeout(Some(Duration::from_secs(5))).ok()?;
    stream.write_all(format!("GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n").as_bytes()).ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    Some(answer.split_once("\r\n\r\n")?.1.to_owned())
}
