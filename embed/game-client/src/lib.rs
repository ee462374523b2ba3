//! Games as worlds: NPCs that move in the physics of a game, which serves environments (`EnvService`).
//!
//! A [`Game`] is a connection, and a [`GameEnv`] is an environment in the game. [`drive`] lets a policy decide for the
//! NPCs, [`probes`] proves edges of graphs, [`attempts`] sends NPCs to goals, and [`fit`] finds a body that moves like
//! the characters of the game. Placement, candidates and surveys use the imported geometry of the level; only the game
//! decides what is reached, and how.
//! docs/guides/game-as-world.md describes the game's side.

pub mod attempts;
pub mod drive;
pub mod fit;
pub mod link;
pub mod probes;

pub use link::{Game, GameEnv, GameError, Level};
