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
    /// Nothing passes, and connections stay open.
    is_cut: AtomicBool,
    /// Connections are refused.
    is_refusing: AtomicBool,
    trap: Mutex<Option<(Vec<u8>, Trap)>>,
    snare: Mutex<Option<(Vec<u8>, Snare)>>,
    /// Requests that a snare holds back wait for this.
    is_holding: AtomicBool,
    open: Mutex<Vec<TcpStream>>,
}

/// What becomes of a request that is waited for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Snare {
    /// The relay holds it back until the test repairs the relay.
    Hold,
    /// It arrives, and its connection ends without the answer.
    LoseAnswer,
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
    /// What becomes of this request; `None` if it is not waited for.
    fn ensnare(&self, request: &[u8]) -> Option<Snare> {
        let mut snare = self.snare.lock().expect("no holder panics");
        snare.take_if(|(bytes, _)| request.windows(bytes.len()).any(|window| window == *bytes)).map(|(_, snare)| snare)
    }

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
                let is_deaf = Arc::new(AtomicBool::new(false));
                let both = [(&client, &server, false), (&server, &client, true)];
                for (from, to, are_answers) in both {
                    let (Ok(from), Ok(to)) = (from.try_clone(), to.try_clone()) else { continue };
                    let (state, is_deaf) = (state.clone(), is_deaf.clone());
                    std::thread::spawn(move || match are_answers {
                        true => pass_answers(from, to, &state, &is_deaf),
                        false => pass_requests(from, to, &state, &is_deaf),
                    });
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

    /// The first connection whose client sends `bytes` from now on ends without the answer to them.
    pub fn lose_answer_to(&self, bytes: &[u8]) {
        *self.state.snare.lock().expect("no holder panics") = Some((bytes.to_vec(), Snare::LoseAnswer));
    }

    /// Holds back the next connection whose client sends `bytes`, until the test repairs the relay.
    pub fn hold(&self, bytes: &[u8]) {
        self.state.is_holding.store(true, Ordering::Relaxed);
        *self.state.snare.lock().expect("no holder panics") = Some((bytes.to_vec(), Snare::Hold));
    }

    /// Whether a client has sent the bytes that were waited for.
    pub fn is_sprung(&self) -> bool {
        self.state.snare.lock().expect("no holder panics").is_none()
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
        self.state.is_holding.store(false, Ordering::Relaxed);
        self.state.is_cut.store(false, Ordering::Relaxed);
        self.state.is_refusing.store(false, Ordering::Relaxed);
    }
}

fn wait_while(flag: &AtomicBool) {
    while flag.load(Ordering::Relaxed) {
        std::thread::park_timeout(Duration::from_millis(5));
    }
}

fn pass_requests(mut from: TcpStream, mut to: TcpStream, state: &State, is_deaf: &AtomicBool) {
    let mut buffer = [0; 1 << 16];
    while let Ok(count @ 1..) = from.read(&mut buffer) {
        match state.ensnare(&buffer[..count]) {
            Some(Snare::Hold) => wait_while(&state.is_holding),
            Some(Snare::LoseAnswer) => is_deaf.store(true, Ordering::Relaxed),
            None => {}
        }
        wait_while(&state.is_cut);
        if to.write_all(&buffer[..count]).is_err() {
            break;
        }
    }
    let _ = from.shutdown(Shutdown::Both);
    let _ = to.shutdown(Shutdown::Both);
}

fn pass_answers(mut from: TcpStream, mut to: TcpStream, state: &State, is_deaf: &AtomicBool) {
    let mut buffer = [0; 1 << 16];
    while let Ok(count @ 1..) = from.read(&mut buffer) {
        match state.spring(&buffer[..count]) {
            // For good: its reader has to give up.
            Some(Trap::Hold) => loop {
                std::thread::park();
            },
            Some(Trap::Lose) => break,
            None => {}
        }
        wait_while(&state.is_cut);
        // What was asked has been done by now.
        if is_deaf.load(Ordering::Relaxed) || to.write_all(&buffer[..count]).is_err() {
            break;
        }
    }
    let _ = from.shutdown(Shutdown::Both);
    let _ = to.shutdown(Shutdown::Both);
}
