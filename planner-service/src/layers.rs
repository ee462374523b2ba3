//! Changes of layers. A change is applied to copies of all graphs of the level first, which may take many probes. Then
//! it is stored and applied at once, unless the layers have changed in the meantime.

use crate::error::PlannerError;
use crate::graphs::GraphCache;
use crate::hosted::{Hosted, Prepared};
use crate::revision::Revision;
use crate::stores::PlannerStores;
use crate::wire;
use parking_lot::{Mutex, MutexGuard};
use std::collections::HashMap;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Weak};
use surefoot_net::serving::Shutdown;
use surefoot_planner::edits::{Edit, Layer};
use surefoot_planner::store::{Call, LevelId, LevelLayers, MAX_ANSWER_BYTES, Receipt, StoreError, StoreErrorKind};
use surefoot_planner::{BuildError, Progress};
use tokio::sync::Semaphore;
use tokio::task::spawn_blocking;
use tracing::warn;

/// Maximum number of layers of a level.
pub const MAX_LAYERS: usize = 64;
/// Maximum number of new edits in one call that add or move vertices. Each takes probes along up to 24 candidate
/// edges.
pub const MAX_PROBED_EDITS: usize = 256;
/// Maximum number of edits in all layers of a level that add or move vertices.
pub const MAX_PROBED_EDITS_OF_LEVEL: usize = 4096;
/// Number of times that a change is tried while other calls change the layers.
const MAX_ATTEMPTS: usize = 4;

/// A change of one layer.
#[derive(Debug, Clone, PartialEq)]
pub enum LayerChange {
    Put(Layer),
    /// Appends edits to the layer of this name, which is created if it does not exist.
    Append(String, Vec<Edit>),
    /// Removes this number of edits from the end of the layer of this name.
    Undo(String, usize),
}

impl LayerChange {
    fn name(&self) -> &str {
        match self {
            LayerChange::Put(Layer { name, .. }) | LayerChange::Append(name, _) | LayerChange::Undo(name, _) => name,
        }
    }

    fn edits(&self) -> &[Edit] {
        match self {
            LayerChange::Put(Layer { edits, .. }) | LayerChange::Append(_, edits) => edits,
            LayerChange::Undo(..) => &[],
        }
    }

    /// Returns whether applying the change may take probes.
    fn is_probed(&self) -> bool {
        self.edits().iter().any(Edit::is_probed)
    }

    /// Returns the changed layer, and all layers of the level with it.
    fn apply(&self, stored: &LevelLayers) -> Result<(Layer, LevelLayers), PlannerError> {
        let damaged = stored.damaged.iter().find(|layer| layer.name == self.name());
        if damaged.is_none()
            && let Some(other) = stored.damaged.first()
        {
            return Err(PlannerError::Store { what: "the layers cannot be changed", reason: other.to_string() });
        }
        let find = |name: &str| match damaged {
            Some(damaged) => Err(PlannerError::LayersUnreadable(damaged.to_string())),
            None => Ok(stored.layers.iter().find(|layer| layer.name == name).cloned()),
        };
        let changed = match self {
            LayerChange::Put(layer) => layer.clone(),
            LayerChange::Append(name, edits) => {
                let mut layer = find(name)?.unwrap_or(Layer { name: name.clone(), edits: Vec::new() });
                layer.edits.extend(edits);
                layer
            }
            LayerChange::Undo(name, count) => {
                let mut layer = find(name)?.ok_or_else(|| PlannerError::UnknownLayer(name.clone()))?;
                layer.edits.truncate(layer.edits.len().saturating_sub(*count));
                layer
            }
        };
        changed.validate()?;
        let before = stored.layers.iter().find(|layer| layer.name == changed.name);
        let is_new = |edit: &&Edit| edit.is_probed() && !before.is_some_and(|layer| layer.edits.contains(edit));
        let found = self.edits().iter().filter(is_new).count();
        if found > MAX_PROBED_EDITS {
            return Err(PlannerError::TooManyEdits {
                field: "edits",
                found,
                what: "new edits that add or move vertices",
                limit: MAX_PROBED_EDITS,
                scope: "one call",
            });
        }
        let mut after = stored.clone();
        after.damaged.retain(|layer| layer.name != changed.name);
        after.layers.retain(|layer| layer.name != changed.name);
        if !changed.edits.is_empty() {
            after.layers.push(changed.clone());
            check_level(&stored.layers, &after)?;
        }
        after.layers.sort_by(|a, b| a.name.cmp(&b.name));
        Ok((changed, after))
    }
}

fn probed_count(edits: &[Edit]) -> usize {
    edits.iter().filter(|edit| edit.is_probed()).count()
}

