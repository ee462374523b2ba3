//! A relay between two processes, which can be cut: a partitioned network, without any rights on this machine.

use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Passes on connections to another address. It ends with the process.
#[derive(Debug, Clone)]
pub struct Relay {
    /// Where it accepts connections.
    pub address: SocketAddr,
    state: Arc<State>,
}

#[derive(Debug, Default)]
struct State {
    /// Nothing passes, and nobody is told.
    is_cut: AtomicBool,
    /// Connections are refused.
    is_refusing: AtomicBool,
    trap: Mutex<Option<(Vec<u8>, Trap)>>,
    open: Mutex<Vec<TcpStream>>,
}

/// What becomes of an answer that is waited for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trap {
    /// It is held back, with all that follows on its connection.
    Hold,
    /// It is lost, and its connection ends.
    Lose,
}

impl State {
    /// What becomes of this answer; `None` if it is not waited for.
    fn spring(&self, answer: &[u8]) -> Option<Trap> {
        let mut trap = self.trap.lock().expect("no holder panics");
        let (pattern, _) = trap.as_ref()?;
        if !answer.windows(pattern.len()).any(|window| window == pattern) {
            return None;
        }
        trap.take().map(|(_, trap)| trap)
    }
}

impl Relay {
    /// A relay to `target`.
    pub fn to(target: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let relay = Self { address: listener.local_addr().expect("an address"), state: Arc::default() };
        let state = relay.state.clone();
        std::thread::spawn(move || {
            for client in listener.incoming().flatten() {
                if state.is_refusing.load(Ordering::Relaxed) {
                    continue;
                }
                let Ok(server) = TcpStream::connect(target) else { continue };
                let both = [(&client, &server, false), (&server, &client, true)];
                for (from, to, are_answers) in both {
                    let (Ok(from), Ok(to)) = (from.try_clone(), to.try_clone()) else { continue };
                    let state = state.clone();
                    std::thread::spawn(move || pass(from, to, &state, are_answers));
                }
                state.open.lock().expect("no holder panics").extend([client, server]);
            }
        });
        relay
    }

    /// Holds back all bytes from now on, as a broken link does: connections stay open.
    pub fn cut(&self) {
        self.state.is_cut.store(true, Ordering::Relaxed);
    }

    /// Waits for an answer that contains these bytes; what was asked is done then.
    pub fn trap(&self, pattern: &[u8], trap: Trap) {
        *self.state.trap.lock().expect("no holder panics") = Some((pattern.to_vec(), trap));
    }

    /// Whether the answer has come that was waited for.
    pub fn has_sprung(&self) -> bool {
        self.state.trap.lock().expect("no holder panics").is_none()
    }

    /// Ends all connections and refuses new ones.
    pub fn refuse(&self) {
        self.state.is_refusing.store(true, Ordering::Relaxed);
        for stream in self.state.open.lock().expect("no holder panics").drain(..) {
            // It may have ended already.
            let _ = stream.shutdown(Shutdown::Both);
        }
    }

    /// Passes everything on again, also what was held back.
    pub fn mend(&self) {
        self.state.is_cut.store(false, Ordering::Relaxed);
        self.state.is_refusing.store(false, Ordering::Relaxed);
    }
}

fn pass(mut from: TcpStream, mut to: TcpStream, state: &State, are_answers: bool) {
    let mut buffer = [0; 1 << 16];
    while let Ok(count @ 1..) = from.read(&mut buffer) {
        match are_answers.then(|| state.spring(&buffer[..count])).flatten() {
            // For good: its reader has to give up.
            Some(Trap::Hold) => loop {
                std::thread::park();
            },
            Some(Trap::Lose) => break,
            None => {}
        }
        while state.is_cut.load(Ordering::Relaxed) {
            std::thread::park_timeout(Duration::from_millis(5));
        }
        if to.write_all(&buffer[..count]).is_err() {
            break;
        }
    }
    let _ = from.shutdown(Shutdown::Both);
    let _ = to.shutdown(Shutdown::Both);
}
