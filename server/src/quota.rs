//! Limits on the number of worlds, NPCs or environments of each client.

use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A limit on one kind of resource, with the number that each client has.
#[derive(Debug)]
pub struct Quota {
    limit: usize,
    /// The kind of resource and the flag that sets the limit, for error messages.
    what: &'static str,
    held: Mutex<BTreeMap<Arc<str>, usize>>,
}

/// A client has reached its quota.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{client} already has {limit} {what}")]
pub struct QuotaError {
    client: String,
    limit: usize,
    what: &'static str,
}

impl QuotaError {
    /// Subject of the quota, such as `client:studio`.
    pub fn subject(&self) -> String {
        format!("client:{}", self.client)
    }
}

/// A place in a client's quota; dropping it gives the place back.
#[derive(Debug)]
pub struct Ticket {
    quota: Arc<Quota>,
    client: Arc<str>,
}

impl Quota {
    /// Creates a quota of at most `limit` for each client. `what` completes the message "CLIENT already has LIMIT ...".
    pub fn new(limit: usize, what: &'static str) -> Arc<Self> {
        Arc::new(Self { limit, what, held: Mutex::default() })
    }

    /// Acquires a place for `client`.
    pub fn acquire(self: &Arc<Self>, client: &str) -> Result<Ticket, QuotaError> {
        let mut held = self.held.lock();
        if held.get(client).copied().unwrap_or(0) >= self.limit {
            return Err(QuotaError { client: client.to_owned(), limit: self.limit, what: self.what });
        }
        Ok(self.add(&mut held, client))
    }

    /// Acquires a place for `client` even beyond its quota, as for restored worlds.
    pub fn grant(self: &Arc<Self>, client: &str) -> Ticket {
        self.add(&mut self.held.lock(), client)
    }

    fn add(self: &Arc<Self>, held: &mut BTreeMap<Arc<str>, usize>, client: &str) -> Ticket {
        let client: Arc<str> = client.into();
        *held.entry(client.clone()).or_default() += 1;
        Ticket { quota: self.clone(), client }
    }
}

impl Ticket {
    /// The client that has the place.
    pub fn client(&self) -> &str {
        &self.client
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        let mut held = self.quota.held.lock();
        if let Some(count) = held.get_mut(&self.client) {
            *count -= 1;
            if *count == 0 {
                held.remove(&self.client);
            }
        }
    }
}