/// Checks the limits of a level. A level beyond a limit may shrink.
fn check_level(before: &[Layer], after: &LevelLayers) -> Result<(), PlannerError> {
    let layers = after.layers.len() + after.damaged.len();
    if layers > MAX_LAYERS && after.layers.len() > before.len() {
        return Err(PlannerError::TooManyEdits {
            field: "layer",
            found: layers,
            what: "layers",
            limit: MAX_LAYERS,
            scope: "one level",
        });
    }
    let count = |layers: &[Layer]| layers.iter().map(|layer| probed_count(&layer.edits)).sum::<usize>();
    let found = count(&after.layers);
    if found > MAX_PROBED_EDITS_OF_LEVEL && found > count(before) {
        return Err(PlannerError::TooManyEdits {
            field: "edits",
            found,
            what: "edits that add or move vertices",
            limit: MAX_PROBED_EDITS_OF_LEVEL,
            scope: "all layers of one level",
        });
    }
    Ok(())
}

/// Cancels probes when it is dropped, as it is when the caller disconnects.
struct CancelOnDrop(Arc<Progress>);

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        self.0.cancel.store(true, Ordering::Relaxed);
    }
}

/// A change, and the call that asks for it.
struct WantedChange {
    hosted: Arc<Hosted>,
    if_revision: Option<Revision>,
    change: LayerChange,
    call: Option<Call>,
    progress: Arc<Progress>,
}

/// Returns the answer to a change and the receipt of its `call`. The receipt of a long answer lacks the edits that
/// could not be applied.
fn answer_of(hosted: &Hosted, prepared: &Prepared, call: Option<&Call>) -> (Vec<u8>, Option<Receipt>) {
    let (figures, unapplied, revision) = hosted.preview(prepared);
    let frame = hosted.frame();
    let answer = wire::changed(&figures, (&unapplied, &frame), revision);
    let receipt = call.cloned().map(|call| {
        let is_short = answer.len() <= MAX_ANSWER_BYTES;
        let short = || wire::changed(&figures, (&[], &frame), revision);
        Receipt { call, answer: if is_short { answer.clone() } else { short() } }
    });
    (answer, receipt)
}

/// Changes layers and applies them to the graphs in memory.
pub(crate) struct LayerEditor {
    stores: PlannerStores,
    graphs: Arc<GraphCache>,
    /// One lock for each level: held while its layers are stored and applied, never while edits are probed.
    locks: Mutex<HashMap<LevelId, Weak<Mutex<()>>>>,
    /// Permits one call at a time to probe its edits, because that uses all cores.
    probing: Semaphore,
    shutdown: Shutdown,
}

impl LayerEditor {
    /// Creates an editor for the graphs of a planner.
    pub fn new(stores: PlannerStores, graphs: Arc<GraphCache>, shutdown: Shutdown) -> Self {
        Self { stores, graphs, locks: Mutex::default(), probing: Semaphore::new(1), shutdown }
    }

    /// Returns the lock of a level.
    pub fn lock_of(&self, level: &LevelId) -> Arc<Mutex<()>> {
        let mut locks = self.locks.lock();
        locks.retain(|_, lock| lock.strong_count() > 0);
        if let Some(lock) = locks.get(level).and_then(Weak::upgrade) {
            return lock;
        }
        let lock = Arc::default();
        locks.insert(*level, Arc::downgrade(&lock));
        lock
    }

    /// Changes a layer of a graph's level. If `if_revision` is given, the layers must have that revision. The change is
    /// abandoned if the caller drops the future, or the service shuts down, before it is stored. Returns the answer, as
    /// [`wire::changed`] encodes it; a repeated call gets its first answer.
    pub async fn change(
        self: &Arc<Self>,
        hosted: Arc<Hosted>,
        if_revision: Option<Revision>,
        change: LayerChange,
        call: Option<Call>,
    ) -> Result<Vec<u8>, PlannerError> {
        let work = async {
            let _turn = match change.is_probed() {
                false => None,
                true => Some(self.probing.acquire().await.map_err(|_| PlannerError::ShuttingDown)?),
            };
            let cancel = CancelOnDrop(Arc::default());
            let wanted = WantedChange { hosted, if_revision, change, call, progress: cancel.0.clone() };
            let editor = self.clone();
            let task = spawn_blocking(move || editor.change_now(&wanted));
            task.await.map_err(PlannerError::lost("the edit"))?
        };
        tokio::select! {
            changed = work => changed,
            () = self.shutdown.wait() => Err(PlannerError::ShuttingDown),
        }
    }

