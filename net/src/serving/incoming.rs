//! Accepts connections up to a limit, and closes silent ones.
//!
//! A connection beyond the limit replaces the oldest one without an authorized request. If there is none, the new
//! connection is closed at once instead of queued, so that a load balancer can try another server.

use super::limits::Limits;
use super::shutdown::Shutdown;
use crate::metrics::family;
use parking_lot::Mutex;
use std::collections::VecDeque;
use std::future::Future;
use std::io::{Error, ErrorKind, IoSlice, Result};
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Weak};
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, Sleep, sleep};
use tokio_stream::Stream;
use tonic::transport::server::Connected;
use tracing::{debug, warn};

/// Length of the HTTP/2 preface, bytes. No useful HTTP/1 request is shorter.
const PREFACE_LEN: usize = 24;
/// Pause after the system refused to accept a connection, for example because file descriptors ran out.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Numbers of open, refused and cut-off connections.
#[derive(Debug, Default)]
pub(super) struct Counters {
    open: AtomicU64,
    refused: AtomicU64,
    cut: AtomicU64,
}

impl Counters {
    /// Renders the counters as Prometheus text.
    pub fn render(&self) -> String {
        let counters = [
            ("connections", "gauge", "Open connections.", &self.open),
            ("connections_refused_total", "counter", "Connections refused because there were too many.", &self.refused),
            ("connections_cut_total", "counter", "Connections closed because they were silent.", &self.cut),
        ];
        let family = |(name, kind, help, count): (&str, &str, &str, &AtomicU64)| {
            family(name, kind, help, [("", count.load(Ordering::Relaxed) as f64)])
        };
        counters.map(family).concat()
    }
}

/// The state of a connection that the gate and the listener share.
#[derive(Debug)]
struct Guest {
    /// Whether a request of the connection was authorized.
    is_known: AtomicBool,
    /// None once another connection has replaced this one.
    permit: Mutex<Option<OwnedSemaphorePermit>>,
    evicted: Shutdown,
}

/// The connection of a request, as an extension of the request.
#[derive(Debug, Clone)]
pub(super) struct ConnectionInfo {
    /// Address of the peer, if the system reports it.
    pub peer: Option<SocketAddr>,
    guest: Arc<Guest>,
}

impl ConnectionInfo {
    /// Notes that a request of the connection was authorized: it will not be replaced.
    pub fn note_authorized(&self) {
        self.guest.is_known.store(true, Ordering::Relaxed);
    }
}

/// An endless stream of accepted connections.
pub(super) struct Incoming {
    listener: TcpListener,
    limits: Limits,
    permits: Arc<Semaphore>,
    counters: Arc<Counters>,
    cut: Shutdown,
    pause: Option<Pin<Box<Sleep>>>,
    /// Connections in the order in which they were accepted.
    guests: VecDeque<Weak<Guest>>,
}

impl Incoming {
    /// Accepts connections from `listener`; `cut` breaks all that are still open.
    pub fn new(listener: TcpListener, limits: Limits, counters: Arc<Counters>, cut: Shutdown) -> Self {
        let permits = Arc::new(Semaphore::new(limits.max_connections));
        Self { listener, limits, permits, counters, cut, pause: None, guests: VecDeque::new() }
    }

    fn admit(&mut self, stream: TcpStream) -> Option<Connection> {
        let Some(permit) = self.permits.clone().try_acquire_owned().ok().or_else(|| self.evict()) else {
            self.counters.refused.fetch_add(1, Ordering::Relaxed);
            debug!("endpoint: connection refused, --max-connections is reached");
            return None;
        };
        if let Err(error) = stream.set_nodelay(true) {
            debug!(%error, "endpoint: cannot set TCP_NODELAY; small messages may be delayed");
        }
        let guest =
            Guest { is_known: AtomicBool::new(false), permit: Mutex::new(Some(permit)), evicted: Shutdown::default() };
        let guest = Arc::new(guest);
        if self.guests.len() >= 2 * self.limits.max_connections {
            self.guests.retain(|guest| guest.strong_count() > 0);
        }
        self.guests.push_back(Arc::downgrade(&guest));
        Some(Connection::new(stream, self.limits, guest, self.counters.clone(), &self.cut))
    }

    /// Closes the oldest connection without an authorized request, and returns its permit.
    fn evict(&mut self) -> Option<OwnedSemaphorePermit> {
        self.guests.retain(|guest| guest.strong_count() > 0);
        let is_unknown = |guest: &Arc<Guest>| !guest.is_known.load(Ordering::Relaxed);
        let guest = self.guests.iter().filter_map(Weak::upgrade).filter(is_unknown).find_map(|guest| {
            let permit = guest.permit.lock().take()?;
            Some((guest, permit))
        });
        let (guest, permit) = guest?;
        guest.evicted.trigger();
        self.counters.cut.fetch_add(1, Ordering::Relaxed);
        debug!("endpoint: closed the oldest connection without an authorized request, --max-connections is reached");
        Some(permit)
    }
}

