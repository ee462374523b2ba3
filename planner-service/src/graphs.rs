//! The graphs in memory: found, marked as used, added, and evicted when there are too many.
//!
//! It knows neither stores nor builds: `builds` fills it, `peers` loads what is missing.

use crate::hosted::Hosted;
use crate::jobs::Job;
use crate::origin::Origin;
use parking_lot::Mutex;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use surefoot_net::serving::Shutdown;
use surefoot_planner::GraphId;
use surefoot_planner::store::LevelId;
use tracing::warn;

pub(crate) struct GraphCache {
    limit: usize,
    /// The most recently used last.
    graphs: Mutex<VecDeque<Arc<Hosted>>>,
    /// Held while hub labels are prepared: one graph at a time.
    labelling: Mutex<()>,
    shutdown: Shutdown,
}

impl GraphCache {
    /// Creates a cache for `limit` graphs. No hub labels are prepared after `shutdown`.
    pub fn new(limit: usize, shutdown: Shutdown) -> Self {
        Self { limit, graphs: Mutex::default(), labelling: Mutex::default(), shutdown }
    }

    pub fn len(&self) -> usize {
        self.graphs.lock().len()
    }

    pub fn all(&self) -> Vec<Arc<Hosted>> {
        self.graphs.lock().iter().rev().cloned().collect()
    }

    pub fn of_level(&self, level: &LevelId) -> Vec<Arc<Hosted>> {
        self.graphs.lock().iter().rev().filter(|hosted| hosted.level() == *level).cloned().collect()
    }

    /// Returns a graph without marking it as used.
    pub fn peek(&self, id: &GraphId) -> Option<Arc<Hosted>> {
        self.graphs.lock().iter().find(|hosted| hosted.origin.id == *id).cloned()
    }

    /// Returns a graph and marks it as used.
    pub fn get(&self, id: &GraphId) -> Option<Arc<Hosted>> {
        let mut graphs = self.graphs.lock();
        let idx = graphs.iter().position(|hosted| hosted.origin.id == *id)?;
        let found = graphs.remove(idx)?;
        graphs.push_back(found.clone());
        Some(found)
    }

    /// Returns the finished graph of a job and marks it as used, if plans may be made on it.
    pub fn find_for_job(&self, job: &Job) -> Option<Arc<Hosted>> {
        let source = job.source.key();
        let is_same = |Origin { settings, body, source: other, .. }: &Origin| {
            *settings == job.settings && *body == job.body && other.key() == source
        };
        let found = self.all().into_iter().find(|hosted| is_same(&hosted.origin))?;
        let is_usable = !found.is_interim() && found.check_layers().is_ok();
        is_usable.then(|| self.get(&found.origin.id)).flatten()
    }

    /// Returns the finished graph of the same map, body and settings whose pieces differ least from those of a job.
    pub fn nearest(&self, job: &Job) -> Option<Arc<Hosted>> {
        let (base, wanted) = (job.source.base().key(), job.source.pieces());
        let is_relative = |hosted: &Arc<Hosted>| {
            let Origin { settings, body, source, .. } = &hosted.origin;
            *settings == job.settings && *body == job.body && source.base().key() == base && !hosted.is_interim()
        };
        let difference = |hosted: &Arc<Hosted>| {
            let pieces = hosted.origin.source.pieces();
            let shared = pieces.iter().filter(|piece| wanted.contains(piece)).count();
            pieces.len() + wanted.len() - 2 * shared
        };
        self.all().into_iter().filter(is_relative).min_by_key(difference)
    }

    /// Adds a graph in place of the one with its id, and evicts the least recently used graphs beyond the limit.
    pub fn insert(self: &Arc<Self>, hosted: Arc<Hosted>) {
        let mut graphs = self.graphs.lock();
        graphs.retain(|other| other.origin.id != hosted.origin.id);
        graphs.push_back(hosted.clone());
        while graphs.len() > self.limit {
            graphs.pop_front();
        }
        drop(graphs);
        self.label_later(&hosted);
    }

    /// Drops an interim graph.
    pub fn evict_interim(&self, id: &GraphId) {
        self.graphs.lock().retain(|hosted| hosted.origin.id != *id || !hosted.is_interim());
    }

    /// Prepares the hub labels of a graph on a thread of its own, if it is too large for a table and has none. Until
    /// then, plans are searched.
    pub fn label_later(self: &Arc<Self>, hosted: &Arc<Hosted>) {
        if !hosted.wants_labels() || hosted.is_labelling.swap(true, Ordering::Relaxed) {
            return;
        }
        let (cache, labelled) = (self.clone(), hosted.clone());
        // A thread of the runtime would keep the service from stopping.
        let started = std::thread::Builder::new().name("labels".to_owned()).spawn(move || {
            let _turn = cache.labelling.lock();
            let is_due = || labelled.wants_labels() && !cache.shutdown.is_triggered();
            loop {
                while is_due() {
                    labelled.prepare_labels();
                }
                labelled.is_labelling.store(false, Ordering::Relaxed);
                // An edit may have replaced the labelled graph at the last moment.
                if !is_due() || labelled.is_labelling.swap(true, Ordering::Relaxed) {
                    return;
                }
            }
        });
        if let Err(error) = started {
            hosted.is_labelling.store(false, Ordering::Relaxed);
            warn!(%error, "planner: cannot start a thread for hub labels; plans on this graph take longer");
        }
    }
}