    fn change_now(&self, wanted: &WantedChange) -> Result<Vec<u8>, PlannerError> {
        let WantedChange { hosted, if_revision, change, call, progress } = wanted;
        let (level, store) = (hosted.level(), &self.stores.store);
        let read = || store.layers(&level).map_err(PlannerError::store("the layers cannot be read"));
        let level_lock = self.lock_of(&level);
        for _ in 0..MAX_ATTEMPTS {
            let stored = read()?;
            // Looked up after the layers: a repeat that runs at the same time changes the layers first.
            if let Some(answer) = self.stores.first_answer(call.as_ref())? {
                return Ok(answer);
            }
            if if_revision.is_some_and(|revision| revision != Revision::of(&stored.layers)) {
                return Err(PlannerError::LayersChanged);
            }
            let (changed, after) = change.apply(&stored)?;
            let graphs = self.graphs_of(&level, hosted);
            let prepare = |graph: &Arc<Hosted>| graph.prepare(readable(after.clone()), progress);
            let prepared: Option<Vec<Prepared>> = graphs.iter().map(prepare).collect();
            let prepared = prepared.ok_or(PlannerError::ShuttingDown)?;
            // The first graph is the one that the caller named.
            let (answer, receipt) = answer_of(hosted, &prepared[0], call.as_ref());
            let _held = level_lock.lock();
            if progress.cancel.load(Ordering::Relaxed) {
                return Err(PlannerError::ShuttingDown);
            }
            let has_all =
                |now: &[Arc<Hosted>]| now.iter().all(|one| graphs.iter().any(|other| Arc::ptr_eq(one, other)));
            if read()? != stored || !has_all(&self.graphs_of(&level, hosted)) {
                continue;
            }
            let replaced = store.replace_layer(&level, stored.version, &changed, receipt.as_ref());
            if !replaced.map_err(PlannerError::store("the layer cannot be stored"))? {
                continue;
            }
            for (graph, prepared) in graphs.iter().zip(prepared) {
                self.apply(graph, prepared);
            }
            return Ok(answer);
        }
        Err(PlannerError::LayersChanged)
    }

    fn apply(&self, graph: &Arc<Hosted>, prepared: Prepared) {
        graph.apply(prepared);
        self.graphs.label_later(graph);
    }

    /// Returns `hosted`, first, and all other graphs of the level in memory.
    fn graphs_of(&self, level: &LevelId, hosted: &Arc<Hosted>) -> Vec<Arc<Hosted>> {
        let mut graphs = self.graphs.of_level(level);
        graphs.retain(|other| !Arc::ptr_eq(other, hosted));
        graphs.insert(0, hosted.clone());
        graphs
    }

    /// Prepares a graph with the layers of a level. Returns it with the guard of the level's `lock`, under which the
    /// layers stay as they are. If the layers cannot be read, the graph refuses plans.
    pub fn with_layers<'a>(
        &self,
        lock: &'a Mutex<()>,
        level: &LevelId,
        prepare: impl Fn(Result<Vec<Layer>, PlannerError>) -> Option<Prepared>,
    ) -> Result<(Prepared, MutexGuard<'a, ()>), PlannerError> {
        loop {
            let stored = self.stores.store.layers(level);
            let layers = match stored.clone() {
                Ok(layers) => readable(layers),
                Err(error) if error.kind == StoreErrorKind::Unavailable => {
                    return Err(PlannerError::store("the layers cannot be read")(error));
                }
                Err(error) => Err(PlannerError::LayersUnreadable(error.to_string())),
            };
            let prepared = prepare(layers).ok_or(BuildError::Cancelled)?;
            let held = lock.lock();
            // Otherwise, a change was stored in the meantime and not applied to this graph.
            if self.stores.store.layers(level) == stored {
                return Ok((prepared, held));
            }
        }
    }

    /// Applies the layers of a level, as another planner has stored them, to its graphs in memory. If they cannot be
    /// read, the graphs keep the old layers: the news come again when the store is available.
    pub fn renew(&self, level: &LevelId) {
        if let Err(error) = self.try_renew(level) {
            warn!(%error, "planner: cannot read changed layers; plans use the old ones");
        }
    }

    fn try_renew(&self, level: &LevelId) -> Result<(), StoreError> {
        let progress = Arc::new(Progress::default());
        let lock = self.lock_of(level);
        loop {
            let stored = self.stores.store.layers(level)?;
            // A graph that is being loaded with older layers is in memory once the lock is free.
            drop(lock.lock());
            let layers = readable(stored.clone());
            let revision = layers.as_ref().ok().map(|layers| Revision::of(layers));
            let is_old = |hosted: &Arc<Hosted>| {
                revision.is_none_or(|now| now != hosted.revision()) || hosted.check_layers().is_err()
            };
            let mut graphs = self.graphs.of_level(level);
            graphs.retain(is_old);
            let prepare = |hosted: Arc<Hosted>| Some((hosted.prepare(layers.clone(), &progress)?, hosted));
            let prepared: Vec<(Prepared, Arc<Hosted>)> = graphs.into_iter().filter_map(prepare).collect();
            let _held = lock.lock();
            if self.stores.store.layers(level)? == stored {
                prepared.into_iter().for_each(|(prepared, hosted)| self.apply(&hosted, prepared));
                return Ok(());
            }
        }
    }
}

/// Returns all layers of a level, or why they cannot be used.
fn readable(layers: LevelLayers) -> Result<Vec<Layer>, PlannerError> {
    layers.whole().map_err(|damaged| PlannerError::LayersUnreadable(damaged.to_string()))
}
