//! The plugin in apps without a window. `embed/plugins/bevy/check` names the program, which proves the graphs.

#[cfg(feature = "avian")]
mod avian;
#[cfg(feature = "avian")]
mod blocks;
#[cfg(any(feature = "avian", feature = "rapier"))]
mod crowd;
mod files;
#[cfg(feature = "avian")]
mod goals;
#[cfg(feature = "avian")]
mod motion;
#[cfg(feature = "rapier")]
mod rapier;
mod stage;
