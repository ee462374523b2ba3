//! Lets a game in Rust serve environments (`EnvService`), so that Surefoot trains, proves graphs and measures success in the game's own
//! physics: docs/games.md.
//!
//! A game implements [`GameWorld`], one character of it, and [`Level`], which makes such worlds; [`serve`] does the rest. Episodes, rewards,
//! routes and the layout of observations are those of worlds of ours, by the same code. `examples/rapier.rs` is a whole game.

mod physics;
mod serve;

pub use physics::{BodyState, Command, GameWorld, Hit};
pub use serve::{Level, serve, serve_blocking};
pub use surefoot_world::character::TickEvents;
pub use surefoot_world::map::Placed;
pub use surefoot_world::mesh::Surface;
pub use surefoot_world::{Action, CharacterProfile, End, TICK_SECONDS, Vec3};
