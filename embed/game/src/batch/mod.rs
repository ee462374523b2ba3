//! The batch protocol: a game in any language moves bodies and casts rays, one round trip per decision of all characters (docs/games.md).
//!
//! [`wire`] is the layout, [`link`] a connection, which is one world of the game; [`bridge`] serves environments in the name of the game.

mod bridge;
mod link;
mod wire;

pub use bridge::{Bridge, BridgeError, is_batch_address};
