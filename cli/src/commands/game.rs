//! The flags that select a game, in whose physics NPCs then move.

use super::endpoint::CredentialArgs;
use surefoot_game::{Bridge, BridgeError, is_batch_address};
use surefoot_game_client::{Game, GameError};
use surefoot_net::client::Credentials;

/// A game that serves environments.
#[derive(clap::Args, Clone)]
pub struct WorldArgs {
    /// Run NPCs in the physics of a game instead of ours, which runs the level, read here for its geometry. The game
    /// serves EnvService at http:// or https://, or speaks the batch protocol at tcp://HOST:PORT or unix:PATH
    #[arg(long, value_name = "URI", env = "SUREFOOT_WORLD")]
    world: Option<String>,
    #[command(flatten)]
    credentials: CredentialArgs,
}

impl WorldArgs {
    /// Connects to the game, if there is one.
    pub fn connect(&self) -> anyhow::Result<Option<Game>> {
        let Some(uri) = &self.world else { return Ok(None) };
        Ok(Some(resolve(uri)?.connect(&self.credentials.credentials()?)?))
    }
}

/// Where environments of a game are served.
#[derive(Debug)]
pub struct Resolved {
    /// Address of the game, for messages.
    shown: String,
    /// Serves the environments of a game that does not serve them itself, as long as it lives.
    bridge: Option<Bridge>,
}

/// Finds out who serves the environments of the game at `uri`. If the game speaks the batch protocol, a bridge in this
/// process does.
///
/// # Errors
/// If a game that speaks the batch protocol does not answer.
pub fn resolve(uri: &str) -> Result<Resolved, BridgeError> {
    let bridge = is_batch_address(uri).then(|| Bridge::start(uri)).transpose()?;
    Ok(Resolved { shown: uri.to_owned(), bridge })
}

impl Resolved {
    /// Connects, and keeps the bridge alive as long as the connection.
    ///
    /// # Errors
    /// If nobody answers.
    pub fn connect(self, credentials: &Credentials) -> Result<Game, GameError> {
        let game = match self.bridge {
            None => Game::connect(&self.shown, credentials)?,
            // The bridge is in this process: tokens and certificates are of no use there.
            Some(bridge) => Game::connect(bridge.uri(), &Credentials::default())?.behind(&self.shown, bridge),
        };
        Ok(game)
    }
}
