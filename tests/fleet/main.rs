//! A fleet of real processes, shown to hold while its parts are killed, stopped, restarted and cut off: `tests/fleet/check`.
//!
//! [`services`] starts the engines that it runs on, [`process`] our own program, [`chronicle`] is a game client, [`relay`] stands between them.

mod chronicle;
mod process;
mod relay;
mod services;

mod harness;
mod worlds;
