//! How much of something each client may have at a time.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// Counts of one kind of thing by client.
#[derive(Debug)]
pub struct Quota {
    limit: usize,
    /// Of what, and the flag that sets the limit, for people.
    what: &'static str,
    taken: Mutex<BTreeMap<Arc<str>, usize>>,
}

/// A client that has as much as it may.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{client} already has {limit} {what}")]
pub struct QuotaError {
    client: String,
    limit: usize,
    what: &'static str,
}

impl QuotaError {
    /// Whose quota it is, such as `client:studio`.
    pub fn subject(&self) -> String {
        format!("client:{}", self.client)
    }
}

/// One thing that a client has; given back when dropped.
#[derive(Debug)]
pub struct Ticket {
    quota: Arc<Quota>,
    client: Arc<str>,
}

impl Quota {
    /// At most `limit` for each client.
    pub fn new(limit: usize, what: &'static str) -> Arc<Self> {
        Arc::new(Self { limit, what, taken: Mutex::default() })
    }

    /// Takes one for `client`.
    ///
    /// # Errors
    /// If it has as many as it may.
    pub fn take(self: &Arc<Self>, client: &str) -> Result<Ticket, QuotaError> {
        let has = self.taken.lock().expect(POISON).get(client).copied().unwrap_or(0);
        if has >= self.limit {
            return Err(QuotaError { client: client.to_owned(), limit: self.limit, what: self.what });
        }
        Ok(self.grant(client))
    }

    /// Takes one for `client` whether or not it has room, as for worlds that were there before the limit.
    pub fn grant(self: &Arc<Self>, client: &str) -> Ticket {
        let client: Arc<str> = client.into();
        *self.taken.lock().expect(POISON).entry(client.clone()).or_default() += 1;
        Ticket { quota: self.clone(), client }
    }
}

impl Ticket {
    /// Whose it is.
    pub fn client(&self) -> &str {
        &self.client
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        let mut taken = self.quota.taken.lock().expect(POISON);
        if let Some(count) = taken.get_mut(&self.client) {
            *count -= 1;
            if *count == 0 {
                taken.remove(&self.client);
            }
        }
    }
}

const POISON: &str = "no holder of this lock panics";
