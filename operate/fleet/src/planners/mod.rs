//! Planners that share a store: graphs, layers, evidence and builds in PostgreSQL, blobs in an object store.
//! [`FleetPlanner`] is the store of one of them.
//!
//! `graphs` has claims and publishing, `layers` the comparison of versions, `evidence` the sums, `receipts` the
//! answers of repeatable calls, `operations` builds as clients see them, `levels` imported maps, `upkeep` the lease
//! and notifications. All of them use `db`.

mod db;
mod evidence;
mod graphs;
mod layers;
mod levels;
mod operations;
mod receipts;
mod upkeep;

use crate::blobs::Blobs;
use crate::database::Database;
use crate::error::FleetError;
use crate::membership::{MemberKind, Membership};
use crate::notifications;
use db::{BLOB_PATIENCE, CHANNEL, Note, PlannerDb};
use levels::Levels;
use parking_lot::Mutex;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use surefoot_planner::edits::Layer;
use surefoot_planner::live::LiveEvidence;
use surefoot_planner::store::{GraphStore, LevelId, LevelLayers, Receipt, StoreError};
use surefoot_planner::{Built, GraphId};
use surefoot_planner_service::replicas::{
    ClaimOutcome, News, Operation, Replicas, Report, Standing, Token, Withdrawals,
};
use surefoot_planner_service::{BuildId, PlannerStores};
use tokio::runtime::Handle;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tracing::warn;

/// Maximum number of news that wait. Beyond it, the connection that listens is held back.
const NEWS: usize = 256;

/// The store that planners share, for one of them.
#[derive(Debug)]
pub struct FleetPlanner {
    db: Arc<PlannerDb>,
    news: Mutex<Option<mpsc::Receiver<News>>>,
    /// Stopped when this is dropped.
    upkeep: Mutex<JoinSet<()>>,
}

impl FleetPlanner {
    /// Joins the planners that share this database and these blobs, for `lease`; others reach this one at `address`.
    pub async fn join(database: Database, blobs: Blobs, address: String, lease: Duration) -> Result<Self, FleetError> {
        let membership = Membership::join(&database, MemberKind::Planner, &address, lease).await?;
        let db = Arc::new(PlannerDb::new(database, blobs, membership, Handle::current()));
        let ((sender, news), (heard, notes)) = (mpsc::channel(NEWS), mpsc::channel(1));
        let mut upkeep = JoinSet::new();
        upkeep.spawn(upkeep::run(db.clone(), sender.clone()));
        upkeep.spawn(notifications::listen(db.database.clone(), CHANNEL, heard));
        upkeep.spawn(upkeep::pass_on(db.clone(), notes, sender));
        Ok(Self { db, news: Mutex::new(Some(news)), upkeep: Mutex::new(upkeep) })
    }

    /// The stores of a planner service.
    pub fn into_stores(self) -> PlannerStores {
        let levels = Arc::new(Levels(self.db.clone()));
        let database = Arc::new(self);
        PlannerStores { store: database.clone(), replicas: Some(database), levels: Some(levels) }
    }
}

impl GraphStore for FleetPlanner {
    fn get(&self, id: &GraphId) -> Result<Option<Built>, StoreError> {
        self.db.block_for(BLOB_PATIENCE, graphs::get(&self.db, id))
    }

    fn put(&self, id: &GraphId, _: &Built) -> Result<(), StoreError> {
        unreachable!("graph {id} is published under a claim")
    }

    fn live(&self, id: &GraphId) -> Result<LiveEvidence, StoreError> {
        self.db.block(evidence::read(&self.db, id))
    }

    fn put_live(&self, id: &GraphId, _: &LiveEvidence, _: &[Receipt]) -> Result<(), StoreError> {
        unreachable!("evidence of graph {id} is added, not replaced")
    }

    fn layers(&self, level: &LevelId) -> Result<LevelLayers, StoreError> {
        self.db.block(layers::read(&self.db, level))
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
        self.db.block(layers::replace(&self.db, level, version, layer, receipt))
    }

    fn receipt(&self, client: &str, id: &str) -> Result<Option<Receipt>, StoreError> {
        self.db.block(receipts::find(&self.db, client, id))
    }
}

impl Replicas for FleetPlanner {
    fn site(&self) -> u64 {
        self.db.membership.id() as u64
    }

    fn standing(&self) -> Standing {
        Standing {
            holds_lease: self.db.membership.holds_lease(),
            stale_publishes: self.db.stale_publishes.load(Ordering::Relaxed),
        }
    }

    fn news(&self) -> Option<mpsc::Receiver<News>> {
        self.news.lock().take()
    }

    fn claim(&self, graph: &GraphId, build: BuildId) -> Result<ClaimOutcome, StoreError> {
        graphs::claim(&self.db, graph, build)
    }

    fn release(&self, graph: &GraphId) {
        graphs::release(&self.db, graph);
    }

    fn publish(&self, graph: &GraphId, token: Token, recipe: &[u8], built: &Built) -> Result<bool, StoreError> {
        graphs::publish(&self.db, graph, token, recipe, built)
    }

    fn recipe(&self, graph: &GraphId) -> Result<Option<Vec<u8>>, StoreError> {
        self.db.block(graphs::recipe(&self.db, graph))
    }

    fn note_recipe(&self, graph: &GraphId, recipe: &[u8]) -> Result<(), StoreError> {
        self.db.block(graphs::note_recipe(&self.db, graph, recipe))
    }

    fn post(&self, operation: &Operation) -> Result<Withdrawals, StoreError> {
        self.db.block(operations::post(&self.db, operation))
    }

    fn operation(&self, id: BuildId) -> Result<Option<Operation>, StoreError> {
        self.db.block(operations::find(&self.db, id))
    }

    fn open_operations(&self) -> Result<Vec<Operation>, StoreError> {
        self.db.block(operations::open(&self.db))
    }

    fn withdraw(&self, id: BuildId, withdrawals: &Withdrawals) -> Result<(), StoreError> {
        self.db.block(operations::withdraw(&self.db, id, withdrawals))
    }

    fn adopt(&self) -> Result<Vec<Operation>, StoreError> {
        self.db.block(operations::adopt(&self.db))
    }

    fn add_evidence(&self, graph: &GraphId, reports: &[Report]) -> Result<(), StoreError> {
        self.db.block(evidence::add(&self.db, graph, reports))
    }

    fn drop_evidence(&self, graph: &GraphId, name: &str) -> Result<(), StoreError> {
        self.db.block(evidence::drop_of(&self.db, graph, name))
    }

    fn leave(&self) {
        self.upkeep.lock().abort_all();
        let left = self.db.block(async {
            self.db.membership.leave().await?;
            let mut connection = self.db.database.pool.acquire().await?;
            Ok(self.db.notify(&mut connection, &Note::Left).await?)
        });
        if let Err(error) = left {
            warn!(%error, "planner: cannot end its lease; others take over when it expires");
        }
    }
}
