//! One character: its profile, its body and one tick of its motion.
//!
//! The body is an upright capsule with a controller of our own: integrate, push out of the deepest contact until none
//! is left, and snap to the ground when walking down. A tick reads only the few triangles around the body.
//! `docs/adr/0021-columns.md` explains why the controller is not rapier's.
//!
//! `tick` is [`Body::tick`] with its phases; `contact` moves the capsule among the triangles that `surroundings` keeps;
//! `devices` handles pads, zip lines, teleporters and jetpacks.

mod action;
pub mod bodies;
mod body;
mod contact;
mod devices;
mod own;
mod profile;
mod spots;
mod surroundings;
mod tick;

pub use action::{ACTION_LEN, Action, ActionError};
pub use body::{Body, Ride, Support};
pub use contact::is_clear;
pub use own::{OwnMotion, OwnMove, OwnMoveError};
pub use profile::{CharacterProfile, ProfileError, RawCharacterProfile};
pub use surroundings::MoveScratch;
pub use tick::DASH_TICKS;
