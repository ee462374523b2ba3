//! Repeatable calls: a request id that is sent again gets the first answer, so that nothing is created twice.
//!
//! Answers are kept for ten minutes. Their bytes count against the memory budget, and each client has a limit of its
//! own. A client that sends many ids evicts its own oldest answers, never those of others.

use crate::memory::{MemoryBudget, Reservation};
use crate::status;
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::future::Future;
use std::sync::Arc;
use std::time::{Duration, Instant};
use surefoot_proto::reason::Reason;
use tokio::sync::OnceCell;
use tonic::Status;

/// How long an answer is kept.
const KEPT_FOR: Duration = Duration::from_secs(600);
/// Time between two removals of old answers.
const SWEEP_PERIOD: Duration = Duration::from_secs(30);
/// Most bytes that the answers of one client to one method take.
const MAX_CLIENT_BYTES: u64 = 8 << 20;
/// Bytes of an entry, not counting its id and its answer.
const ENTRY_BYTES: usize = 256;
/// Longest request id, bytes.
const MAX_ID: usize = 64;

/// A call that a client may repeat.
#[derive(Debug, Clone, Copy)]
pub struct Repeatable<'a> {
    /// The client.
    pub client: &'a Arc<str>,
    /// Its id of the call. With an empty one the call always runs.
    pub request_id: &'a str,
    /// Most heap bytes of the answer.
    pub answer_bytes: usize,
}

/// Recent answers of one method, by client and request id. Clones share them.
#[derive(Debug)]
pub struct AnswerCache<A> {
    memory: MemoryBudget,
    kept: Arc<Mutex<Kept<A>>>,
}

#[derive(Debug)]
struct Kept<A> {
    by_client: BTreeMap<Arc<str>, Answers<A>>,
    /// Whether a task is removing old answers.
    is_swept: bool,
}

/// Answers of one client.
#[derive(Debug)]
struct Answers<A> {
    by_id: BTreeMap<String, Entry<A>>,
    /// Id of each entry by its number, the oldest first.
    order: BTreeMap<u64, String>,
    last_number: u64,
    bytes: u64,
    memory: Reservation,
}

#[derive(Debug)]
struct Entry<A> {
    /// Hash of the request: its id must not be used for a different one.
    request: blake3::Hash,
    answer: Arc<OnceCell<A>>,
    number: u64,
    since: Instant,
    bytes: u64,
}

impl<A> Entry<A> {
    /// Whether no call waits for the answer. The entry of a running call must stay, or a repeated call would run too.
    fn is_idle(&self) -> bool {
        Arc::strong_count(&self.answer) == 1
    }
}

impl<A> Answers<A> {
    fn forget(&mut self, id: &str) {
        let Some(entry) = self.by_id.remove(id) else { return };
        self.order.remove(&entry.number);
        self.bytes -= entry.bytes;
        // A smaller reservation always fits.
        let _ = self.memory.resize(self.bytes);
    }

    fn oldest_idle(&self) -> Option<String> {
        self.order.values().find(|id| self.by_id[*id].is_idle()).cloned()
    }

    fn forget_old(&mut self, now: Instant) {
        while let Some(id) = self.oldest_idle().filter(|id| now.duration_since(self.by_id[id].since) >= KEPT_FOR) {
            self.forget(&id);
        }
    }

    /// Adds an entry of `bytes` bytes. If the client has no room for it, the oldest entries are removed.
    fn add(&mut self, call: &Repeatable<'_>, request: blake3::Hash, bytes: u64) -> Result<Arc<OnceCell<A>>, Status> {
        loop {
            let wanted = self.bytes + bytes;
            // An answer that exceeds the limit is kept alone.
            let refusal = if wanted > MAX_CLIENT_BYTES && !self.by_id.is_empty() {
                let message = "running calls use all memory for request ids of this client: retry without request_id";
                status::quota(Reason::OutOfMemory, format!("client:{}", call.client), message)
            } else {
                match self.memory.resize(wanted) {
                    Ok(()) => break,
                    Err(error) => error.into(),
                }
            };
            let oldest = self.oldest_idle().ok_or(refusal)?;
            self.forget(&oldest);
        }
        let (id, answer) = (call.request_id.to_owned(), Arc::new(OnceCell::new()));
        self.bytes += bytes;
        self.last_number += 1;
        self.order.insert(self.last_number, id.clone());
        let (number, since) = (self.last_number, Instant::now());
        self.by_id.insert(id, Entry { request, answer: answer.clone(), number, since, bytes });
        Ok(answer)
    }
}

impl<A> Kept<A> {
    /// Removes old answers.
    fn sweep(&mut self, now: Instant) {
        self.by_client.retain(|_, answers| {
            answers.forget_old(now);
            !answers.by_id.is_empty()
        });
    }
}

impl<A> Clone for AnswerCache<A> {
    fn clone(&self) -> Self {
        Self { memory: self.memory.clone(), kept: self.kept.clone() }
    }
}

/// Checks the length of a request id.
pub fn check_id(request_id: &str) -> Result<(), Status> {
    if request_id.len() > MAX_ID {
        let message = format!("request_id is {} bytes long, at most {MAX_ID} are allowed", request_id.len());
        return Err(status::invalid("request_id", message));
    }
    Ok(())
}

