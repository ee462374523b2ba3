//! Edits of the pieces on the map of a running world.

use super::world::HostedWorld;
use crate::ids::{NpcId, WorldId};
use crate::messages::ToWorker;
use std::sync::Arc;
use surefoot_world::map::{Piece, PieceError};
use surefoot_world::{Map, NpcSlot, Tick};

/// Why a map cannot be edited.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EditError {
    /// A piece is invalid, or there are too many.
    #[error(transparent)]
    Piece(#[from] PieceError),
    /// There is no piece of that name to remove.
    #[error("the map of world {0} has no piece `{1}`: ListPieces names them")]
    NoSuchPiece(WorldId, String),
    /// An NPC would be enclosed.
    #[error("NPC {0} stands where a piece would be and finds no place within 4.5 m: move it first")]
    Enclosed(NpcId),
    /// Other clients keep editing the map.
    #[error("other clients edit the map of world {0} at the same time: retry")]
    Contended(WorldId),
}

/// A change of the pieces on a map.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MapEdit {
    /// Pieces to add, or to replace those of the same name.
    pub put: Vec<Piece>,
    /// Names of pieces to remove.
    pub remove: Vec<String>,
    /// Whether all existing pieces are removed first.
    pub clear: bool,
}

/// Result of an edit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MapEdited {
    /// Revision of the map.
    pub revision: u64,
    /// Tick before which the map changed.
    pub tick: Tick,
    /// Pieces on the map now.
    pub piece_count: usize,
    /// NPCs that were moved because a piece would have enclosed them.
    pub moved: Vec<NpcId>,
}

impl MapEdit {
    /// The pieces of the map of `world` after the edit.
    pub fn apply(&self, world: WorldId, pieces: &[Piece]) -> Result<Vec<Piece>, EditError> {
        let mut pieces = if self.clear { Vec::new() } else { pieces.to_vec() };
        for name in &self.remove {
            let known = pieces.iter().position(|piece| piece.name == *name);
            pieces.remove(known.ok_or_else(|| EditError::NoSuchPiece(world, name.clone()))?);
        }
        pieces.retain(|piece| self.put.iter().all(|put| put.name != piece.name));
        pieces.extend_from_slice(&self.put);
        Ok(pieces)
    }
}

impl HostedWorld {
    /// Revision of the map, which grows with each edit.
    pub fn map_revision(&self) -> u64 {
        self.map_revision
    }

    /// Replaces the map by `map`, which was made from revision `from`, and notifies workers. Returns `None` and changes
    /// nothing if the map has another revision by now. If an NPC would be enclosed, nothing changes.
    pub fn edit(&mut self, from: u64, map: Arc<Map>) -> Result<Option<MapEdited>, EditError> {
        if from != self.map_revision {
            return Ok(None);
        }
        // Pending messages to workers are about the old map.
        self.flush();
        let slots = self.world.edit(map).map_err(|enclosed| EditError::Enclosed(self.id_of(enclosed.0)))?;
        self.map_revision += 1;
        self.records.values_mut().for_each(|record| record.prediction = None);
        for &worker in &self.notified {
            let pieces = self.map().pieces().to_vec();
            self.registry.send_or_cut(worker, ToWorker::Edited(self.id, pieces));
        }
        Ok(Some(MapEdited {
            revision: self.map_revision,
            tick: self.tick(),
            piece_count: self.map().pieces().len(),
            moved: slots.into_iter().map(|slot| self.id_of(slot)).collect(),
        }))
    }

    fn id_of(&self, slot: NpcSlot) -> NpcId {
        let mut records = self.records.iter();
        *records.find(|(_, record)| record.slot == slot).expect("every NPC has a record").0
    }
}
