//! Serving the environments of a game.

use crate::decide::{Bodies, Eyes, Ticked};
use crate::physics::GamePhysics;
use crate::world::GameWorld;
use std::fmt;
use std::net::SocketAddr;
use std::sync::Arc;
use surefoot_net::serving::{Endpoint, EndpointConfig, ServeError, Shutdown};
use surefoot_rollout::env::{Env, Episodes};
use surefoot_server::{Host, serve_game};
use surefoot_world::map::Placed;
use surefoot_world::{CharacterProfile, Vec3};

/// A level of a game, which makes worlds for environments. Each is stepped by one thread at a time.
pub trait Level: Send + Sync + 'static {
    /// Makes a world of `count` characters with this body.
    ///
    /// # Errors
    /// Says in a sentence why the game cannot, such as that it has no such character.
    fn open(&self, body: &CharacterProfile, count: usize) -> Result<Box<dyn GameWorld>, String>;

    /// Pads, zip lines, teleporters and jetpacks that NPCs sense from afar; none unless a game says otherwise.
    fn devices(&self) -> Placed {
        Placed::default()
    }

    /// Places to stand, m, for starts and goals at random, drawn with `seed`. Needed by training alone.
    ///
    /// # Errors
    /// Says in a sentence why there are none.
    fn places(&self, _body: &CharacterProfile, _seed: u64) -> Result<Vec<Vec3>, String> {
        Err("it knows no places for goals at random: give goals".to_owned())
    }
}

struct Hosted<L>(L);

impl<L> fmt::Debug for Hosted<L> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Hosted").finish_non_exhaustive()
    }
}

impl<L: Level> Host for Hosted<L> {
    fn open(&self, body: &CharacterProfile, solid_npcs: bool, episodes: Episodes) -> Result<Env, String> {
        let seed = seed_of(&episodes);
        let world = self.0.open(body, episodes.npc_count())?;
        let bodies = Box::new(Ticked { world, eyes: Eyes::of(body) });
        start((bodies, self.0.devices()), body, solid_npcs, episodes, || self.0.places(body, seed))
    }
}

/// The seed of the places of these episodes.
pub(crate) fn seed_of(episodes: &Episodes) -> u64 {
    match episodes {
        Episodes::Endless { seed, .. } => *seed,
        Episodes::Once(_) => 0,
    }
}

/// Starts episodes of these bodies, among these devices.
pub(crate) fn start(
    (bodies, devices): (Box<dyn Bodies>, Placed),
    body: &CharacterProfile,
    solid_npcs: bool,
    episodes: Episodes,
    places: impl FnOnce() -> Result<Vec<Vec3>, String>,
) -> Result<Env, String> {
    if solid_npcs {
        return Err("its characters do not get in each other's way: leave solid_npcs out".to_owned());
    }
    let physics = GamePhysics::new(bodies, body.clone(), devices, episodes.npc_count());
    let env = Env::of(Box::new(physics), episodes, |_| {
        let places = places()?;
        if places.is_empty() { Err("it has no places to stand".to_owned()) } else { Ok(places) }
    })?;
    env.failure().map_or(Ok(()), |reason| Err(reason.to_owned()))?;
    Ok(env)
}

/// Serves environments on a level at `address` until `shutdown`, at most `limit` at a time.
///
/// # Errors
/// If the address is taken, or other machines could reach it, which takes the protection of an [`Endpoint`] of its own.
pub async fn serve<L: Level>(
    level: L,
    address: SocketAddr,
    limit: usize,
    shutdown: Shutdown,
) -> Result<(), ServeError> {
    let endpoint = Endpoint::open(address, EndpointConfig::default())?;
    serve_game(endpoint, Arc::new(Hosted(level)), limit, shutdown).await
}

/// Serves environments on a level at `address` until the process ends: at most `limit` at a time, on separate threads.
///
/// # Errors
/// As [`serve`].
///
/// # Panics
/// If no threads can be started.
pub fn serve_blocking<L: Level>(level: L, address: SocketAddr, limit: usize) -> Result<(), ServeError> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().expect("threads can be started");
    runtime.block_on(serve(level, address, limit, Shutdown::default()))
}
