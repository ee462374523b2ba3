//! Lets a game serve environments (`EnvService`), so that Surefoot trains, proves graphs and measures success in the
//! game's own physics. See docs/guides/game-as-world.md.
//!
//! A game in Rust implements [`GameWorld`] and [`Level`], which creates the worlds; [`serve`] does the rest. A game in
//! another language speaks the batch protocol, and a [`Bridge`] serves environments on its behalf. Episodes, rewards,
//! routes and the layout of observations use the same code as Surefoot's own worlds. `examples/rapier.rs` is a complete
//! game; `c/` and `python/` contain others.

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
