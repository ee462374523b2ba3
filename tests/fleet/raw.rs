//! A client of NATS that speaks its protocol by hand, so that it can send what ours never would.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;
use surefoot_processes::LIMIT;

/// A message as it arrived.
#[derive(Debug, Clone)]
pub struct Message {
    /// Where it was sent.
    pub subject: String,
    /// Where answers go.
    pub reply: Option<String>,
    /// Its bytes, without headers.
    pub payload: Vec<u8>,
}

/// A connection. It does not hear what it sends itself.
#[derive(Debug)]
pub struct Raw {
    read: BufReader<TcpStream>,
    write: TcpStream,
}

impl Raw {
    /// Connects.
    pub fn connect(address: SocketAddr) -> Self {
        let write = TcpStream::connect(address).expect("NATS accepts");
        write.set_read_timeout(Some(LIMIT)).expect("a limit");
        let read = BufReader::new(write.try_clone().expect("a socket"));
        let mut raw = Self { read, write };
        raw.say("CONNECT {\"verbose\":false,\"echo\":false,\"headers\":true}");
        raw
    }

    fn say(&mut self, line: &str) {
        self.write.write_all(format!("{line}\r\n").as_bytes()).expect("NATS listens");
    }

    /// Receives what is sent to a subject from now on.
    pub fn subscribe(&mut self, subject: &str) {
        self.say(&format!("SUB {subject} 1"));
        self.settle();
    }

    /// Sends bytes to a subject; the server has them when this returns.
    pub fn publish(&mut self, subject: &str, payload: &[u8]) {
        self.send(subject, "", payload);
        self.settle();
    }

    /// Sends bytes to a subject, with a place for answers.
    pub fn send(&mut self, subject: &str, reply: &str, payload: &[u8]) {
        self.say(&format!("PUB {subject} {reply} {}", payload.len()));
        self.write.write_all(payload).expect("NATS listens");
        self.say("");
    }

    /// Waits until the server has seen everything; what arrives meanwhile is lost.
    fn settle(&mut self) {
        self.say("PING");
        while self.line() != "PONG" {}
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.read.read_line(&mut line).expect("NATS answers");
        line.trim_end().to_owned()
    }

    /// Does not wait longer for messages from now on.
    pub fn set_patience(&mut self, patience: Duration) {
        self.write.set_read_timeout(Some(patience)).expect("a limit");
    }

    /// The next message; `None` if the connection ends or nothing comes in time.
    pub fn next(&mut self) -> Option<Message> {
        loop {
            let mut line = String::new();
            if self.read.read_line(&mut line).ok()? == 0 {
                return None;
            }
            let words: Vec<&str> = line.split_whitespace().collect();
            // MSG subject sid [reply] bytes; HMSG subject sid [reply] header bytes.
            let (sizes, header_len) = match words.first() {
                Some(&"MSG") => (1, 0),
                Some(&"HMSG") => (2, words[words.len() - 2].parse().expect("a size")),
                Some(&"PING") => {
                    self.say("PONG");
                    continue;
                }
                _ => continue,
            };
            let len: usize = words.last()?.parse().expect("a size");
            let reply = (words.len() == 4 + sizes).then(|| words[3].to_owned());
            let mut bytes = vec![0; len + 2];
            self.read.read_exact(&mut bytes).ok()?;
            return Some(Message { subject: words[1].to_owned(), reply, payload: bytes[header_len..len].to_vec() });
        }
    }
}
