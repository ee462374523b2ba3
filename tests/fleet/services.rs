//! The engines of a fleet: PostgreSQL, NATS and an S3 server, each with data of its own that ends with the test. They
//! are looked for in
//! `PATH`, and where Debian has them.

use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};
use surefoot_processes::{LIMIT, Process, free_address, output};

/// Folder with all data and logs of a test.
#[derive(Debug)]
pub struct Ground(tempfile::TempDir);

impl Ground {
    /// An empty folder.
    pub fn new() -> Self {
        let folder = tempfile::Builder::new().prefix("surefoot-fleet-").tempdir().expect("a folder");
        // PostgreSQL runs as another user.
        let open = std::os::unix::fs::PermissionsExt::from_mode(0o755);
        std::fs::set_permissions(folder.path(), open).expect("our own folder");
        Self(folder)
    }

    /// A path in it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// `file://` and a folder in it, for blobs.
    pub fn blobs(&self) -> String {
        format!("file://{}", self.path("blobs").display())
    }
}

/// Waits until something listens at `address`.
fn wait_for(address: SocketAddr, process: &mut Process) {
    let since = Instant::now();
    while TcpStream::connect(address).is_err() {
        assert!(process.is_running() && since.elapsed() < LIMIT, "it does not start: {}", process.log());
        std::thread::park_timeout(Duration::from_millis(20));
    }
}

/// A PostgreSQL server with one database.
#[derive(Debug)]
pub struct Postgres {
    process: Process,
    /// Where it listens.
    pub address: SocketAddr,
    data: PathBuf,
}

impl Postgres {
    /// Creates and starts one, with the schema of this version.
    pub fn start(ground: &Ground) -> Self {
        let postgres = Self::start_empty(ground);
        postgres.migrate();
        postgres
    }

    /// Creates and starts one without a schema.
    pub fn start_empty(ground: &Ground) -> Self {
        let data = ground.path("postgres");
        std::fs::create_dir(&data).expect("a folder");
        let mut create = postgres_command("initdb", &data);
        create
            .args(["--username", "postgres", "--auth", "trust", "--no-sync", "--encoding", "UTF8", "--pgdata"])
            .arg(&data);
        let created = create.output().expect("initdb runs");
        assert!(created.status.success(), "initdb: {}", String::from_utf8_lossy(&created.stderr));
        let address = free_address();
        let process = Self::launch(&data, address);
        let mut postgres = Self { process, address, data };
        postgres.wait();
        postgres.run("CREATE ROLE surefoot LOGIN", "postgres");
        postgres.run("CREATE DATABASE surefoot", "postgres");
        postgres
    }

    /// Brings the schema up to date, as the job of a deployment does.
    ///
    /// # Panics
    /// If that fails.
    pub fn migrate(&self) {
        let migrated = output(&["fleet", "migrate", "--store", &self.owner_url("surefoot"), "--role", "surefoot"]);
        assert!(migrated.status.success(), "{}", String::from_utf8_lossy(&migrated.stderr));
    }

    fn launch(data: &Path, address: SocketAddr) -> Process {
        let mut command = postgres_command("postgres", data);
        command.arg("-D").arg(data).args(["-p", &address.port().to_string(), "-h", "127.0.0.1", "-k", ""]);
        // Commits must not outlive a kill of the process by luck only: the kernel keeps what was written.
        command.args(["-c", "max_connections=200"]);
        Process::spawn(command, &data.with_extension("log"))
    }

    fn wait(&mut self) {
        wait_for(self.address, &mut self.process);
        let since = Instant::now();
        while self.try_run("SELECT 1", "postgres").is_none() {
            assert!(since.elapsed() < LIMIT, "PostgreSQL does not answer: {}", self.process.log());
            std::thread::park_timeout(Duration::from_millis(20));
        }
    }

    /// Its URL, with the role of servers and planners, which may not change tables.
    pub fn url(&self) -> String {
        Self::url_at(self.address)
    }

    /// The URL of one of its databases, with a role that may do everything.
    pub fn owner_url(&self, database: &str) -> String {
        format!("postgres://postgres@{}/{database}", self.address)
    }

    /// Its URL behind a relay at `address`.
    pub fn url_at(address: SocketAddr) -> String {
        format!("postgres://surefoot@{address}/surefoot")
    }

    /// The rows that a statement returns, as text: columns are divided by `|`.
    ///
    /// # Panics
    /// If it fails.
    pub fn query(&self, statement: &str) -> Vec<String> {
        self.run(statement, "surefoot")
    }

    /// Whether a statement fails for the role of servers and planners.
    pub fn refuses(&self, statement: &str) -> bool {
        self.try_run(&format!("SET ROLE surefoot; {statement}"), "surefoot").is_none()
    }

    fn run(&self, statement: &str, database: &str) -> Vec<String> {
        self.try_run(statement, database).unwrap_or_else(|| panic!("PostgreSQL refuses {statement}"))
    }

