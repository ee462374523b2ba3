//! A connection to a game, which is one world there; dropping it ends the world.

use super::wire::{self, HEADER_BYTES, Kind, MAX_PLACES, MAX_REFUSAL_BYTES};
use crate::decide::{Bodies, Decided, Decision};
use std::fmt;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
#[cfg(unix)]
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use surefoot_world::{CharacterProfile, Vec3};

/// Longest wait for a connection, and for the answer to a hello.
const CONNECT_LIMIT: Duration = Duration::from_secs(5);
/// Longest wait for a new world, whose level may have to be loaded.
const OPEN_LIMIT: Duration = Duration::from_secs(300);
/// Longest wait for a decision.
const DECIDE_LIMIT: Duration = Duration::from_secs(50);

/// Where a game listens.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Address {
    /// Host and port.
    Tcp(String),
    /// A Unix socket.
    Unix(PathBuf),
}

impl Address {
    /// Reads `tcp://HOST:PORT` or `unix:PATH`; `None` if it is neither.
    pub fn parse(text: &str) -> Option<Self> {
        let tcp = text.strip_prefix("tcp://").map(|host| Self::Tcp(host.trim_end_matches('/').to_owned()));
        tcp.or_else(|| text.strip_prefix("unix:").map(|path| Self::Unix(path.into())))
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tcp(host) => write!(f, "tcp://{host}"),
            Self::Unix(path) => write!(f, "unix:{}", path.display()),
        }
    }
}

/// A socket of either kind.
trait Socket: Read + Write + Send {
    fn set_limit(&self, limit: Duration) -> io::Result<()>;
}

impl Socket for TcpStream {
    fn set_limit(&self, limit: Duration) -> io::Result<()> {
        self.set_read_timeout(Some(limit))?;
        self.set_write_timeout(Some(limit))
    }
}

#[cfg(unix)]
impl Socket for UnixStream {
    fn set_limit(&self, limit: Duration) -> io::Result<()> {
        self.set_read_timeout(Some(limit))?;
        self.set_write_timeout(Some(limit))
    }
}

fn connect(address: &Address) -> io::Result<Box<dyn Socket>> {
    match address {
        Address::Tcp(host) => {
            let mut last = io::Error::new(ErrorKind::InvalidInput, "the host has no address");
            for address in host.to_socket_addrs()? {
                match TcpStream::connect_timeout(&address, CONNECT_LIMIT) {
                    Ok(stream) => {
                        stream.set_nodelay(true)?;
                        return Ok(Box::new(stream));
                    }
                    Err(error) => last = error,
                }
            }
            Err(last)
        }
        #[cfg(unix)]
        Address::Unix(path) => Ok(Box::new(UnixStream::connect(path)?)),
        #[cfg(not(unix))]
        Address::Unix(_) => Err(io::Error::new(ErrorKind::Unsupported, "this system has no Unix sockets: use tcp://")),
    }
}

/// A connection on which both sides have said hello.
pub(super) struct Connection {
    socket: Box<dyn Socket>,
    answer: Vec<u8>,
}

impl Connection {
    /// Connects and says hello.
    ///
    /// # Errors
    /// Says in a sentence why the game is of no use.
    pub fn begin(address: &Address) -> Result<Self, String> {
        let socket = connect(address).map_err(|error| error.to_string())?;
        let mut connection = Self { socket, answer: Vec::new() };
        let hello = connection.call(Kind::Hello, &wire::hello(), wire::HELLO_BYTES..=wire::HELLO_BYTES, CONNECT_LIMIT);
        wire::read_hello(hello?)?;
        Ok(connection)
    }

    /// Makes a world of `count` characters of this connection.
    pub fn open(&mut self, profile: &CharacterProfile, count: usize) -> Result<(), String> {
        self.call(Kind::Open, &wire::open(profile, count), 0..=0, OPEN_LIMIT).map(drop)
    }

    /// Asks for places to stand, m.
    pub fn places(&mut self, seed: u64) -> Result<Vec<Vec3>, String> {
        wire::read_places(self.call(Kind::Places, &wire::places(seed), 0..=12 * MAX_PLACES, OPEN_LIMIT)?)
    }

    /// Sends a request and returns the body of its answer, whose number of bytes lies in `expected`.
    fn call(
        &mut self,
        kind: Kind,
        request: &[u8],
        expected: std::ops::RangeInclusive<usize>,
        limit: Duration,
    ) -> Result<&[u8], String> {
        let lost = |error: io::Error| lost(&error, kind, limit);
        let until = Instant::now() + limit;
        self.socket.set_limit(limit).map_err(lost)?;
        self.socket.write_all(request).map_err(lost)?;
        let mut header = [0; HEADER_BYTES];
        fill(&mut *self.socket, &mut header, until).map_err(lost)?;
        let [found, len] = [0, 4].map(|at| u32::from_le_bytes(header[at..at + 4].try_into().expect("four bytes")));
        let (found, len) = (found, len as usize);
        let is_refusal = found == Kind::Refusal as u32;
        if !is_refusal && found != kind as u32 {
            let kind = kind.name();
            return Err(format!(
                "it answers a message of kind {kind} with kind {found}: it does not speak the protocol"
            ));
        }
        let expected = if is_refusal { 1..=MAX_REFUSAL_BYTES } else { expected };
        if !expected.contains(&len) {
            let (least, most) = expected.into_inner();
            let wanted = if least == most { least.to_string() } else { format!("{least} to {most}") };
            return Err(format!("its answer to a message of kind {} has {len} bytes, expected {wanted}", kind.name()));
        }
        self.answer.resize(len, 0);
        fill(&mut *self.socket, &mut self.answer, until).map_err(lost)?;
        if is_refusal {
            let text: String = String::from_utf8_lossy(&self.answer).chars().filter(|it| !it.is_control()).collect();
            return Err(format!("it refuses a message of kind {}: {text}", kind.name()));
        }
        Ok(&self.answer)
    }
}

impl Bodies for Connection {
    fn decide(&mut self, decision: Decision<'_>) -> Result<Decided, String> {
        let bytes = wire::decided_bytes(decision);
        let answer = self.call(Kind::Decide, &wire::decide(decision), bytes..=bytes, DECIDE_LIMIT)?;
        wire::read_decided(answer, decision)
    }
}

/// Reads as many bytes as `buffer` has, no longer than `until` and one read more.
fn fill(socket: &mut dyn Socket, buffer: &mut [u8], until: Instant) -> io::Result<()> {
    let mut done = 0;
    while done < buffer.len() {
        match socket.read(&mut buffer[done..]) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(count) => done += count,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
        if done < buffer.len() && Instant::now() > until {
            return Err(ErrorKind::TimedOut.into());
        }
    }
    Ok(())
}

/// Says how a connection was lost during a call.
fn lost(error: &io::Error, kind: Kind, limit: Duration) -> String {
    let kind = kind.name();
    match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::TimedOut => {
            format!("no answer to a message of kind {kind} for {} s", limit.as_secs())
        }
        ErrorKind::UnexpectedEof | ErrorKind::BrokenPipe | ErrorKind::ConnectionReset => {
            format!("it closed the connection during a message of kind {kind}")
        }
        _ => error.to_string(),
    }
}
