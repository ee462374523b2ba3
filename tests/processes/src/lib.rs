//! Processes of our own programs, which end with the test that started them.

use std::fs::File;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};
use tonic::transport::{Channel, Endpoint};

/// Far longer than any step takes, so that a hang fails the test instead of blocking it.
pub const LIMIT: Duration = Duration::from_secs(180);

/// The program `name` of the build that the running test belongs to.
///
/// # Panics
/// If the build has no such program.
pub fn program(name: &str) -> PathBuf {
    let test = std::env::current_exe().expect("the test's path");
    let folder = test.parent().and_then(Path::parent).expect("target/PROFILE/deps/TEST");
    let program = folder.join(name).with_extension(std::env::consts::EXE_EXTENSION);
    assert!(program.exists(), "{} has not been built", program.display());
    program
}

/// `surefoot` with these arguments, without input and without an environment variable that changes its log.
pub fn surefoot(args: &[&str]) -> Command {
    let mut command = Command::new(program("surefoot"));
    command.args(args).env_remove("RUST_LOG").stdin(Stdio::null());
    command
}

/// Runs `surefoot` with these arguments to its end.
pub fn output(args: &[&str]) -> Output {
    surefoot(args).output().expect("the program starts")
}

/// Ports that are tried: below those that systems give to clients, so that no connection takes one before its server
/// listens.
const PORTS: Range<u16> = 15_000..32_000;

/// An address on which nothing listens. No two calls in a process have the same.
pub fn free_address() -> SocketAddr {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    let first = std::process::id().wrapping_mul(61);
    let ports = (0..PORTS.len()).map(|_| {
        let place = first.wrapping_add(NEXT.fetch_add(1, Ordering::Relaxed)) % PORTS.len() as u32;
        PORTS.start + place as u16
    });
    let mut addresses = ports.map(|port| SocketAddr::from(([127, 0, 0, 1], port)));
    addresses.find(|address| TcpListener::bind(address).is_ok()).expect("a free port")
}

