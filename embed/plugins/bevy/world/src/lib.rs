//! A game on Bevy whose physics is not ours: avian's colliders and rays, and the plugin's character, which moves by avian's move and slide.
//!
//! The app has a thread of its own, in the program the main thread, and moves nobody unless it is called: Surefoot's server, on other
//! threads, sends its calls through a channel. `calls.rs` has their side, `game.rs` that of the app.

mod calls;
mod game;

pub use calls::{Call, Scene};
pub use game::app;

use bevy_surefoot::SurefootLevel;
use std::sync::mpsc::{Receiver, sync_channel};

/// Environments at a time.
pub const ENVS: usize = 16;

/// The level as the server sees it, and the calls that it will make. Each world waits for the answer to its call, so that there are never
/// more calls than worlds.
pub fn scene(level: &SurefootLevel) -> (Scene, Receiver<Call>) {
    let (sender, calls) = sync_channel(ENVS);
    (Scene::new(level.map().clone(), sender), calls)
}
