//! Lets a game serve environments (`EnvService`), so that Surefoot trains, proves graphs and measures success in the game's own physics:
//! docs/games.md.
//!
//! A game in Rust implements [`GameWorld`], one character of it, and [`Level`], which makes such worlds; [`serve`] does the rest. A game in
//! another language speaks the batch protocol, and a [`Bridge`] serves environments in its name. Episodes, rewards, routes and the layout of
//! observations are those of worlds of ours, by the same code. `examples/rapier.rs` is a whole game, `c/` and `python/` have others.

mod batch;
mod decide;
mod physics;
mod serve;
mod world;

pub use batch::{Bridge, BridgeError, is_batch_address};
pub use serve::{Level, serve, serve_blocking};
pub use surefoot_world::map::Placed;
pub use surefoot_world::mesh::Surface;
pub use surefoot_world::{Ability, AbilitySet, Action, CharacterProfile, End, TICK_SECONDS, Vec3};
pub use world::{BodyState, Command, GameWorld, Hit};