/// Calls `is_so` every 20 ms until it returns true; `what` names the condition.
///
/// # Panics
/// After [`LIMIT`].
pub async fn wait_until<F: Future<Output = bool>>(what: &str, mut is_so: impl FnMut() -> F) {
    let since = Instant::now();
    while !is_so().await {
        assert!(since.elapsed() < LIMIT, "timed out: {what}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// Waits until a service accepts connections at `address`.
///
/// # Panics
/// After [`LIMIT`].
pub fn wait_for(address: SocketAddr) {
    let since = Instant::now();
    while TcpStream::connect(address).is_err() {
        assert!(since.elapsed() < LIMIT, "no service at {address}");
        std::thread::yield_now();
    }
}

/// A connection to a service that may not have started yet.
///
/// # Panics
/// After [`LIMIT`].
pub async fn connect(address: SocketAddr) -> Channel {
    let endpoint = Endpoint::from_shared(format!("http://{address}")).expect("a URI");
    let since = Instant::now();
    loop {
        match endpoint.connect().await {
            Ok(channel) => return channel,
            Err(error) => assert!(since.elapsed() < LIMIT, "no service at {address}: {error}"),
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// A process, killed on drop.
#[derive(Debug)]
pub struct Process {
    command: Command,
    child: Child,
    log: Option<PathBuf>,
}

impl Process {
    /// Starts `command`. Its output goes to the file `log`, which is printed if the test fails.
    ///
    /// # Panics
    /// If the process or the file cannot be created.
    pub fn spawn(mut command: Command, log: &Path) -> Self {
        let file = File::options().create(true).append(true).open(log).expect("a log file");
        let output = || Stdio::from(file.try_clone().expect("a file"));
        command.stdout(output()).stderr(output());
        Self::start(command, Some(log.to_owned()))
    }

    /// Starts `command` without output.
    ///
    /// # Panics
    /// If the process cannot be created.
    pub fn spawn_silent(mut command: Command) -> Self {
        command.stdout(Stdio::null()).stderr(Stdio::null());
        Self::start(command, None)
    }

    fn start(mut command: Command, log: Option<PathBuf>) -> Self {
        let child = command.stdin(Stdio::null()).spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
        Self { command, child, log }
    }

    /// Kills the process and starts the same command again.
    ///
    /// # Panics
    /// If the process cannot be created.
    pub fn restart(&mut self) {
        self.kill();
        self.child = self.command.spawn().unwrap_or_else(|error| panic!("{:?}: {error}", self.command));
    }

    /// Ends the process at once, as a power failure would.
    pub fn kill(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// Sends a signal: `STOP`, `CONT`, `TERM`.
    ///
    /// # Panics
    /// If the process has ended.
    pub fn signal(&self, name: &str) {
        let sent = Command::new("kill").args([&format!("-{name}"), &self.child.id().to_string()]).status();
        assert!(sent.is_ok_and(|status| status.success()), "signal {name}");
    }

    /// Sends SIGTERM and waits for the end, which must be a success.
    ///
    /// # Panics
    /// If the process fails or still runs after [`LIMIT`].
    pub fn stop(&mut self) {
        self.stop_within(LIMIT);
    }

    /// Sends SIGTERM and waits for the end, which must be a success within `limit`.
    ///
    /// # Panics
    /// If the process fails or still runs after `limit`.
    pub fn stop_within(&mut self, limit: Duration) {
        self.signal("TERM");
        let status = self.wait_within(limit);
        assert!(status.success(), "{status} after SIGTERM: {}", self.log());
    }

    /// Waits for the end of the process.
    ///
    /// # Panics
    /// After [`LIMIT`].
    pub fn wait(&mut self) -> ExitStatus {
        self.wait_within(LIMIT)
    }

    fn wait_within(&mut self, limit: Duration) -> ExitStatus {
        let since = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().expect("a child") {
                return status;
            }
            assert!(since.elapsed() < limit, "the process still runs after {limit:?}: {}", self.log());
            std::thread::yield_now();
        }
    }

    /// Whether the process runs.
    pub fn is_running(&mut self) -> bool {
        self.child.try_wait().expect("a child").is_none()
    }

    /// Whether a signal has stopped the process.
    pub fn is_stopped(&self) -> bool {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.child.id())).unwrap_or_default();
        stat.rsplit_once(") ").is_some_and(|(_, state)| state.starts_with('T'))
    }

    /// Nice value of a thread whose name begins with `name`; `None` if there is no such thread, or the system is not
    /// Linux.
    pub fn nice_of(&self, name: &str) -> Option<i32> {
        let threads = std::fs::read_dir(format!("/proc/{}/task", self.child.id())).ok()?;
        threads.flatten().find_map(|thread| {
            let stat = std::fs::read_to_string(thread.path().join("stat")).ok()?;
            let (named, rest) = stat.rsplit_once(") ")?;
            let is_named = named.split_once('(')?.1.starts_with(name);
            is_named.then(|| rest.split(' ').nth(16)?.parse().ok())?
        })
    }

    /// Peak of the resident memory, bytes.
    ///
    /// # Panics
    /// If the process has ended, or the system is not Linux.
    pub fn peak_memory_bytes(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).expect("a process");
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("its peak");
        1024 * line.trim().trim_end_matches(" kB").parse::<u64>().expect("a number")
    }

    /// Its output so far; empty for a silent process.
    pub fn log(&self) -> String {
        self.log.as_ref().map_or_else(String::new, |log| std::fs::read_to_string(log).unwrap_or_default())
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.kill();
        if let (true, Some(log)) = (std::thread::panicking(), &self.log) {
            eprintln!("--- {}\n{}", log.display(), self.log());
        }
    }
}

/// One of our own services.
#[derive(Debug)]
pub struct Surefoot {
    /// Its process.
    pub process: Process,
    /// The address that it serves at.
    pub address: SocketAddr,
    args: Vec<String>,
    env: Vec<(String, String)>,
    log: PathBuf,
}

impl Surefoot {
    /// Starts `surefoot ARGS --listen ADDRESS` at a free address, with its output in the file `log`.
    ///
    /// # Panics
    /// If the process or the file cannot be created.
    pub fn start(args: &[&str], env: &[(String, String)], log: &Path) -> Self {
        Self::start_version(&program("surefoot"), args, env, log)
    }

    /// Like [`start`](Self::start), but runs another version of the program.
    ///
    /// # Panics
    /// If the process or the file cannot be created.
    pub fn start_version(program: &Path, args: &[&str], env: &[(String, String)], log: &Path) -> Self {
        let args: Vec<String> = args.iter().map(|&arg| arg.to_owned()).collect();
        let address = free_address();
        let process = launch(program, &args, env, address, log);
        Self { process, address, args, env: env.to_vec(), log: log.to_owned() }
    }

    /// Waits until the service accepts connections.
    ///
    /// # Panics
    /// After [`LIMIT`].
    pub fn wait_until_it_listens(&self) {
        wait_for(self.address);
    }

    /// Kills the service and starts it again at the same address.
    pub fn restart(&mut self) {
        self.process.restart();
    }

    /// Stops the service and starts the version under test at the same address.
    pub fn upgrade(&mut self) {
        self.process.stop();
        self.process = launch(&program("surefoot"), &self.args, &self.env, self.address, &self.log);
    }

    /// Its URI.
    pub fn uri(&self) -> String {
        format!("http://{}", self.address)
    }

    /// A connection to the service, once it serves.
    ///
    /// # Panics
    /// After [`LIMIT`].
    pub async fn connect(&self) -> Channel {
        connect(self.address).await
    }

    /// The value of one of its metrics, such as `surefoot_plans_total`. `None` if there is no such metric or no answer.
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