impl<A: Clone + Send + Sync + 'static> AnswerCache<A> {
    /// No answers yet; their bytes come from `memory`.
    pub fn new(memory: MemoryBudget) -> Self {
        Self { memory, kept: Arc::new(Mutex::new(Kept { by_client: BTreeMap::new(), is_swept: false })) }
    }

    /// Runs `work`, or returns the answer of an earlier call with the same request id. `request` is the whole message,
    /// including its id.
    ///
    /// A running call continues when its client disconnects, so that a repeated call gets its answer. A failed call
    /// runs again.
    pub async fn once<F>(&self, call: Repeatable<'_>, request: &impl prost::Message, work: F) -> Result<A, Status>
    where
        F: Future<Output = Result<A, Status>> + Send + 'static,
    {
        let Repeatable { client, request_id, .. } = call;
        if request_id.is_empty() {
            return work.await;
        }
        check_id(request_id)?;
        let cell = self.cell(&call, blake3::hash(&request.encode_to_vec()))?;
        let (answers, client, id) = (self.clone(), client.clone(), request_id.to_owned());
        let task = tokio::spawn(async move {
            let answer = cell.get_or_try_init(|| work).await.cloned();
            if answer.is_err() {
                answers.forget_failed(&client, &id, &cell);
            }
            answer
        });
        task.await.map_err(|error| status::failure(Reason::Internal, format!("the call failed: {error}")))?
    }

    fn cell(&self, call: &Repeatable<'_>, request: blake3::Hash) -> Result<Arc<OnceCell<A>>, Status> {
        let mut kept = self.kept.lock();
        if !kept.is_swept {
            kept.is_swept = true;
            tokio::spawn(self.clone().keep_sweeping());
        }
        let answers = match kept.by_client.get_mut(call.client) {
            Some(answers) => answers,
            None => {
                let memory = self.memory.reserve(call.client, 0)?;
                let (by_id, order) = (BTreeMap::new(), BTreeMap::new());
                let answers = Answers { by_id, order, last_number: 0, bytes: 0, memory };
                kept.by_client.entry(call.client.clone()).or_insert(answers)
            }
        };
        answers.forget_old(Instant::now());
        if let Some(entry) = answers.by_id.get(call.request_id) {
            return if entry.request == request {
                Ok(entry.answer.clone())
            } else {
                let id = call.request_id;
                let message = format!("request_id `{id}` was used for a different request: choose another id");
                Err(status::failure(Reason::RequestIdReused, message))
            };
        }
        let bytes = ENTRY_BYTES + size_of::<A>() + 2 * call.request_id.len() + call.answer_bytes;
        answers.add(call, request, bytes as u64)
    }

    /// Removes the entry of a failed call, unless a repeated call waits for its answer.
    fn forget_failed(&self, client: &Arc<str>, id: &str, cell: &Arc<OnceCell<A>>) {
        let mut kept = self.kept.lock();
        let Some(answers) = kept.by_client.get_mut(client) else { return };
        let is_same = answers.by_id.get(id).is_some_and(|entry| Arc::ptr_eq(&entry.answer, cell));
        // The entry and this call have one clone each.
        if is_same && Arc::strong_count(cell) == 2 {
            answers.forget(id);
        }
    }

    /// Removes old answers until none is left.
    async fn keep_sweeping(self) {
        loop {
            tokio::time::sleep(SWEEP_PERIOD).await;
            let mut kept = self.kept.lock();
            kept.sweep(Instant::now());
            if kept.by_client.is_empty() {
                kept.is_swept = false;
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    const REQUEST: &str = "the request";

    fn call<'a>(client: &'a Arc<str>, request_id: &'a str) -> Repeatable<'a> {
        Repeatable { client, request_id, answer_bytes: 0 }
    }

    #[tokio::test]
    async fn an_id_gets_one_answer_however_often_it_is_used() {
        let budget = MemoryBudget::new(1 << 20);
        let (answers, made) = (AnswerCache::<u32>::new(budget.clone()), Arc::new(AtomicU32::new(0)));
        let (alice, bob): (Arc<str>, Arc<str>) = ("alice".into(), "bob".into());
        let work = || {
            let made = made.clone();
            async move { Ok(made.fetch_add(1, Ordering::Relaxed)) }
        };
        let request = REQUEST.to_owned();
        assert_eq!(answers.once(call(&alice, "a"), &request, work()).await.unwrap(), 0);
        assert_eq!(answers.once(call(&alice, "a"), &request, work()).await.unwrap(), 0);
        assert_eq!(answers.once(call(&bob, "a"), &request, work()).await.unwrap(), 1, "each client has its own ids");
        assert_eq!(answers.once(call(&alice, ""), &request, work()).await.unwrap(), 2, "an empty id is not remembered");
        let other = answers.once(call(&alice, "a"), &"another request".to_owned(), work()).await.unwrap_err();
        assert_eq!(Reason::of(&other), Some(Reason::RequestIdReused));
        let used = budget.used_bytes();
        let failing = async { Err(status::failure(Reason::TooManyWorlds, "full")) };
        answers.once(call(&alice, "b"), &request, failing).await.unwrap_err();
        assert_eq!(budget.used_bytes(), used, "a failed call is not kept");
        assert_eq!(answers.once(call(&alice, "b"), &request, work()).await.unwrap(), 3, "a failed call runs again");
        assert!(answers.once(call(&alice, &"x".repeat(65)), &request, work()).await.is_err());
        answers.kept.lock().sweep(Instant::now() + KEPT_FOR);
        assert_eq!(budget.used_bytes(), 0, "old answers are forgotten");
    }
}
