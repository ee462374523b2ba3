//! The flags that select a game, in whose physics NPCs then move.

use super::endpoint::CredentialArgs;
use surefoot_game::{Bridge, is_batch_address};
use surefoot_game_client::{Game, GameError};
use surefoot_net::client::Credentials;

/// A game that serves environments.
#[derive(clap::Args, Clone)]
pub struct WorldArgs {
    /// Run NPCs in the physics of a game, which runs the level, instead of ours. The level is read for its geometry.
    /// The game serves EnvService at http:// or https://, or speaks the batch protocol at tcp://HOST:PORT or unix:PATH
    #[arg(long, value_name = "URI", env = "SUREFOOT_WORLD")]
    world: Option<String>,
    #[command(flatten)]
    credentials: CredentialArgs,
}

impl WorldArgs {
    /// Connects to the game, if there is one.
    pub fn connect(&self) -> anyhow::Result<Option<Game>> {
        let Some(uri) = &self.world else { return Ok(None) };
        Ok(Some(connect(uri, &self.credentials.credentials()?)?))
    }
}

/// Connects to the environments of the game at `uri`. For a game that speaks the batch protocol, a bridge in this
/// process serves them as long as the connection lives.
pub fn connect(uri: &str, credentials: &Credentials) -> Result<Game, GameError> {
    if !is_batch_address(uri) {
        return Game::connect(uri, credentials);
    }
    let unreachable =
        |error: surefoot_game::BridgeError| GameError::Unreachable { uri: uri.into(), reason: error.to_string() };
    let bridge = Bridge::start(uri).map_err(unreachable)?;
    // The bridge is in this process, so it needs neither tokens nor certificates.
    Ok(Game::connect(bridge.uri(), &Credentials::default())?.behind(uri, bridge))
}
