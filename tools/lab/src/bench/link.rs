//! A slow network link: a relay with a delay and a limited rate.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Most bytes that are relayed together.
const CHUNK: usize = 16 * 1024;
/// Most chunks in flight in one direction of a connection; beyond them the sender waits.
const CHUNKS: usize = 256;

/// A link whose two directions are independent. Clones share it.
#[derive(Debug, Clone)]
pub struct Link {
    delay: Duration,
    bytes_per_s: f64,
    /// When the last bytes have left, for each direction.
    left: [Arc<Mutex<Instant>>; 2],
    /// Bytes so far, for each direction.
    carried: Arc<[AtomicU64; 2]>,
}

impl Link {
    /// A link with this delay and this rate, bit/s, in each direction.
    pub fn new(delay: Duration, bits_per_s: f64) -> Self {
        let left = [(); 2].map(|()| Arc::new(Mutex::new(Instant::now())));
        Self { delay, bytes_per_s: bits_per_s / 8.0, left, carried: Arc::default() }
    }

    /// Bytes so far: from the clients, and to them.
    pub fn carried(&self) -> [u64; 2] {
        [0, 1].map(|direction| self.carried[direction].load(Ordering::Relaxed))
    }

    /// Relays connections to `to` over this link until the process ends, and returns the address to connect to.
    pub fn relay(&self, to: SocketAddr) -> std::io::Result<SocketAddr> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        let address = listener.local_addr()?;
        let link = self.clone();
        std::thread::spawn(move || {
            for near in listener.incoming().flatten() {
                // Without a connection to the target, the client's connection is closed.
                let Ok(far) = TcpStream::connect(to) else { continue };
                link.join(near, far).unwrap_or_default();
            }
        });
        Ok(address)
    }

    fn join(&self, near: TcpStream, far: TcpStream) -> std::io::Result<()> {
        near.set_nodelay(true)?;
        far.set_nodelay(true)?;
        for (idx, (from, to)) in [(near.try_clone()?, far.try_clone()?), (far, near)].into_iter().enumerate() {
            let (sender, receiver) = sync_channel(CHUNKS);
            let link = self.clone();
            std::thread::spawn(move || link.take_in(idx, from, &sender));
            std::thread::spawn(move || hand_out(to, &receiver));
        }
        Ok(())
    }

    /// Reads bytes of one direction, and computes when they arrive.
    fn take_in(&self, direction: usize, mut from: TcpStream, sender: &SyncSender<(Instant, Vec<u8>)>) {
        let mut buffer = vec![0; CHUNK];
        while let Ok(count @ 1..) = from.read(&mut buffer) {
            self.carried[direction].fetch_add(count as u64, Ordering::Relaxed);
            let leaves = {
                let mut left = self.left[direction].lock().expect("no holder panics");
                *left = (*left).max(Instant::now()) + Duration::from_secs_f64(count as f64 / self.bytes_per_s);
                *left
            };
            if sender.send((leaves + self.delay, buffer[..count].to_vec())).is_err() {
                return;
            }
        }
    }
}

/// Writes chunks at the time at which they arrive.
fn hand_out(mut to: TcpStream, receiver: &Receiver<(Instant, Vec<u8>)>) {
    for (arrives, bytes) in receiver {
        std::thread::sleep(arrives.saturating_duration_since(Instant::now()));
        if to.write_all(&bytes).is_err() {
            break;
        }
    }
    // The other side may have closed it already.
    let _ = to.shutdown(Shutdown::Both);
}
