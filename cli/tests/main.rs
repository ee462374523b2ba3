//! `surefoot` as users run it, in real processes.

mod commands;
mod config;
mod crowds;
mod drain;
mod graphs;
mod kills;
mod levels;
mod memory;
mod priority;
mod released;
mod restarts;
