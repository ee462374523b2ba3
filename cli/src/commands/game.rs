//! The flags that name a game in whose physics something is done.

use super::endpoint::CredentialArgs;
use surefoot_agent::game::Game;

/// A game that serves environments.
#[derive(clap::Args, Clone)]
pub struct WorldArgs {
    /// Run NPCs in the physics of the game that serves EnvService at this address, instead of ours; it runs the level, which is read here
    /// for its geometry
    #[arg(long, value_name = "URI", env = "SUREFOOT_WORLD")]
    world: Option<String>,
    #[command(flatten)]
    credentials: CredentialArgs,
}

impl WorldArgs {
    /// Connects to the game, if there is one.
    pub fn connect(&self) -> anyhow::Result<Option<Game>> {
        let Some(uri) = &self.world else { return Ok(None) };
        Ok(Some(Game::connect(uri, &self.credentials.credentials()?)?))
    }
}
