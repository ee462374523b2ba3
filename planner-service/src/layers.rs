//! Changes of layers: made one at a time, stored first, then applied to every graph of the level.

use crate::error::PlannerError;
use crate::hosted::{Hosted, Revision};
use crate::planner::Planner;
use std::sync::Arc;
use surefoot_planner::edits::{Edit, Layer, Unapplied};
use surefoot_planner::store::LevelId;

/// A change of one layer.
#[derive(Debug, Clone, PartialEq)]
pub enum LayerChange {
    /// Replaces the layer of the same name.
    Put(Layer),
    /// Appends edits to the layer of this name, which is created if it does not exist.
    Append(String, Vec<Edit>),
    /// Removes this number of edits from the end of the layer of this name.
    Undo(String, usize),
}

impl LayerChange {
    /// Returns the changed layer.
    fn apply(self, layers: &[Layer]) -> Result<Layer, PlannerError> {
        let find = |name: &str| layers.iter().find(|layer| layer.name == name).cloned();
        let changed = match self {
            LayerChange::Put(layer) => layer,
            LayerChange::Append(name, edits) => {
                let mut layer = find(&name).unwrap_or(Layer { name, edits: Vec::new() });
                layer.edits.extend(edits);
                layer
            }
            LayerChange::Undo(name, count) => {
                let mut layer = find(&name).ok_or(PlannerError::UnknownLayer(name))?;
                layer.edits.truncate(layer.edits.len().saturating_sub(count));
                layer
            }
        };
        changed.validate()?;
        Ok(changed)
    }
}

/// Result of a change of layers.
pub struct Changed {
    /// The graph that the caller named.
    pub hosted: Arc<Hosted>,
    /// Edits that could not be applied to this graph.
    pub unapplied: Vec<Unapplied>,
}

impl Planner {
    /// Changes a layer of a graph's level. If `if_revision` is given, the layers must be of that revision.
    ///
    /// # Errors
    /// If the graph is not in memory, the layers are of another revision, the changed layer is invalid, there is no layer to
    /// remove edits from, or the change cannot be stored.
    pub async fn change_layers(
        &self,
        graph_id: &str,
        if_revision: Option<Revision>,
        change: LayerChange,
    ) -> Result<Changed, PlannerError> {
        let editing = self.shared.editing.clone().lock_owned().await;
        let hosted = self.ready(graph_id)?;
        let planner = self.clone();
        let task = tokio::task::spawn_blocking(move || {
            // Held until the change is complete, even if the caller is gone.
            let _editing = editing;
            let level = hosted.level();
            let layers = planner.store_change(&level, if_revision, change)?;
            let mut all = planner.all_ready();
            if !all.iter().any(|other| Arc::ptr_eq(other, &hosted)) {
                all.push(hosted.clone());
            }
            for other in all.iter().filter(|other| other.level() == level) {
                other.apply_layers(layers.clone());
            }
            let (_, unapplied) = hosted.layers();
            Ok(Changed { hosted, unapplied })
        });
        task.await.map_err(PlannerError::lost("the edit"))?
    }

    /// Stores a change, and returns all layers of the level after it, by name.
    fn store_change(
        &self,
        level: &LevelId,
        if_revision: Option<Revision>,
        change: LayerChange,
    ) -> Result<Vec<Layer>, PlannerError> {
        // The store is authoritative: graphs in memory apply the layers a little later.
        let stored = self.shared.store.layers(level);
        let mut layers = stored.map_err(PlannerError::store("the layers cannot be read"))?;
        if if_revision.is_some_and(|revision| revision != Revision::of(&layers)) {
            return Err(PlannerError::Overtaken);
        }
        let changed = change.apply(&layers)?;
        layers.retain(|layer| layer.name != changed.name);
        if !changed.edits.is_empty() {
            layers.push(changed.clone());
        }
        layers.sort_by(|a, b| a.name.cmp(&b.name));
        self.shared.store.put_layer(level, &changed).map_err(PlannerError::store("the layer cannot be stored"))?;
        Ok(layers)
    }
}
