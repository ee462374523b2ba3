//! The zones of a world and the tags of its NPCs. Workers put them into the plans of NPCs.

use super::commands::NpcError;
use super::world::HostedWorld;
use crate::ids::{NpcId, WorldId};
use crate::messages::ToWorker;
use std::collections::BTreeMap;
use surefoot_planner::zones::MAX_ZONES;
use surefoot_planner::{Tags, Zone};
use surefoot_world::Tick;

/// Why the zones of a world cannot be changed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ZonesError {
    /// There is no zone of that name to remove.
    #[error("world {0} has no zone `{1}`: ListZones names them")]
    NoSuchZone(WorldId, String),
    /// There would be too many zones.
    #[error("world {0} would have {1} zones, but {MAX_ZONES} are the most allowed")]
    TooMany(WorldId, usize),
}

/// A change of the zones of a world.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ZonesEdit {
    /// Zones to add, or to replace those of the same name.
    pub put: Vec<Zone>,
    /// Names of zones to remove.
    pub remove: Vec<String>,
    /// Whether all existing zones are removed first.
    pub clear: bool,
}

impl HostedWorld {
    /// Sets the zones of a world without NPCs.
    #[must_use]
    pub fn with_zones(mut self, zones: impl IntoIterator<Item = Zone>) -> Self {
        self.zones = zones.into_iter().map(|zone| (zone.name.clone(), zone)).collect();
        self
    }

    /// The zones, by name.
    pub fn zones(&self) -> impl Iterator<Item = &Zone> {
        self.zones.values()
    }

    /// Changes the zones and notifies workers. Returns the tick from which the zones hold, and their number. On an
    /// error, nothing changes.
    pub fn set_zones(&mut self, edit: ZonesEdit) -> Result<(Tick, usize), ZonesError> {
        let mut zones = if edit.clear { BTreeMap::new() } else { self.zones.clone() };
        for name in edit.remove {
            if zones.remove(&name).is_none() {
                return Err(ZonesError::NoSuchZone(self.id, name));
            }
        }
        zones.extend(edit.put.into_iter().map(|zone| (zone.name.clone(), zone)));
        if zones.len() > MAX_ZONES {
            return Err(ZonesError::TooMany(self.id, zones.len()));
        }
        self.zones = zones;
        // Assignments that have not been sent yet get the new zones.
        for &worker in &self.notified {
            let zones = Some(self.zones().cloned().collect());
            self.registry.send_or_cut(worker, ToWorker::ZonesChanged { world: self.id, zones, tags: Vec::new() });
        }
        Ok((self.tick(), self.zones.len()))
    }

    /// Replaces the tags of an NPC. Its worker is notified before its next decision.
    pub fn set_tags(&mut self, id: NpcId, tags: Tags) -> Result<(), NpcError> {
        let record = self.records.get_mut(&id).ok_or(NpcError::Unknown(id))?;
        record.tags = tags;
        if let Some(worker) = record.worker {
            self.outbox.entry(worker).or_default().tagged.insert(id);
        }
        Ok(())
    }

    /// The tags of an NPC.
    pub fn tags(&self, id: NpcId) -> Result<&Tags, NpcError> {
        Ok(&self.records.get(&id).ok_or(NpcError::Unknown(id))?.tags)
    }

    /// These NPCs with their tags.
    pub(super) fn tags_of(&self, npcs: impl IntoIterator<Item = NpcId>) -> Vec<(NpcId, Tags)> {
        let tags = |id| self.records.get(&id).map(|record| (id, record.tags.clone()));
        npcs.into_iter().filter_map(tags).collect()
    }
}
