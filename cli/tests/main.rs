//! `surefoot` as users run it, in real processes.

mod commands;
mod config;
mod drain;
mod graphs;
mod kills;
mod levels;
mod memory;
mod restarts;
