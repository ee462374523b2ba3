//! Turns for long CPU work: few calls run at a time, and one of each client, so that no client waits for all calls of
//! another.

use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::sync::{Arc, Weak};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Turns of one kind of work. Calls that wait are bounded by the streams of their connections.
#[derive(Debug)]
pub struct Turns {
    all: Arc<Semaphore>,
    clients: Mutex<BTreeMap<Arc<str>, Weak<Semaphore>>>,
}

/// The place of a call that is the next one of its client.
#[derive(Debug)]
pub struct Place {
    all: Arc<Semaphore>,
    client: Option<OwnedSemaphorePermit>,
}

/// The right to run; dropped when the work is done.
#[derive(Debug)]
pub struct Turn {
    _all: Option<OwnedSemaphorePermit>,
    _client: Option<OwnedSemaphorePermit>,
}

impl Turns {
    /// At most `count` run at a time.
    pub fn new(count: usize) -> Self {
        Self { all: Arc::new(Semaphore::new(count)), clients: Mutex::default() }
    }

    /// Waits until no earlier call of `client` waits or runs.
    pub async fn place(&self, client: &Arc<str>) -> Place {
        let own = {
            let mut clients = self.clients.lock();
            clients.retain(|_, turns| turns.strong_count() > 0);
            let known = clients.get(client).and_then(Weak::upgrade);
            known.unwrap_or_else(|| {
                let own = Arc::new(Semaphore::new(1));
                clients.insert(client.clone(), Arc::downgrade(&own));
                own
            })
        };
        // Never closed.
        Place { all: self.all.clone(), client: own.acquire_owned().await.ok() }
    }
}

impl Place {
    /// Waits until fewer than all turns are taken.
    pub async fn turn(self) -> Turn {
        // Never closed.
        Turn { _all: self.all.acquire_owned().await.ok(), _client: self.client }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::pin::pin;
    use std::task::{Context, Poll, Waker};

    /// Whether a call of `client` would run now.
    fn would_run(turns: &Turns, client: &Arc<str>) -> bool {
        let call = pin!(async { turns.place(client).await.turn().await });
        matches!(call.poll(&mut Context::from_waker(Waker::noop())), Poll::Ready(_))
    }

    #[tokio::test]
    async fn a_client_with_many_calls_leaves_turns_to_others() {
        let turns = Turns::new(2);
        let [ann, bob, eve]: [Arc<str>; 3] = ["ann".into(), "bob".into(), "eve".into()];
        let of_ann = turns.place(&ann).await.turn().await;
        assert!(!would_run(&turns, &ann), "one call of a client at a time");
        // Waiting for a place, as while its map is generated, takes no turn.
        let place_of_eve = turns.place(&eve).await;
        let of_bob = turns.place(&bob).await.turn().await;
        let mut of_eve = pin!(place_of_eve.turn());
        assert!(of_eve.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_pending());
        drop(of_ann);
        let of_eve = of_eve.await;
        assert!(!would_run(&turns, &ann), "two turns are taken");
        drop((of_bob, of_eve));
        assert!(would_run(&turns, &ann));
        assert!(would_run(&turns, &bob) && turns.clients.lock().len() == 1, "idle clients are forgotten");
    }
}
