//! The inbox of a world's thread: first urgent calls, then the calls of clients, each client in turn.
//!
//! Answers of workers and calls of the server have a queue of their own. So a flood from one client cannot disconnect
//! workers, and delays another client by at most one call.

use parking_lot::{Condvar, Mutex};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Instant;

/// Why a world's thread does not accept a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SimError {
    #[error("too many calls are waiting for this world: try again")]
    Busy,
    #[error("the world has stopped")]
    Stopped,
}

/// Calls of all clients that may wait; one more is refused with [`SimError::Busy`].
const MAX_CLIENT_CALLS: usize = 4096;
/// Calls of one client that may wait.
const MAX_CALLS_PER_CLIENT: usize = 1024;
/// Answers and calls of the server that may wait.
const MAX_URGENT: usize = 4096;

/// The queue of a call.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CallQueue {
    /// Calls of the server, and answers of workers.
    Urgent,
    /// Calls of a client, by its name.
    Client(Arc<str>),
}

/// What [`Inbox::pop`] found.
#[derive(Debug, PartialEq, Eq)]
pub enum Popped<T> {
    /// The next item.
    Item(T),
    /// The time is over.
    Nothing,
    /// The inbox is closed and empty.
    Closed,
}

/// Bounded queues. Many threads push; one pops.
#[derive(Debug)]
pub struct Inbox<T> {
    queues: Mutex<Queues<T>>,
    arrived: Condvar,
}

#[derive(Debug)]
struct Queues<T> {
    urgent: VecDeque<T>,
    clients: BTreeMap<Arc<str>, VecDeque<T>>,
    /// Clients with waiting calls, the next one first.
    turns: VecDeque<Arc<str>>,
    client_calls: usize,
    is_closed: bool,
}

impl<T> Default for Inbox<T> {
    fn default() -> Self {
        let queues = Queues {
            urgent: VecDeque::new(),
            clients: BTreeMap::new(),
            turns: VecDeque::new(),
            client_calls: 0,
            is_closed: false,
        };
        Self { queues: Mutex::new(queues), arrived: Condvar::new() }
    }
}

impl<T> Inbox<T> {
    /// Adds an item at the end of a queue.
    pub fn push(&self, queue: &CallQueue, item: T) -> Result<(), SimError> {
        let mut queues = self.queues.lock();
        if queues.is_closed {
            return Err(SimError::Stopped);
        }
        match queue {
            CallQueue::Urgent if queues.urgent.len() >= MAX_URGENT => return Err(SimError::Busy),
            CallQueue::Urgent => queues.urgent.push_back(item),
            CallQueue::Client(client) => {
                let waiting = queues.clients.get(client).map_or(0, VecDeque::len);
                if waiting >= MAX_CALLS_PER_CLIENT || queues.client_calls >= MAX_CLIENT_CALLS {
                    return Err(SimError::Busy);
                }
                if waiting == 0 {
                    queues.turns.push_back(client.clone());
                }
                queues.clients.entry(client.clone()).or_default().push_back(item);
                queues.client_calls += 1;
            }
        }
        drop(queues);
        self.arrived.notify_one();
        Ok(())
    }

    /// Takes the next item; waits for one until `limit`.
    pub fn pop(&self, limit: Instant) -> Popped<T> {
        let mut queues = self.queues.lock();
        loop {
            if let Some(item) = queues.next() {
                return Popped::Item(item);
            }
            if queues.is_closed {
                return Popped::Closed;
            }
            let left = limit.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Popped::Nothing;
            }
            self.arrived.wait_for(&mut queues, left);
        }
    }

    /// Refuses further items. Waiting ones can still be taken.
    pub fn close(&self) {
        self.queues.lock().is_closed = true;
        self.arrived.notify_one();
    }

    /// Refuses further items and drops those that wait.
    pub fn abandon(&self) {
        let mut queues = self.queues.lock();
        queues.is_closed = true;
        let waiting = (std::mem::take(&mut queues.urgent), std::mem::take(&mut queues.clients));
        queues.turns.clear();
        queues.client_calls = 0;
        drop(queues);
        // Dropping a call may run code of its caller, so it is done without the lock.
        drop(waiting);
    }
}

impl<T> Queues<T> {
    fn next(&mut self) -> Option<T> {
        if let Some(item) = self.urgent.pop_front() {
            return Some(item);
        }
        let client = self.turns.pop_front()?;
        let calls = self.clients.get_mut(&client).expect("a client with a turn has a queue");
        let item = calls.pop_front().expect("a client with a turn has a call");
        if calls.is_empty() {
            self.clients.remove(&client);
        } else {
            self.turns.push_back(client);
        }
        self.client_calls -= 1;
        Some(item)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn client(name: &str) -> CallQueue {
        CallQueue::Client(name.into())
    }

    fn drain(inbox: &Inbox<u32>) -> Vec<u32> {
        let next = || if let Popped::Item(item) = inbox.pop(Instant::now()) { Some(item) } else { None };
        std::iter::from_fn(next).collect()
    }

    #[test]
    fn answers_come_first_and_clients_take_turns() {
        let inbox = Inbox::default();
        (0..5).for_each(|item| inbox.push(&client("flood"), item).unwrap());
        inbox.push(&client("quiet"), 100).unwrap();
        inbox.push(&CallQueue::Urgent, 200).unwrap();
        assert_eq!(drain(&inbox), [200, 0, 100, 1, 2, 3, 4]);
    }

    #[test]
    fn a_flood_is_refused_while_others_and_answers_still_get_in() {
        let inbox = Inbox::default();
        let accepted = (0..10_000).filter(|&item| inbox.push(&client("flood"), item).is_ok()).count();
        assert_eq!(accepted, MAX_CALLS_PER_CLIENT);
        assert_eq!(inbox.push(&client("flood"), 0), Err(SimError::Busy));
        assert_eq!(inbox.push(&client("quiet"), 1), Ok(()));
        assert_eq!(inbox.push(&CallQueue::Urgent, 2), Ok(()));
        assert_eq!(drain(&inbox).len(), MAX_CALLS_PER_CLIENT + 2);
        assert_eq!(inbox.push(&client("flood"), 0), Ok(()), "there is room again");
    }

    #[test]
    fn a_closed_inbox_refuses_and_hands_out_what_is_left() {
        let inbox = Inbox::default();
        inbox.push(&CallQueue::Urgent, 1).unwrap();
        inbox.close();
        assert_eq!(inbox.push(&CallQueue::Urgent, 2), Err(SimError::Stopped));
        assert_eq!(inbox.pop(Instant::now()), Popped::Item(1));
        assert_eq!(inbox.pop(Instant::now()), Popped::Closed);
    }
}
