//! Edits of the maps of running worlds: the new map is made beside the world's thread, which only takes it over.

use crate::hosted::{EditError, MapEdit, MapEdited};
use crate::ids::WorldId;
use crate::worlds::{Worlds, WorldsError, in_background};
use std::sync::Arc;
use surefoot_net::serving::Caller;

/// Times that an edit is made anew because others edited the map meanwhile.
const MAX_TRIES: usize = 8;

impl Worlds {
    /// Edits the map of a world, whole or not at all.
    ///
    /// # Errors
    /// If there is no such world, it belongs to somebody else, or the edit is not possible.
    pub async fn edit(&self, caller: &Caller, id: WorldId, edit: MapEdit) -> Result<MapEdited, WorldsError> {
        let handle = self.handle_to_change(caller, id)?;
        for _ in 0..MAX_TRIES {
            let (revision, map) =
                handle.sim.call(|state| (state.world.map_revision(), state.world.map().clone())).await?;
            let pieces = edit.apply(id, map.pieces())?;
            let edited = in_background("editing a map", move || map.with_pieces(pieces)).await?;
            let edited = Arc::new(edited.map_err(EditError::from)?);
            let shown = handle.shown.clone();
            let done = handle.sim.call(move |state| {
                let done = state.world.edit(revision, edited)?;
                shown.show(state.world.map());
                Ok::<_, EditError>(done)
            });
            if let Some(done) = done.await?? {
                if self.shared_store().is_some() {
                    // What the servers of a fleet know of between two saves is only what NPCs do.
                    self.save(id, false).await?;
                }
                return Ok(done);
            }
        }
        Err(EditError::Contended(id).into())
    }
}
