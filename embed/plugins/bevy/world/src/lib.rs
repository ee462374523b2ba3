//! A game on Bevy with foreign physics: avian's colliders and rays, and the plugin's character, which moves by avian's
//! move and slide.
//!
//! The app runs on its own thread (the main thread in the program) and moves characters only when it is called.
//! Surefoot's server runs on other threads and sends its calls through a channel. `calls.rs` has the server's side,
//! `game.rs` the app's.

mod calls;
mod game;

pub use calls::{Call, Scene};
pub use game::app;

use bevy_surefoot::SurefootLevel;
use std::sync::mpsc::{Receiver, sync_channel};

/// Environments at a time.
pub const ENVS: usize = 16;

/// The level as the server sees it, and the receiver of its calls. Each world waits for the answer to its call, so
/// there are never more calls than worlds.
pub fn scene(level: &SurefootLevel) -> (Scene, Receiver<Call>) {
    let (sender, calls) = sync_channel(ENVS);
    (Scene::new(level.map().clone(), sender), calls)
}
