//! The queue and the object store through which a fleet shares work.

use surefoot_fleet::blobs::Blobs;
use surefoot_fleet::work::compute_class::ComputeClass;
use surefoot_fleet::work::dispatch::Dispatcher;
use surefoot_fleet::work::map_cache::MapCache;
use surefoot_fleet::work::probes::QueuedProvers;
use surefoot_fleet::work::queue::Queue;
use surefoot_policy::Policy;

/// The queue, the lane of a policy, and the object store.
pub struct Shared {
    /// Jobs and results.
    pub queue: Queue,
    /// The lane of the jobs.
    pub lane: ComputeClass,
    /// Maps.
    pub blobs: Option<Blobs>,
}

impl Shared {
    /// Opens the queue and the object store. Needs a tokio runtime.
    pub async fn open(nats: &str, blobs: Option<&str>, policy: &Policy) -> anyhow::Result<Self> {
        let blobs = blobs.map(Blobs::open).transpose()?;
        Ok(Self { queue: Queue::open(nats).await?, lane: ComputeClass::of(policy), blobs })
    }

    /// Sends jobs.
    pub fn dispatcher(&self) -> Dispatcher {
        Dispatcher::new(self.queue.clone(), self.lane.clone())
    }

    /// Caches the maps of jobs.
    pub fn maps(&self) -> MapCache {
        MapCache::new(self.blobs.clone())
    }

    /// Runs the probes of builds on provers, and on this many threads of this process.
    pub fn provers(self, beside_provers: usize) -> QueuedProvers {
        QueuedProvers { dispatcher: self.dispatcher(), blobs: self.blobs, beside_provers }
    }
}
