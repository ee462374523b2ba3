//! Calls about maps: sampling the ground, surveys and edits. Long work runs in the background, in turns.

use super::{WorldHandle, Worlds, WorldsError, in_background};
use crate::hosted::{EditError, HostedWorld, MapEdit, MapEdited, ZonesEdit};
use crate::ids::WorldId;
use std::sync::Arc;
use surefoot_net::levels::MapSource;
use surefoot_net::serving::Caller;
use surefoot_world::reach::{PlayArea, Reach};
use surefoot_world::{CharacterProfile, Map, Seed, Tick, Vec3};

/// Times that an edit is made again because other clients edited the map meanwhile.
const MAX_TRIES: usize = 8;

/// The places on a map that a body can reach.
#[derive(Debug, Clone)]
pub struct Survey {
    pub body: CharacterProfile,
    /// Number of places where it can stand, on a grid of 1.25 m.
    pub places: usize,
    /// Number of islands of places that are connected on foot.
    pub islands: usize,
    /// Share of ordered pairs of places that are connected on foot, in [0, 1].
    pub connected_on_foot: f64,
    /// Share of ordered pairs of places that are connected by every means, in [0, 1].
    pub connected: f64,
    /// Number of places that cannot be reached from the map's spawn points, or without any from the largest region of
    /// mutually connected places.
    pub cut_off_places: usize,
    /// Some of them, spread evenly, m.
    pub cut_off: Vec<Vec3>,
}

impl Survey {
    /// Surveys `map` for a body, on one thread, so that worlds keep stepping. Lists at most `max_cut_off` places.
    pub fn of(map: &Map, body: CharacterProfile, max_cut_off: usize) -> Self {
        let reach = Reach::survey(map, &body, 1);
        let area = PlayArea::of(map, &body, &reach);
        let cells = reach.ground.cells();
        let cut_off: Vec<Vec3> = cells.iter().filter(|cell| !area.reaches(cell.island)).map(|cell| cell.feet).collect();
        let stride = cut_off.len().div_ceil(max_cut_off.max(1)).max(1);
        Self {
            body,
            places: cells.len(),
            islands: reach.ground.islands().len(),
            connected_on_foot: if cells.is_empty() { 0.0 } else { reach.share_on_foot() },
            connected: reach.share_by(|_| true),
            cut_off_places: cut_off.len(),
            cut_off: cut_off.into_iter().step_by(stride).take(max_cut_off).collect(),
        }
    }
}

impl Worlds {
    /// Samples `count` random places of a world where a character can stand. Calls of one client run one by one.
    pub async fn sample_ground(
        &self,
        caller: &Caller,
        world: WorldId,
        body: Option<CharacterProfile>,
        count: usize,
        seed: Seed,
    ) -> Result<Vec<Vec3>, WorldsError> {
        let WorldHandle { shown, body: usual, .. } = self.handle(world)?;
        let turn = self.inner.samples.place(&caller.name).await.turn().await;
        let (map, body) = (shown.get(), body.unwrap_or(usual));
        let sample = move || {
            let _turn = turn;
            HostedWorld::sample_ground(&map, &body, count, seed)
        };
        Ok(in_background("sampling", sample).await??)
    }

    /// Surveys a map for each body, and lists at most `max_cut_off` places that the body cannot reach. Surveys of one
    /// client run one by one; each continues when its caller disconnects.
    pub async fn survey(
        &self,
        caller: &Caller,
        source: MapSource,
        bodies: Vec<CharacterProfile>,
        max_cut_off: usize,
    ) -> Result<Vec<Survey>, WorldsError> {
        // A waiting client holds one map. Its generation takes no turn of a survey.
        let place = self.inner.surveys.place(&caller.name).await;
        let base = self.maps().get(&caller.name, source.base()).await?;
        let turn = place.turn().await;
        let survey = move || {
            let _turn = turn;
            let map = source.finish(base.map());
            bodies.into_iter().map(|body| Survey::of(&map, body, max_cut_off)).collect()
        };
        in_background("surveying", survey).await
    }

    /// Changes the zones of a world. The edit is applied as a whole or not at all. Returns the tick from which the
    /// zones hold, and their number.
    pub async fn set_zones(&self, caller: &Caller, id: WorldId, edit: ZonesEdit) -> Result<(Tick, usize), WorldsError> {
        let handle = self.handle_to_change(caller, id)?;
        let done = handle.sim.call(move |state| state.world.set_zones(edit)).await??;
        self.save_in_fleet(id).await?;
        Ok(done)
    }

    /// Saves a world of a fleet after a change that journals leave out.
    pub(crate) async fn save_in_fleet(&self, id: WorldId) -> Result<(), WorldsError> {
        if self.shared_store().is_some() {
            self.save(id, false).await?;
        }
        Ok(())
    }

    /// Edits the map of a world. The edit is applied as a whole or not at all. The new map is made in the background.
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
                self.save_in_fleet(id).await?;
                return Ok(done);
            }
        }
        Err(EditError::Contended(id).into())
    }
}