impl Stream for Incoming {
    type Item = Result<Connection>;

    fn poll_next(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        loop {
            if let Some(pause) = &mut self.pause {
                ready!(pause.as_mut().poll(cx));
                self.pause = None;
            }
            match ready!(self.listener.poll_accept(cx)) {
                Ok((stream, _)) => {
                    if let Some(connection) = self.admit(stream) {
                        return Poll::Ready(Some(Ok(connection)));
                    }
                }
                // The peer closed the connection before it was accepted.
                Err(error) if matches!(error.kind(), ErrorKind::ConnectionAborted | ErrorKind::ConnectionReset) => {}
                Err(error) => {
                    warn!(%error, "endpoint: cannot accept connections; trying again in 0.1 s");
                    self.pause = Some(Box::pin(sleep(ACCEPT_PAUSE)));
                }
            }
        }
    }
}

/// An accepted connection. Reads and writes fail once its peer has been silent for too long.
pub(super) struct Connection {
    stream: TcpStream,
    /// Fires when the silence of the peer must be checked.
    alarm: Pin<Box<Sleep>>,
    last_byte: Instant,
    idle_timeout: Duration,
    /// Bytes of the preface that have not been read yet. Until it is complete, `alarm` is not postponed.
    preface_left: usize,
    cut: Pin<Box<dyn Future<Output = ()> + Send>>,
    evicted: Pin<Box<dyn Future<Output = ()> + Send>>,
    counters: Arc<Counters>,
    guest: Arc<Guest>,
}

impl Connection {
    fn new(stream: TcpStream, limits: Limits, guest: Arc<Guest>, counters: Arc<Counters>, cut: &Shutdown) -> Self {
        counters.open.fetch_add(1, Ordering::Relaxed);
        Self {
            stream,
            alarm: Box::pin(sleep(limits.handshake_timeout)),
            last_byte: Instant::now(),
            idle_timeout: limits.idle_timeout,
            preface_left: PREFACE_LEN,
            cut: Box::pin(cut.wait()),
            evicted: Box::pin(guest.evicted.wait()),
            counters,
            guest,
        }
    }

    fn note_read(&mut self, count: usize) {
        self.note_byte(count);
        if self.preface_left > 0 {
            self.preface_left = self.preface_left.saturating_sub(count);
            if self.preface_left == 0 {
                self.alarm.as_mut().reset(self.last_byte + self.idle_timeout);
            }
        }
    }

    fn note_byte(&mut self, count: usize) {
        if count > 0 {
            self.last_byte = Instant::now();
        }
    }

    /// Returns an error once the connection must be closed; polled whenever the socket is not ready.
    fn poll_overdue<T>(&mut self, cx: &mut Context<'_>) -> Poll<Result<T>> {
        if self.cut.as_mut().poll(cx).is_ready() {
            return Poll::Ready(Err(Error::new(ErrorKind::ConnectionAborted, "the endpoint has stopped")));
        }
        if self.evicted.as_mut().poll(cx).is_ready() {
            return Poll::Ready(Err(Error::new(ErrorKind::ConnectionAborted, "another connection replaced this one")));
        }
        loop {
            ready!(self.alarm.as_mut().poll(cx));
            let due = self.last_byte + self.idle_timeout;
            if self.preface_left > 0 || due <= Instant::now() {
                self.counters.cut.fetch_add(1, Ordering::Relaxed);
                return Poll::Ready(Err(Error::new(ErrorKind::TimedOut, "the peer has been silent for too long")));
            }
            self.alarm.as_mut().reset(due);
        }
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.counters.open.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Connected for Connection {
    type ConnectInfo = ConnectionInfo;

    fn connect_info(&self) -> ConnectionInfo {
        ConnectionInfo { peer: self.stream.peer_addr().ok(), guest: self.guest.clone() }
    }
}

impl AsyncRead for Connection {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<Result<()>> {
        let before = buffer.filled().len();
        if let Poll::Ready(result) = Pin::new(&mut self.stream).poll_read(cx, buffer) {
            self.note_read(buffer.filled().len() - before);
            return Poll::Ready(result);
        }
        self.poll_overdue(cx)
    }
}

impl AsyncWrite for Connection {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &[u8]) -> Poll<Result<usize>> {
        if let Poll::Ready(result) = Pin::new(&mut self.stream).poll_write(cx, buffer) {
            self.note_byte(*result.as_ref().unwrap_or(&0));
            return Poll::Ready(result);
        }
        self.poll_overdue(cx)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffers: &[IoSlice<'_>],
    ) -> Poll<Result<usize>> {
        if let Poll::Ready(result) = Pin::new(&mut self.stream).poll_write_vectored(cx, buffers) {
            self.note_byte(*result.as_ref().unwrap_or(&0));
            return Poll::Ready(result);
        }
        self.poll_overdue(cx)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}
