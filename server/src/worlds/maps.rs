//! Long work on maps in the background, in turns: places to stand, and surveys.

use super::{WorldHandle, Worlds, WorldsError, in_background};
use crate::hosted::HostedWorld;
use crate::ids::WorldId;
use crate::survey::Survey;
use surefoot_net::levels::MapSource;
use surefoot_net::serving::Caller;
use surefoot_world::{CharacterProfile, Seed, Vec3};

impl Worlds {
    /// Draws `count` random places of a world where a character can stand. A client's calls run one after the other.
    ///
    /// # Errors
    /// If there is no such world, or its map has no navigable ground.
    pub async fn sample_ground(
        &self,
        caller: &Caller,
        world: WorldId,
        body: Option<CharacterProfile>,
        count: usize,
        seed: Seed,
    ) -> Result<Vec<Vec3>, WorldsError> {
        let WorldHandle { shown, body: usual, .. } = self.handle(world)?;
        let turn = self.shared.samples.place(&caller.name).await.turn().await;
        let (map, body) = (shown.get(), body.unwrap_or(usual));
        let sample = move || {
            let _turn = turn;
            HostedWorld::sample_ground(&map, &body, count, seed)
        };
        Ok(in_background("sampling", sample).await??)
    }

    /// Surveys a map for each of these bodies, and lists at most `max_cut_off` places that each cannot get to. A
    /// client's surveys run one after the other; each goes on when its caller is gone.
    ///
    /// # Errors
    /// If the map cannot be made.
    pub async fn survey(
        &self,
        caller: &Caller,
        source: MapSource,
        bodies: Vec<CharacterProfile>,
        max_cut_off: usize,
    ) -> Result<Vec<Survey>, WorldsError> {
        // A client that waits holds one map. Generating it takes no turn of a survey.
        let place = self.shared.surveys.place(&caller.name).await;
        let made = self.maps().get(&caller.name, source.made()).await?;
        let turn = place.turn().await;
        let survey = move || {
            let _turn = turn;
            let map = source.finish(made.map());
            bodies.into_iter().map(|body| Survey::of(&map, body, max_cut_off)).collect()
        };
        in_background("surveying", survey).await
    }
}
