//! Planners that share a store: graphs, layers, evidence and builds in PostgreSQL, blobs in an object store. [`PlannerRecord`] is what each
//! of them has of it.
//!
//! `graphs` has claims and publishing, `layers` the comparison of versions, `evidence` the sums, `receipts` the answers of calls that may be repeated, `operations` builds as clients see them,
//! `levels` imported maps, `upkeep` the lease and notifications. `shared` is what all of them use.

mod evidence;
mod graphs;
mod layers;
mod levels;
mod membership;
mod operations;
mod receipts;
mod shared;
mod upkeep;

use crate::blobs::Blobs;
use crate::error::FleetError;
use crate::record::Record;
use levels::Levels;
use membership::Membership;
use shared::{Note, Shared};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use surefoot_planner::edits::Layer;
use surefoot_planner::live::LiveEvidence;
use surefoot_planner::store::{GraphStore, LevelId, LevelLayers, Receipt, StoreError};
use surefoot_planner::{Built, GraphId};
use surefoot_planner_service::Common;
use surefoot_planner_service::jobs::BuildId;
use surefoot_planner_service::replicas::{Claim, News, Operation, Replicas, Report, Standing, Token, Withdrawals};
use tokio::runtime::Handle;
use tokio::sync::mpsc;
use tracing::warn;

/// Lease of a planner unless told otherwise.
pub const DEFAULT_LEASE: Duration = Duration::from_secs(5);
/// News that wait; when there are more, the connection to the database waits.
const NEWS: usize = 256;

/// A planner's part of the record that all planners share.
#[derive(Debug)]
pub struct PlannerRecord {
    shared: Arc<Shared>,
    news: Mutex<Option<mpsc::Receiver<News>>>,
}

impl PlannerRecord {
    /// Joins the planners that share this record and these blobs, for `lease`; others reach this one at `address`.
    ///
    /// # Errors
    /// If the record cannot be written.
    pub async fn join(record: Record, blobs: Blobs, address: String, lease: Duration) -> Result<Self, FleetError> {
        let membership = Membership::join(&record, address, lease).await?;
        let shared = Arc::new(Shared::new(record, blobs, membership, Handle::current()));
        let (sender, news) = mpsc::channel(NEWS);
        tokio::spawn(upkeep::keep(Arc::downgrade(&shared), sender.clone(), lease));
        tokio::spawn(upkeep::listen(Arc::downgrade(&shared), sender));
        Ok(Self { shared, news: Mutex::new(Some(news)) })
    }

    /// The stores of a planner service.
    pub fn into_stores(self) -> Common {
        let levels = Arc::new(Levels(self.shared.clone()));
        let record = Arc::new(self);
        Common { store: record.clone(), replicas: record, levels: Some(levels) }
    }
}

impl GraphStore for PlannerRecord {
    fn get(&self, id: &GraphId) -> Result<Option<Built>, StoreError> {
        graphs::get(&self.shared, id)
    }

    fn put(&self, id: &GraphId, _: &Built) -> Result<(), StoreError> {
        unreachable!("graph {id} is published under a claim")
    }

    fn live(&self, id: &GraphId) -> Result<LiveEvidence, StoreError> {
        evidence::read(&self.shared, id)
    }

    fn put_live(&self, id: &GraphId, _: &LiveEvidence, _: &[Receipt]) -> Result<(), StoreError> {
        unreachable!("evidence of graph {id} is added, not replaced")
    }

    fn layers(&self, level: &LevelId) -> Result<LevelLayers, StoreError> {
        layers::read(&self.shared, level)
    }

    fn put_layer(&self, level: &LevelId, layer: &Layer) -> Result<(), StoreError> {
        while !self.replace_layer(level, self.layers(level)?.version, layer, None)? {}
        Ok(())
    }

    fn replace_layer(
        &self,
        level: &LevelId,
        version: u64,
        layer: &Layer,
        receipt: Option<&Receipt>,
    ) -> Result<bool, StoreError> {
        layers::replace(&self.shared, level, version, layer, receipt)
    }

    fn receipt(&self, client: &str, id: &str) -> Result<Option<Receipt>, StoreError> {
        receipts::find(&self.shared, client, id)
    }
}

impl Replicas for PlannerRecord {
    fn site(&self) -> u64 {
        self.shared.membership.id() as u64
    }

    fn standing(&self) -> Standing {
        Standing {
            is_sure: self.shared.membership.is_sure(),
            stale_publishes: self.shared.stale_publishes.load(Ordering::Relaxed),
        }
    }

    fn news(&self) -> Option<mpsc::Receiver<News>> {
        self.news.lock().expect("no holder of this lock panics").take()
    }

    fn claim(&self, graph: &GraphId, build: BuildId) -> Result<Claim, StoreError> {
        graphs::claim(&self.shared, graph, build)
    }

    fn release(&self, graph: &GraphId) {
        graphs::release(&self.shared, graph);
    }

    fn publish(&self, graph: &GraphId, token: Token, recipe: &[u8], built: &Built) -> Result<bool, StoreError> {
        graphs::publish(&self.shared, graph, token, recipe, built)
    }

    fn recipe(&self, graph: &GraphId) -> Result<Option<Vec<u8>>, StoreError> {
        graphs::recipe(&self.shared, graph)
    }

    fn note_recipe(&self, graph: &GraphId, recipe: &[u8]) -> Result<(), StoreError> {
        graphs::note_recipe(&self.shared, graph, recipe)
    }

    fn post(&self, operation: &Operation) -> Result<Withdrawals, StoreError> {
        operations::post(&self.shared, operation)
    }

    fn operation(&self, id: BuildId) -> Result<Option<Operation>, StoreError> {
        operations::find(&self.shared, id)
    }

    fn open_operations(&self) -> Result<Vec<Operation>, StoreError> {
        operations::open(&self.shared)
    }

    fn withdraw(&self, id: BuildId, withdrawals: &Withdrawals) -> Result<(), StoreError> {
        operations::withdraw(&self.shared, id, withdrawals)
    }

    fn adopt(&self) -> Result<Vec<Operation>, StoreError> {
        operations::adopt(&self.shared)
    }

    fn add_evidence(&self, graph: &GraphId, reports: &[Report]) -> Result<(), StoreError> {
        evidence::add(&self.shared, graph, reports)
    }

    fn drop_evidence(&self, graph: &GraphId, name: &str) -> Result<(), StoreError> {
        evidence::drop_of(&self.shared, graph, name)
    }

    fn leave(&self) {
        self.shared.leave();
        let left = self.shared.block(async {
            self.shared.membership.leave().await?;
            let mut connection = self.shared.record.pool.acquire().await.map_err(|error| self.shared.failed(error))?;
            self.shared.notify(&mut connection, &Note::Left).await
        });
        if let Err(error) = left {
            warn!(%error, "others take over only when the lease of this planner has expired");
        }
    }
}
