//! A fleet of real processes, shown to hold while its parts are killed, stopped, restarted and cut off:
//! `tests/fleet/check`.
//!
//! [`services`] starts the engines that it runs on, the crate `surefoot_processes` our own program, [`relay`] stands
//! between them. [`chronicle`] is a game client, and [`raw`] says to NATS what ours never would.

mod chronicle;
mod raw;
mod relay;
mod services;

mod harness;
mod healing;
mod jobs;
mod planners;
mod repeats;
mod requesters;
mod takeovers;
mod whole;
mod work;
mod worlds;