    fn try_run(&self, statement: &str, database: &str) -> Option<Vec<String>> {
        let mut psql = Command::new("psql");
        psql.args([&self.owner_url(database), "-X", "-q", "-A", "-t", "-c", statement]);
        let output = psql.output().expect("psql runs");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        output.status.success().then(|| text.lines().map(str::to_owned).collect())
    }

    /// Kills it.
    pub fn kill(&mut self) {
        self.process.kill();
        // Killed as well, but by themselves: its children notice.
        let _ = std::fs::remove_file(self.data.join("postmaster.pid"));
    }

    /// Starts it again after a kill, with its data.
    pub fn start_again(&mut self) {
        // Children of the killed process hold the shared memory for a moment.
        let since = Instant::now();
        loop {
            self.process = Self::launch(&self.data, self.address);
            while self.process.is_running() {
                if self.try_run("SELECT 1", "surefoot").is_some() {
                    return;
                }
                assert!(since.elapsed() < LIMIT, "PostgreSQL does not answer: {}", self.process.log());
                std::thread::park_timeout(Duration::from_millis(20));
            }
            assert!(since.elapsed() < LIMIT, "PostgreSQL does not start: {}", self.process.log());
        }
    }
}

/// A program of PostgreSQL. It refuses to run as root, who runs it as the owner of Debian's.
fn postgres_command(program: &str, data: &Path) -> Command {
    let mut folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()).collect();
    let debian = std::fs::read_dir("/usr/lib/postgresql").into_iter().flatten().flatten();
    folders.extend(debian.map(|version| version.path().join("bin")));
    // Not what stands in PATH for another purpose: all programs come from one folder.
    let folder = folders.iter().find(|folder| folder.join("initdb").exists());
    let program = folder.expect("PostgreSQL is installed").join(program);
    if !is_root() {
        return Command::new(program);
    }
    let owned = Command::new("chown").arg("postgres").arg(data).status();
    assert!(owned.is_ok_and(|status| status.success()), "PostgreSQL needs the user postgres where root runs the tests");
    let mut command = Command::new("setpriv");
    command.args(["--reuid", "postgres", "--regid", "postgres", "--clear-groups", "--"]).arg(program);
    command
}

fn is_root() -> bool {
    let output = Command::new("id").arg("-u").output().expect("id runs");
    output.stdout == b"0\n"
}

/// A NATS server with JetStream.
#[derive(Debug)]
pub struct Nats {
    process: Process,
    /// Where it listens.
    pub address: SocketAddr,
    data: PathBuf,
}

impl Nats {
    /// Starts one.
    pub fn start(ground: &Ground) -> Self {
        let (data, address) = (ground.path("nats"), free_address());
        let mut nats = Self { process: Self::launch(&data, address), address, data };
        wait_for(address, &mut nats.process);
        nats
    }

    fn launch(data: &Path, address: SocketAddr) -> Process {
        let mut command = Command::new("nats-server");
        command
            .args(["--addr", "127.0.0.1", "--port", &address.port().to_string(), "--jetstream", "--store_dir"])
            .arg(data);
        Process::spawn(command, &data.with_extension("log"))
    }

    /// Its URL.
    pub fn url(&self) -> String {
        format!("nats://{}", self.address)
    }

    /// Kills it.
    pub fn kill(&mut self) {
        self.process.kill();
    }

    /// Starts it again after a kill, with its data.
    pub fn start_again(&mut self) {
        self.process = Self::launch(&self.data, self.address);
        wait_for(self.address, &mut self.process);
    }
}

/// An S3 server (moto) that keeps everything in memory. `SUREFOOT_MOTO` names its program.
#[derive(Debug)]
pub struct S3 {
    _process: Process,
    /// Where it listens.
    pub address: SocketAddr,
}

impl S3 {
    /// Starts one with the bucket `surefoot`.
    pub fn start(ground: &Ground) -> Self {
        let program = std::env::var_os("SUREFOOT_MOTO").unwrap_or_else(|| "moto_server".into());
        let address = free_address();
        let mut command = Command::new(program);
        command.args(["--host", "127.0.0.1", "--port", &address.port().to_string()]);
        let mut process = Process::spawn(command, &ground.path("s3.log"));
        wait_for(address, &mut process);
        let created = Command::new("curl")
            .args(["--silent", "--fail", "-X", "PUT", &format!("http://{address}/surefoot")])
            .status();
        assert!(created.is_ok_and(|status| status.success()), "the bucket");
        Self { _process: process, address }
    }

    /// `--blobs` for it.
    pub const BLOBS: &str = "s3://surefoot/blobs";

    /// The variables with which a process finds it at `address`, its own or that of a relay.
    pub fn env(address: SocketAddr) -> Vec<(String, String)> {
        let variables = [
            ("AWS_ENDPOINT_URL", format!("http://{address}")),
            ("AWS_REGION", "us-east-1".to_owned()),
            ("AWS_ACCESS_KEY_ID", "test".to_owned()),
            ("AWS_SECRET_ACCESS_KEY", "test".to_owned()),
            ("AWS_ALLOW_HTTP", "true".to_owned()),
        ];
        variables.map(|(name, value)| (name.to_owned(), value)).to_vec()
    }
}
