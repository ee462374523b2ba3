//! Repeatable calls: a request id that is sent again gets the first answer, so that nothing is created twice.

use crate::status;
use std::collections::{BTreeMap, VecDeque};
use std::future::Future;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use surefoot_proto::reason::Reason;
use tokio::sync::OnceCell;
use tonic::Status;

/// How long an answer is kept.
const KEPT_FOR: Duration = Duration::from_secs(600);
/// Most answers that are kept; the oldest are dropped first.
const MAX_KEPT: usize = 65_536;
/// Longest request id, bytes.
const MAX_ID: usize = 64;
const POISON: &str = "no holder of this lock panics";

/// Recent answers of one method, by client and request id.
#[derive(Debug)]
pub struct AnswerCache<A> {
    kept: Arc<Mutex<Kept<A>>>,
}

type Key = (Arc<str>, String);

#[derive(Debug)]
struct Kept<A> {
    by_key: BTreeMap<Key, Entry<A>>,
    /// Creation time and key of each entry, the oldest first.
    order: VecDeque<(Instant, Key)>,
}

#[derive(Debug)]
struct Entry<A> {
    /// Hash of the request: its id must not be used for a different one.
    request: blake3::Hash,
    answer: Arc<OnceCell<A>>,
}

impl<A> Kept<A> {
    fn forget_oldest(&mut self) {
        if let Some((_, oldest)) = self.order.pop_front() {
            self.by_key.remove(&oldest);
        }
    }
}

impl<A> Clone for AnswerCache<A> {
    fn clone(&self) -> Self {
        Self { kept: self.kept.clone() }
    }
}

impl<A> Default for AnswerCache<A> {
    fn default() -> Self {
        let kept = Kept { by_key: BTreeMap::new(), order: VecDeque::new() };
        Self { kept: Arc::new(Mutex::new(kept)) }
    }
}

/// Checks the length of a request id.
///
/// # Errors
/// If it is too long.
pub fn check_id(request_id: &str) -> Result<(), Status> {
    if request_id.len() > MAX_ID {
        let message = format!("request_id is {} bytes long, at most {MAX_ID} are allowed", request_id.len());
        return Err(status::invalid("request_id", message));
    }
    Ok(())
}

impl<A: Clone + Send + Sync + 'static> AnswerCache<A> {
    /// Runs `call`, or returns the answer that an earlier call with the same `request_id` got. `request` is the whole
    /// message, its id included. With an empty id the call always runs.
    ///
    /// A call that has begun continues when its client disconnects, so that a repeated call gets its answer. A call
    /// that failed runs again.
    ///
    /// # Errors
    /// If the id is too long or was used for a different request, or the call fails.
    pub async fn once<F>(
        &self,
        client: &Arc<str>,
        request_id: &str,
        request: &impl prost::Message,
        call: F,
    ) -> Result<A, Status>
    where
        F: Future<Output = Result<A, Status>> + Send + 'static,
    {
        if request_id.is_empty() {
            return call.await;
        }
        check_id(request_id)?;
        let cell = self.cell((client.clone(), request_id.to_owned()), blake3::hash(&request.encode_to_vec()))?;
        let task = tokio::spawn(async move { cell.get_or_try_init(|| call).await.cloned() });
        task.await.map_err(|error| status::failure(Reason::Internal, format!("the call failed: {error}")))?
    }

    fn cell(&self, key: Key, request: blake3::Hash) -> Result<Arc<OnceCell<A>>, Status> {
        let now = Instant::now();
        let mut kept = self.kept.lock().expect(POISON);
        let is_old = |since: &Instant| now.duration_since(*since) >= KEPT_FOR;
        while kept.order.front().is_some_and(|(since, _)| is_old(since)) {
            kept.forget_oldest();
        }
        if let Some(entry) = kept.by_key.get(&key) {
            return if entry.request == request {
                Ok(entry.answer.clone())
            } else {
                let message = format!("request_id `{}` was used for a different request: choose another id", key.1);
                Err(status::failure(Reason::RequestIdReused, message))
            };
        }
        while kept.order.len() >= MAX_KEPT {
            kept.forget_oldest();
        }
        let answer = Arc::new(OnceCell::new());
        kept.by_key.insert(key.clone(), Entry { request, answer: answer.clone() });
        kept.order.push_back((now, key));
        Ok(answer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    #[tokio::test]
    async fn an_id_gets_one_answer_however_often_it_is_used() {
        let (answers, made) = (AnswerCache::<u32>::default(), Arc::new(AtomicU32::new(0)));
        let (alice, bob): (Arc<str>, Arc<str>) = ("alice".into(), "bob".into());
        let call = || {
            let made = made.clone();
            async move { Ok(made.fetch_add(1, Ordering::Relaxed)) }
        };
        let request = "the request".to_owned();
        assert_eq!(answers.once(&alice, "a", &request, call()).await.unwrap(), 0);
        assert_eq!(answers.once(&alice, "a", &request, call()).await.unwrap(), 0);
        assert_eq!(answers.once(&bob, "a", &request, call()).await.unwrap(), 1, "each client has its own ids");
        assert_eq!(answers.once(&alice, "", &request, call()).await.unwrap(), 2, "an empty id is not remembered");
        let other = answers.once(&alice, "a", &"another request".to_owned(), call()).await.unwrap_err();
        assert_eq!(Reason::of(&other), Some(Reason::RequestIdReused));
        let failing = async { Err(status::failure(Reason::TooManyWorlds, "full")) };
        answers.once(&alice, "b", &request, failing).await.unwrap_err();
        assert_eq!(answers.once(&alice, "b", &request, call()).await.unwrap(), 3, "a failed call runs again");
        assert!(answers.once(&alice, &"x".repeat(65), &request, call()).await.is_err());
    }
}
