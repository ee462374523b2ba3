//! The batch protocol: a game in any language moves bodies and casts rays, with one round trip per decision of all
//! characters (docs/reference/game-protocol.md).
//!
//! [`wire`] defines the layout. A [`link`] is a connection and holds one world of the game. [`bridge`] serves
//! environments on behalf of the game.

mod bridge;
mod link;
mod wire;

pub use bridge::{Bridge, BridgeError, is_batch_address};
