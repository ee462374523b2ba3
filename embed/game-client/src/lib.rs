//! Games as worlds: what Surefoot does with NPCs that move in the physics of a game, which serves environments itself
//! (`EnvService`).
//!
//! A [`Game`] is a connection, a [`GameEnv`] an environment that it runs. [`drive`] lets a policy decide for the NPCs,
//! [`probes`] proves edges of graphs there, [`attempts`] sends NPCs to goals. Placement, candidates and surveys use the
//! level's geometry as we read it; what is reached, and how, only the game says. docs/games.md is the page for those
//! who implement the other side.

pub mod attempts;
pub mod drive;
pub mod link;
pub mod probes;

pub use link::{Game, GameEnv, GameError, Level};
