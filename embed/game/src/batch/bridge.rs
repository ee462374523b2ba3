//! Serves environments on loopback in the name of a game that speaks the batch protocol.

use super::link::{Address, Connection};
use crate::serve::{seed_of, start};
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use surefoot_net::serving::{Endpoint, EndpointConfig, ServeError, Shutdown};
use surefoot_rollout::env::{Env, Episodes};
use surefoot_server::{Host, serve_game};
use surefoot_world::CharacterProfile;
use surefoot_world::map::Placed;

/// Environments at a time, each with a connection.
const ENVS: usize = 64;

/// Whether `uri` is the address of a game that speaks the batch protocol: `tcp://HOST:PORT` or `unix:PATH`.
pub fn is_batch_address(uri: &str) -> bool {
    Address::parse(uri).is_some()
}

/// Why there is no bridge to a game.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// The address is of another form.
    #[error("{0} is no address of a game: it must be tcp://HOST:PORT or unix:PATH")]
    Address(String),
    /// The address does not answer, or answers in another protocol.
    #[error("cannot use the game at {address}: {reason}")]
    Game {
        /// The address.
        address: String,
        /// What went wrong.
        reason: String,
    },
    /// Environments cannot be served on loopback.
    #[error(transparent)]
    Serve(#[from] ServeError),
    /// There is no thread for it.
    #[error("cannot start the bridge to a game: {0}")]
    Thread(#[from] std::io::Error),
}

/// Serves environments that run in a game, for clients on this machine. They end when it is dropped.
#[derive(Debug)]
pub struct Bridge {
    uri: String,
    shutdown: Shutdown,
}

impl Bridge {
    /// Connects to the game at `address` (`tcp://HOST:PORT` or `unix:PATH`) and serves environments on a free loopback
    /// port.
    ///
    /// # Errors
    /// If the address is of another form, nobody answers there, or what answers does not speak the protocol.
    pub fn start(address: &str) -> Result<Self, BridgeError> {
        let game = Address::parse(address).ok_or_else(|| BridgeError::Address(address.to_owned()))?;
        let unusable = |reason| BridgeError::Game { address: game.to_string(), reason };
        Connection::begin(&game).map(drop).map_err(unusable)?;
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
        let endpoint = {
            let _entered = runtime.enter();
            Endpoint::open(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)), EndpointConfig::default())?
        };
        let (uri, shutdown) = (endpoint.uri(), Shutdown::default());
        let serving = serve_game(endpoint, Arc::new(Remote { address: game }), ENVS, shutdown.clone());
        std::thread::Builder::new().name("game bridge".to_owned()).spawn(move || {
            // Its users notice when it ends.
            let _ = runtime.block_on(serving);
        })?;
        Ok(Self { uri, shutdown })
    }

    /// Address of the environments.
    pub fn uri(&self) -> &str {
        &self.uri
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        self.shutdown.trigger();
    }
}

/// A game elsewhere.
#[derive(Debug)]
struct Remote {
    address: Address,
}

impl Host for Remote {
    fn open(&self, body: &CharacterProfile, solid_npcs: bool, episodes: Episodes) -> Result<Env, String> {
        let mut connection = Connection::begin(&self.address)?;
        connection.open(body, episodes.npc_count())?;
        let places = match &episodes {
            Episodes::Endless { .. } => connection.places(seed_of(&episodes))?,
            Episodes::Once(_) => Vec::new(),
        };
        start((Box::new(connection), Placed::default()), body, solid_npcs, episodes, || Ok(places))
    }
}
